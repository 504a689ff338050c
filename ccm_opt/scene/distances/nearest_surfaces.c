/* How near segments are to the surfaces of a scene, and where. */

#include "surface_walk.h"

/* How much farther than the nearest a row is looked at, as a share of the reach. */
#ifndef AHEAD
#define AHEAD 0.05
#endif

typedef struct {
    Surfaces surfaces;
    int64_t count, together; /* of so many segments in a row only the nearest matters */
    const double *segments;  /* (k, 2, 3) */
    double reach, slack; /* the last is by how much distances may be told less than they are */
    double *gap, *share, *point, *normal; /* (k,), (k,), (k, 3), (k, 3); the last three may be missing */
    int64_t *face;                        /* (k,) place among the leaves' triangles, or -1 */
    double *known; /* (together,) of a row, less than which no gap is; may be missing where each is looked at alone */
} NearestQuery;

/* The nearest surface of one segment, which is known where nothing is nearer than a reach. */
static Found answer(NearestQuery *q, int64_t k, double reach)
{
    Segment segment = segment_between(q->segments + 6 * k);
    double least;
    Found found = nearest_face(&q->surfaces, &segment, reach, q->slack, &least);
    if (found.face < 0) found.gap = least = q->reach;
    if (!isfinite(segment.square + dot(segment.start, segment.start))) found.gap = least = NAN;
    q->gap[k] = q->face ? found.gap : least;
    if (!q->face) return found;
    q->face[k] = found.face;
    q->share[k] = found.pair.share;
    if (found.face >= 0) witness(&q->surfaces, &segment, &found, q->point + 3 * k, q->normal + 3 * k);
    return found;
}

/* By how much the gap of a segment may have changed since the row before: no more than its ends have moved. */
static double moved(const NearestQuery *q, int64_t k)
{
    const double *now = q->segments + 6 * k, *before = now - 6 * q->together;
    double square = 0.0;
    for (int end = 0; end < 6; end += 3) {
        double way[3] = {now[end] - before[end], now[end + 1] - before[end + 1], now[end + 2] - before[end + 2]};
        square = fmax(square, dot(way, way));
    }
    return (1.0 + 1e-9) * sqrt(square);
}

PUBLIC void nearest_surfaces(NearestQuery *q)
{
    if (q->together <= 1) {
        for (int64_t k = 0; k < q->count; k++) answer(q, k, q->reach);
        return;
    }
    int64_t likely = 0; /* the nearest of the row before, by its place in the row, and its gap */
    double nearest = INFINITY;
    for (int64_t row = 0; row < q->count; row += q->together) {
        /* Nothing farther is looked at than the nearest of the row before can be now. */
        double most = row ? nearest + moved(q, row + likely) + 1e-12 * fabs(nearest) + 1e-300 : q->reach;
        double reach = most < q->reach ? most : q->reach;
        nearest = INFINITY;
        for (int64_t k = 0; k < q->together; k++) {
            q->known[k] = row ? q->known[k] - moved(q, row + k) : -INFINITY;
            if (q->known[k] >= reach) {
                q->gap[row + k] = q->reach;
                q->face[row + k] = -1;
                continue;
            }
            /* Looked at a little farther, a segment need not be looked at again in each of the next rows. */
            double wide = reach + AHEAD * q->reach < q->reach ? reach + AHEAD * q->reach : q->reach;
            Found found = answer(q, row + k, wide);
            q->known[k] = found.face < 0 ? wide : found.gap;
            if (found.face < 0 || found.gap >= reach) continue;
            reach = nearest = found.gap;
            likely = k;
        }
    }
}

/* The same of one segment, for interval_proof.c: no number where the segment is none. */
double segment_gap(const Surfaces *surfaces, const double *ends, double reach, double slack)
{
    Segment segment = segment_between(ends);
    double least;
    if (!isfinite(segment.square + dot(segment.start, segment.start))) return NAN;
    nearest_face(surfaces, &segment, reach, slack, &least);
    return least;
}
