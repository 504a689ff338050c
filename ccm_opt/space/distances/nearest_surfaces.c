/* How near segments are to the surfaces of a scene, and where. */

#include "faces.h"

typedef struct {
    Surfaces surfaces;
    int64_t count;
    const double *segments; /* (k, 2, 3) */
    double reach;
    double *gap, *share, *point, *normal; /* (k,), (k,), (k, 3), (k, 3); the last three may be missing */
    int64_t *face;                        /* (k,) place among the leaves' triangles, or -1 */
} NearestQuery;

static Found nearest_face(const Surfaces *surfaces, const Segment *segment, double reach)
{
    Found found = {reach, {0.0, 0.0, {0.0, 0.0, 0.0}}, -1};
    Probe probe = probe_of(segment);
    int64_t waiting[DEEPEST];
    double bounds[DEEPEST];
    int top = 0;
    bounds[0] = least_gap(&probe, surfaces->nodes, reach);
    waiting[top++] = 0;
    while (top) {
        top--;
        if (bounds[top] >= found.gap) continue;
        const Node *node = surfaces->nodes + waiting[top];
        if (node->count) {
            for (int64_t face = node->first; face < node->first + node->count; face++)
                look_at(surfaces, segment, face, &found);
            continue;
        }
        double one = least_gap(&probe, surfaces->nodes + node->first, found.gap);
        double other = least_gap(&probe, surfaces->nodes + node->first + 1, found.gap);
        /* The nearer child is walked first, so it is put on top. */
        int nearer = other < one;
        for (int k = 0; k < 2; k++) {
            int child = k == 0 ? 1 - nearer : nearer;
            double bound = child ? other : one;
            if (bound >= found.gap) continue;
            bounds[top] = bound;
            waiting[top++] = node->first + child;
        }
    }
    return found;
}

PUBLIC void nearest_surfaces(NearestQuery *q)
{
    for (int64_t k = 0; k < q->count; k++) {
        Segment segment = segment_between(q->segments + 6 * k);
        Found found = nearest_face(&q->surfaces, &segment, q->reach);
        if (!isfinite(segment.square + dot(segment.start, segment.start))) found.gap = NAN;
        q->gap[k] = found.gap;
        if (!q->face) continue;
        q->face[k] = found.face;
        q->share[k] = found.pair.share;
        if (found.face >= 0) witness(&q->surfaces, &segment, &found, q->point + 3 * k, q->normal + 3 * k);
    }
}
