/* How near segments are to the surfaces of a scene, and where. */

#include "surface_walk.h"

typedef struct {
    Surfaces surfaces;
    int64_t count;
    const double *segments; /* (k, 2, 3) */
    double reach, slack; /* the last is by how much distances may be told less than they are */
    double *gap, *share, *point, *normal; /* (k,), (k,), (k, 3), (k, 3); the last three may be missing */
    int64_t *face;                        /* (k,) place among the leaves' triangles, or -1 */
} NearestQuery;

PUBLIC void nearest_surfaces(NearestQuery *q)
{
    for (int64_t k = 0; k < q->count; k++) {
        Segment segment = segment_between(q->segments + 6 * k);
        double least;
        Found found = nearest_face(&q->surfaces, &segment, q->reach, q->slack, &least);
        if (!isfinite(segment.square + dot(segment.start, segment.start))) found.gap = least = NAN;
        q->gap[k] = q->face ? found.gap : least;
        if (!q->face) continue;
        q->face[k] = found.face;
        q->share[k] = found.pair.share;
        if (found.face >= 0) witness(&q->surfaces, &segment, &found, q->point + 3 * k, q->normal + 3 * k);
    }
}

/* The same of one segment, for other libraries of the package: no number where the segment is none. */
PUBLIC double segment_gap(const Surfaces *surfaces, const double *ends, double reach, double slack)
{
    Segment segment = segment_between(ends);
    double least;
    if (!isfinite(segment.square + dot(segment.start, segment.start))) return NAN;
    nearest_face(surfaces, &segment, reach, slack, &least);
    return least;
}
