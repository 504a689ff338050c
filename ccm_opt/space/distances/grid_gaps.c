/* How near the surfaces of a scene the middles of the cells of a grid are. */

#include "surface_walk.h"

#define BLOCK 8 /* cells along a side of what is looked at as a whole first */

typedef struct {
    Surfaces surfaces;
    int64_t counts[3];
    double low[3], cell, reach; /* the first is the middle of the first cell */
    double *gap;                /* (nx, ny, nz) */
} GridQuery;

static inline int64_t smaller_count(int64_t a, int64_t b) { return a < b ? a : b; }

static Found at_point(const GridQuery *q, const double *point, double reach, int64_t hint)
{
    Segment segment = {{point[0], point[1], point[2]}, {0.0, 0.0, 0.0}, 0.0};
    double least;
    return nearest_face(&q->surfaces, &segment, reach, 0.0, hint, &least);
}

/* The cells of a block, each with what was nearest to the one before as a hint. */
static void fill_block(const GridQuery *q, const int64_t *from, const int64_t *to, int64_t hint)
{
    double point[3];
    for (int64_t x = from[0]; x < to[0]; x++)
        for (int64_t y = from[1]; y < to[1]; y++)
            for (int64_t z = from[2]; z < to[2]; z++) {
                int64_t cell[3] = {x, y, z};
                for (int d = 0; d < 3; d++) point[d] = q->low[d] + q->cell * (double)cell[d];
                Found found = at_point(q, point, q->reach, hint);
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
                Found found = at_point(q, middle, q->reach + sqrt(half), -1);
                if (found.face < 0)
                    skip_block(q, from, to);
                else
                    fill_block(q, from, to, found.face);
            }
}
