/* Two trees of links in space, one from where an arm begins and one back from its goal, that grow towards each other: a
   node is the end of a link with its direction, and a branch is a chain of links that touches nothing. */

#include "link_places.h"
#include "surface_walk.h"

#define MOST_ON 8       /* links by which a branch grows towards one target: heuristic */
#define BACKWARD (-0.3) /* cosine of the angle to a target above which a node may grow towards it: heuristic */
#define RIGHT_ANGLE 1.57079632679489662
#define ASIDE 0.3       /* share of the distance by which a target behind counts as farther: heuristic */

/* The parent of a root is -1. */
typedef struct {
    int64_t count, capacity, first;     /* nodes from this one on may have children */
    double *place, *ahead;              /* (capacity, 3): end and direction of a link */
    double *failed;                     /* (capacity,): how often no link could be added */
    int64_t *parents, *links;           /* (capacity,); the latter from the root on */
} LinkTree;

typedef struct {
    int64_t targets, first_pair, mounted; /* mounted: first links, which may touch surfaces */
    int64_t most, exact; /* links of a whole chain: at most, or exactly so many */
    double length, kept, pair, gap; /* kept, pair: that axes keep from surfaces, each other; gap: that a chain may have */
    double strays;                  /* price of a node whose chain is longer or shorter than is asked */
    Surfaces surfaces;
    const double *limits; /* (most,): of the bend before each link of the first tree; the last for the other tree */
    const double *target; /* (targets, 6): place, share of a chain there, whether on an arc, node of the other tree */
    LinkTree own, other;
    int64_t capacity, found;
    int64_t *met; /* (capacity, 2): nodes of both trees with the gap of a chain between them */
} LinkChains;

static int free_link(const LinkChains *q, const double *from, const double *line)
{
    if (q->surfaces.nodes == NULL) return 1;
    Segment segment;
    memcpy(segment.start, from, sizeof segment.start);
    memcpy(segment.line, line, sizeof segment.line);
    segment.square = dot(line, line);
    double least;
    return nearest_face(&q->surfaces, &segment, q->kept, 0.0, &least).face < 0;
}

/* Whether a link keeps away from those before its node. */
static int apart(const LinkChains *q, const LinkTree *tree, int64_t node, const double *from, const double *line)
{
    for (int64_t on = 1, other = node; tree->parents[other] >= 0; on++, other = tree->parents[other]) {
        if (on < q->first_pair) continue;
        const double *start = tree->place + 3 * tree->parents[other];
        double between[3], back[3], s, t, most = q->pair + 2.0 * q->length;
        minus(start, from, between);
        if (dot(between, between) > most * most) continue;
        minus(tree->place + 3 * other, start, back);
        if (segments(from, line, start, back, &s, &t) < q->pair) return 0;
    }
    return 1;
}

/* The largest bend before the next link. */
static double bend_before(const LinkChains *q, const LinkTree *tree, int64_t node)
{
    return q->limits[tree == &q->own ? tree->links[node] : q->most - 1];
}

/* The node that grows to a target. */
static int64_t chosen_node(const LinkChains *q, const LinkTree *tree, const double *target, double share)
{
    double best = INFINITY, tight = q->length / sin(0.5 * smaller(q->limits[q->most - 1], RIGHT_ANGLE));
    int64_t chosen = -1;
    for (int64_t node = tree->first; node < tree->count; node++) {
        if (tree->links[node] >= q->most) continue;
        double chord[3];
        minus(target, tree->place + 3 * node, chord);
        double square = dot(chord, chord), ahead = dot(chord, tree->ahead + 3 * node), away = sqrt(square);
        if (bend_before(q, tree, node) <= RIGHT_ANGLE) {
            if (ahead < BACKWARD * away) continue;
            /* Outside the tightest circles along the direction of the node. */
            double side = square - ahead * ahead;
            if (square * square < tight * tight * side) continue;
        }
        double cost = away + ASIDE * (away - ahead);
        if (q->strays > 0.0)
            cost += q->strays * fabs((double)tree->links[node] * q->length + cost - share * (double)q->most * q->length);
        cost *= 1.0 + tree->failed[node];
        if (cost < best) {
            best = cost;
            chosen = node;
        }
    }
    return chosen;
}

