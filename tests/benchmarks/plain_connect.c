/* A plain RRT-Connect (Kuffner and LaValle, 2000) in the bends of a planar arm, its motions swept: what a sampling
 * planner does with a scene. It shares nothing with the package. See plain_connect.py. */

#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "swept_links.h"

typedef struct {
    double *bends;
    long *parents;
    long count, capacity;
} Tree;

static double now(void) { return (double)clock() / CLOCKS_PER_SEC; }

/* ---------------------------------------------------------------- trees */
static long added(Tree *t, long links, const double *bends, long parent) {
    if (t->count == t->capacity) {
        t->capacity = t->capacity ? 2 * t->capacity : 1024;
        t->bends = realloc(t->bends, sizeof(double) * (size_t)(t->capacity * links));
        t->parents = realloc(t->parents, sizeof(long) * (size_t)t->capacity);
    }
    memcpy(t->bends + t->count * links, bends, sizeof(double) * (size_t)links);
    t->parents[t->count] = parent;
    return t->count++;
}

static long nearest(const Tree *t, long links, const double *target) {
    long best = 0;
    double least = INFINITY;
    for (long k = 0; k < t->count; ++k) {
        double sum = 0.0;
        const double *node = t->bends + k * links;
        for (long i = 0; i < links; ++i) sum += (node[i] - target[i]) * (node[i] - target[i]);
        if (sum < least) {
            least = sum;
            best = k;
        }
    }
    return best;
}

/* One step of at most range: the new node, or -1; reached tells whether it is the target. */
static long extended(const Scene *s, Tree *t, const double *target, double range, int *reached, long *motions) {
    long from = nearest(t, s->links, target);
    const double *node = t->bends + from * s->links;
    double end[MOST_LINKS], length = 0.0;
    for (long i = 0; i < s->links; ++i) length += (target[i] - node[i]) * (target[i] - node[i]);
    length = sqrt(length);
    *reached = length <= range;
    for (long i = 0; i < s->links; ++i) end[i] = *reached ? target[i] : node[i] + range / length * (target[i] - node[i]);
    ++*motions;
    if (!motion_free(s, node, end)) return -1;
    return added(t, s->links, end, from);
}

static double uniform(uint64_t *state) {
    uint64_t z = (*state += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (double)((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}

/* Number of poses of the way found, written to way (most, links); 0 when the time is up. */
long plain_connect(const Scene *s, const double *start, const double *goals, long goal_count, double range,
                   double seconds, uint64_t seed, double *way, long most, double *used, long *motions) {
    Tree trees[2] = {{0}};
    double begun = now(), target[MOST_LINKS];
    long found = 0, links = s->links;
    added(&trees[0], links, start, -1);
    for (long k = 0; k < goal_count; ++k) added(&trees[1], links, goals + k * links, -1);
    *motions = 0;
    for (long turn = 0; goal_count && !found && now() - begun < seconds; ++turn) {
        Tree *tree = &trees[turn % 2], *other = &trees[1 - turn % 2];
        int reached;
        for (long i = 0; i < links; ++i) target[i] = s->limits[i] * (2.0 * uniform(&seed) - 1.0);
        long node = extended(s, tree, target, range, &reached, motions), met = -1;
        if (node < 0) continue;
        memcpy(target, tree->bends + node * links, sizeof(double) * (size_t)links);
        do met = extended(s, other, target, range, &reached, motions);
        while (met >= 0 && !reached);
        if (met < 0) continue;
        long first = turn % 2 == 0 ? node : met, second = turn % 2 == 0 ? met : node, before = 0;
        for (long k = first; k >= 0; k = trees[0].parents[k]) ++before;
        long at = before;
        for (long k = first; k >= 0; k = trees[0].parents[k])
            if (--at < most) memcpy(way + at * links, trees[0].bends + k * links, sizeof(double) * (size_t)links);
        found = before;
        for (long k = second; k >= 0; k = trees[1].parents[k], ++found)
            if (found < most) memcpy(way + found * links, trees[1].bends + k * links, sizeof(double) * (size_t)links);
    }
    *used = now() - begun;
    for (int k = 0; k < 2; ++k) {
        free(trees[k].bends);
        free(trees[k].parents);
    }
    return found;
}
