/* RRT-Connect: two trees of straight motions that grow towards each other, whatever checks the motions. */

#ifndef RRT_CONNECT_H
#define RRT_CONNECT_H

#include "native.h"

#define SHORTEST 1e-2 /* extension that makes a node [rad]: heuristic */

/* The parent of a root is -1. */
typedef struct {
    int64_t count, capacity;
    double *points;   /* (capacity, size) */
    int64_t *parents; /* (capacity,) */
} Tree;

typedef struct {
    int64_t size, targets, fresh; /* size of a point; own nodes from this one on are connected first */
    double longest;               /* extension */
    const double *target;         /* (targets, size) */
    Tree own, other;
    double *end;    /* (size,) */
    int64_t met[2]; /* nodes at which own and the other tree meet, else -1 */
} Growth;

/* Free share of a straight motion; 0 at once where the end is asked about first and is not free. */
typedef double (*FreeShare)(void *check, const double *from, const double *to, int end_first);
/* Share of a straight motion within the limits of the joints. */
typedef double (*WithinLimits)(const void *check, const double *from, const double *to);

static inline int64_t nearest_node(const Tree *tree, int64_t size, const double *target, double *apart)
{
    int64_t best = -1;
    double least = INFINITY;
    for (int64_t node = 0; node < tree->count; node++) {
        const double *point = tree->points + node * size;
        double sums[4] = {0.0, 0.0, 0.0, 0.0};
        int64_t d = 0;
        for (; d + 4 <= size; d += 4)
            for (int k = 0; k < 4; k++) sums[k] += (point[d + k] - target[d + k]) * (point[d + k] - target[d + k]);
        for (; d < size; d++) sums[0] += (point[d] - target[d]) * (point[d] - target[d]);
        double square = (sums[0] + sums[1]) + (sums[2] + sums[3]);
        if (square < least) {
            least = square;
            best = node;
        }
    }
    *apart = sqrt(least);
    return best;
}

/* Number of a new node, or of its parent where there is no space for more. */
static inline int64_t add_node(Tree *tree, int64_t size, const double *point, int64_t parent)
{
    if (tree->count >= tree->capacity) return parent;
    memcpy(tree->points + tree->count * size, point, (size_t)size * sizeof(double));
    tree->parents[tree->count] = parent;
    return tree->count++;
}

static inline void place_end(Growth *g, const double *from, const double *to, double share)
{
    for (int64_t d = 0; d < g->size; d++) g->end[d] = from[d] + share * (to[d] - from[d]);
}

/* Extend the other tree towards an own node as far as the motion is free; returns whether it arrives. */
static inline int connect_node(Growth *g, void *check, FreeShare free_share, int64_t node)
{
    if (g->other.count == 0) return 0;
    double apart;
    const double *target = g->own.points + node * g->size;
    int64_t last = nearest_node(&g->other, g->size, target, &apart);
    const double *from = g->other.points + last * g->size;
    double share = free_share(check, from, target, 0);
    if (share >= 1.0) {
        g->met[0] = node;
        g->met[1] = last;
        return 1;
    }
    int64_t whole = whole_within(share * apart / g->longest, 0, g->other.capacity);
    for (int64_t k = 1; k <= whole; k++) {
        place_end(g, from, target, (double)k * g->longest / apart);
        last = add_node(&g->other, g->size, g->end, last);
    }
    return 0;
}

/* Extend the own tree towards each target, and the other one towards what is new, until they meet. Extensions are taken
   whole: nodes where they were stopped would all lie in contact, where little can follow. */
static inline void grow(Growth *g, void *check, FreeShare free_share, WithinLimits within)
{
    g->met[0] = g->met[1] = -1;
    for (; g->fresh < g->own.count; g->fresh++)
        if (connect_node(g, check, free_share, g->fresh)) return;
    for (int64_t k = 0; k < g->targets && g->own.count < g->own.capacity; k++) {
        double apart;
        const double *target = g->target + k * g->size;
        int64_t parent = nearest_node(&g->own, g->size, target, &apart);
        const double *from = g->own.points + parent * g->size;
        if (!(apart < INFINITY)) continue;
        double share = apart > g->longest ? g->longest / apart : 1.0, most = within(check, from, target);
        share = share < most ? share : most;
        if (!(share * apart > SHORTEST)) continue;
        place_end(g, from, target, share);
        if (free_share(check, from, g->end, 1) < 1.0) continue;
        if (connect_node(g, check, free_share, add_node(&g->own, g->size, g->end, parent))) return;
    }
}

#endif
