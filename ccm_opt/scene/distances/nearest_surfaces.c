/* How near segments are to the surfaces of a scene, and where. */

#include "surface_walk.h"

/* How much farther than the nearest a row is looked at, as a share of the reach. */
#ifndef AHEAD
#define AHEAD 0.05
#endif

#define ROWS 8       /* poses of a moving chain whose segments are looked at together */
#define MOST_NEAR 16 /* boxes that may be near to a segment in some of them */
#define FARTHEST 4.0 /* how far a segment may move in them for that, in reaches */

typedef struct {
    Surfaces surfaces;
    int64_t count, together; /* of so many segments in a row only the nearest matters */
    const double *segments;  /* (k, 2, 3) */
    double reach, slack; /* the last is by how much distances may be told less than they are */
    double *gap, *share, *point, *normal; /* (k,), (k,), (k, 3), (k, 3); the last three may be missing */
    int64_t *face;                        /* (k,) place among the leaves' triangles, or -1 */
    int64_t row;   /* of a moving chain, of which all matter, so many segments are a row; 0 where each is for itself */
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

/* Boxes that hold all that is nearer to a segment than a reach; returns how many. */
static int64_t near_boxes(const Surfaces *surfaces, const Probe *probe, double reach, int64_t *boxes)
{
    int64_t count = least_gap(probe, surfaces->nodes, reach) < reach;
    boxes[0] = 0;
    for (int64_t k = 0; k < count;) {
        const Node *node = surfaces->nodes + boxes[k];
        int64_t near[2], found = 0;
        if (node->count == 0)
            for (int64_t child = node->first; child < node->first + 2; child++)
                if (least_gap(probe, surfaces->nodes + child, reach) < reach) near[found++] = child;
        if (node->count || count + found > MOST_NEAR + 1) {
            k++;
            continue;
        }
        boxes[k] = found ? near[0] : boxes[count - 1];
        if (found == 0) count--;
        if (found == 2) boxes[count++] = near[1];
    }
    return count;
}

/* The least gaps of the segments of a moving chain, so many a row, each as segment_gap tells it. What is far from a
   segment in several rows is passed by once for all of them. */
void gaps_of_rows(const Surfaces *surfaces, const double *segments, int64_t count, int64_t row, double reach,
                  double slack, double *gap)
{
    int64_t boxes[MOST_NEAR];
    for (int64_t first = 0; first < count; first += ROWS * row)
        for (int64_t link = first; link < first + row; link++) {
            int64_t rows = smaller((count - first) / row, ROWS), middle = link + rows / 2 * row;
            double most = 0.0;
            for (int64_t k = link; k < link + rows * row; k += row)
                most = larger(most, moved(segments + 6 * k, segments + 6 * middle));
            Segment segment = segment_between(segments + 6 * middle);
            Probe probe = probe_of(&segment);
            int64_t near = 1;
            boxes[0] = 0;
            if (most <= FARTHEST * reach) near = near_boxes(surfaces, &probe, reach + most, boxes);
            for (int64_t k = link; k < link + rows * row; k += row) {
                segment = segment_between(segments + 6 * k);
                probe = probe_of(&segment);
                Found found = {reach, {0.0, 0.0, {0.0, 0.0, 0.0}}, -1};
                double least = reach;
                for (int64_t box = 0; box < near; box++)
                    look_below(surfaces, &segment, &probe, boxes[box], reach, slack, &found, &least);
                least = smaller(least, found.gap);
                gap[k] = isfinite(segment.square + dot(segment.start, segment.start)) ? least : NAN;
            }
        }
}

static double moved_since(const NearestQuery *q, int64_t k)
{
    const double *now = q->segments + 6 * k;
    return moved(now, now - 6 * q->together);
}

PUBLIC void nearest_surfaces(NearestQuery *q)
{
    if (q->row) {
        gaps_of_rows(&q->surfaces, q->segments, q->count, q->row, q->reach, q->slack, q->gap);
        return;
    }
    if (q->together <= 1) {
        for (int64_t k = 0; k < q->count; k++) answer(q, k, q->reach);
        return;
    }
    int64_t likely = 0; /* the nearest of the row before, by its place in the row, and its gap */
    double nearest = INFINITY;
    for (int64_t row = 0; row < q->count; row += q->together) {
        /* Nothing farther is looked at than the nearest of the row before can be now. */
        double most = row ? nearest + moved_since(q, row + likely) + 1e-12 * fabs(nearest) + 1e-300 : q->reach;
        double reach = most < q->reach ? most : q->reach;
        nearest = INFINITY;
        for (int64_t k = 0; k < q->together; k++) {
            q->known[k] = row ? q->known[k] - moved_since(q, row + k) : -INFINITY;
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