/* The direction of a link that bends by at most an angle from another towards a target. */
static void bent(const double *ahead, const double *chord, double most, double *direction)
{
    double along_it = dot(chord, ahead), side[3];
    along(chord, -along_it, ahead, side);
    double aside = sqrt(dot(side, side)), turn = smaller(atan2(aside, along_it), most);
    for (int d = 0; d < 3; d++) direction[d] = cos(turn) * ahead[d] + (aside > 0.0 ? sin(turn) / aside * side[d] : 0.0);
    double norm = sqrt(dot(direction, direction));
    for (int d = 0; d < 3; d++) direction[d] /= norm;
}

static int64_t add_link(LinkTree *tree, int64_t parent, const double *place, const double *ahead)
{
    int64_t node = tree->count++;
    memcpy(tree->place + 3 * node, place, 3 * sizeof *place);
    memcpy(tree->ahead + 3 * node, ahead, 3 * sizeof *ahead);
    tree->parents[node] = parent;
    tree->links[node] = tree->links[parent] + 1;
    tree->failed[node] = 0.0;
    return node;
}

/* Note the nearest node of the other tree that a node continues. */
static void meet(LinkChains *q, int64_t which, int64_t node)
{
    const LinkTree *tree = which ? &q->other : &q->own, *other = which ? &q->own : &q->other;
    double best = q->gap * q->gap, cosine = cos(smaller(q->limits[q->most - 1], 2.0 * RIGHT_ANGLE));
    int64_t met = -1;
    for (int64_t k = other->first; k < other->count; k++) {
        int64_t links = tree->links[node] + other->links[k];
        if (q->exact ? links != q->most : links > q->most) continue;
        double gap[3];
        minus(tree->place + 3 * node, other->place + 3 * k, gap);
        double square = dot(gap, gap);
        if (square >= best || -dot(tree->ahead + 3 * node, other->ahead + 3 * k) < cosine) continue;
        best = square;
        met = k;
    }
    if (met < 0 || q->found == q->capacity) return;
    q->met[2 * q->found + which] = node;
    q->met[2 * q->found + 1 - which] = met;
    q->found++;
}

static void grow_to(LinkChains *q, int64_t which, const double *target)
{
    LinkTree *tree = which ? &q->other : &q->own;
    const LinkTree *other = which ? &q->own : &q->other;
    double place[3];
    memcpy(place, target, sizeof place);
    if (target[5] >= 0.0)
        memcpy(place, other->place + 3 * whole_within(target[5] * (double)other->count, 0, other->count - 1), sizeof place);
    int64_t node = chosen_node(q, tree, place, target[3]);
    if (node < 0) return;
    for (int64_t on = 0; on < MOST_ON && tree->links[node] < q->most && tree->count < tree->capacity; on++) {
        double chord[3], direction[3], line[3], end[3];
        const double *from = tree->place + 3 * node, *ahead = tree->ahead + 3 * node;
        minus(place, from, chord);
        double away = sqrt(dot(chord, chord)), most = bend_before(q, tree, node);
        if (away < 0.5 * q->length) return;
        if (target[4] > 0.5) {
            double sine = sqrt(larger(1.0 - dot(chord, ahead) * dot(chord, ahead) / (away * away), 0.0));
            most = smaller(most, 2.0 * asin(smaller(sine * q->length / away, 1.0)));
        }
        bent(ahead, chord, most, direction);
        for (int d = 0; d < 3; d++) line[d] = q->length * direction[d];
        along(from, 1.0, line, end);
        int free_of_surfaces = (which == 0 && tree->links[node] < q->mounted) || free_link(q, from, line);
        if (!free_of_surfaces || !apart(q, tree, node, from, line)) {
            if (on == 0) tree->failed[node] += 1.0;
            return;
        }
        node = add_link(tree, node, end, direction);
        meet(q, which, node);
    }
}

PUBLIC void link_chains(LinkChains *q)
{
    q->found = 0;
    for (int64_t k = 0; k < q->targets && q->found < q->capacity; k++) grow_to(q, k % 2, q->target + 6 * k);
}
