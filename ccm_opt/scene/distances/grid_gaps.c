/* How near the surfaces of a scene the middles of the cells of a grid are. */

#include "surface_walk.h"

#define BLOCK 4       /* cells along a side of what is looked at as a whole first */
#define MOST_NODES 16 /* that are kept for the cells of a block, which then need not begin at the root */
#define ROUNDING 1e-9 /* share of a distance that is granted to rounding */

typedef struct {
    Surfaces surfaces;
    int64_t counts[3];
    double low[3], cell, reach; /* the first is the middle of the first cell */
    double *gap;                /* (nx, ny, nz) */
} GridQuery;

static inline int64_t smaller_count(int64_t a, int64_t b) { return a < b ? a : b; }

/* What may hold the nearest triangle of some cell of a block. */
typedef struct {
    int64_t nodes[MOST_NODES];
    int count;
} Near;

static Segment at_point(const double *point)
{
    Segment segment = {{point[0], point[1], point[2]}, {0.0, 0.0, 0.0}, 0.0};
    return segment;
}

/* Nodes nearer to a point than a limit, so deep in the tree as there is place for them. */
static void find_near(const Surfaces *surfaces, const Probe *probe, double limit, Near *near)
{
    near->nodes[0] = 0;
    near->count = 1;
    for (int k = 0; k < near->count;) {
        const Node *node = surfaces->nodes + near->nodes[k];
        if (least_gap(probe, node, limit) >= limit) {
            near->nodes[k] = near->nodes[--near->count];
        } else if (node->count == 0 && near->count < MOST_NODES) {
            near->nodes[k] = node->first;
            near->nodes[near->count++] = node->first + 1;
        } else {
            k++;
        }
    }
}

/* The cells of a block, each with what was nearest to the one before as a hint. */
static void fill_block(const GridQuery *q, const int64_t *from, const int64_t *to, const Near *near, int64_t hint)
{
    double point[3], least = q->reach;
    for (int64_t x = from[0]; x < to[0]; x++)
        for (int64_t y = from[1]; y < to[1]; y++)
            for (int64_t z = from[2]; z < to[2]; z++) {
                int64_t cell[3] = {x, y, z};
                for (int d = 0; d < 3; d++) point[d] = q->low[d] + q->cell * (double)cell[d];
                Segment segment = at_point(point);
                Probe probe = probe_of(&segment);
                Found found = {q->reach, {0.0, 0.0, {0.0, 0.0, 0.0}}, -1};
                look_at(&q->surfaces, &segment, hint, &found);
                for (int k = 0; k < near->count; k++)
                    look_below(&q->surfaces, &segment, &probe, near->nodes[k], q->reach, 0.0, &found, &least);
                q->gap[(x * q->counts[1] + y) * q->counts[2] + z] = found.gap;
                hint = found.face >= 0 ? found.face : hint;
            }
}

static void skip_block(const GridQuery *q, const int64_t *from, const int64_t *to)
{
    for (int64_t x = from[0]; x < to[0]; x++)
        for (int64_t y = from[1]; y < to[1]; y++)
            for (int64_t z = from[2]; z < to[2]; z++) q->gap[(x * q->counts[1] + y) * q->counts[2] + z] = q->reach;
}

/* A triangle that is nearest to some cell is farther from the middle than the nearest one by a diagonal at most. */
static void fill_or_skip(const GridQuery *q, const int64_t *from, const int64_t *to, const double *middle, double half)
{
    Segment segment = at_point(middle);
    double reach = q->reach + half, least;
    Found found = nearest_face(&q->surfaces, &segment, reach, 0.0, &least);
    if (found.face < 0) {
        skip_block(q, from, to);
        return;
    }
    Probe probe = probe_of(&segment);
    Near near;
    double limit = smaller(found.gap + 2.0 * half, reach);
    find_near(&q->surfaces, &probe, limit + ROUNDING * (fabs(limit) + half), &near);
    fill_block(q, from, to, &near, found.face);
}

PUBLIC void grid_gaps(GridQuery *q)
{
    int64_t from[3], to[3];
    for (from[0] = 0; from[0] < q->counts[0]; from[0] += BLOCK)
        for (from[1] = 0; from[1] < q->counts[1]; from[1] += BLOCK)
            for (from[2] = 0; from[2] < q->counts[2]; from[2] += BLOCK) {
                double middle[3], half = 0.0;
                for (int d = 0; d < 3; d++) {
                    to[d] = smaller_count(from[d] + BLOCK, q->counts[d]);
                    middle[d] = q->low[d] + 0.5 * q->cell * (double)(from[d] + to[d] - 1);
                    half += 0.25 * q->cell * q->cell * (double)((to[d] - 1 - from[d]) * (to[d] - 1 - from[d]));
                }
                fill_or_skip(q, from, to, middle, sqrt(half));
            }
}
