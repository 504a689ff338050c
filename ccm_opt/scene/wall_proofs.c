/* Which links are not proved clear of walls over stretches of a motion: wall_proofs.py in C.

   A link stays in the hull of its four end positions, grown by the sag. What rounding takes, proof_rounding.py, is part
   of every distance that is asked for here, so that nothing is rounded to the safe side anew. What is no number is never
   proved. */

#include "native.h"
#include "box_tree.h"
#include "segments.h"

typedef struct {
    int64_t stretches, links, mount_link; /* links before the last may touch */
    double mount_share;                   /* of that link, which may touch too */
    const double *least;                  /* distance of axes from walls in contact, (links,) */
    const double *start, *end, *middle;   /* joints, (stretches, links + 1, 2) */
    const double *sag;                    /* (stretches, links) */

    Tree tree;              /* over the segments */
    const double *segments; /* of the walls' cores, (E, 2, 2) */
    const double *rounding; /* (E,) */
    double largest_rounding;
    Tree solids;                                  /* over the cores that have an inside */
    const int64_t *first_segment, *past_segments; /* of each of them, (solids,) */

    int64_t asked; /* links to look at; -1 for all */
    const int64_t *asked_stretch, *asked_link;

    int64_t count; /* there is room for as many results as there may be */
    int64_t *stretch, *link;
    uint8_t *touching;
} Proofs;

/* Both ends of a link, without what belongs to the mount. */
static void ends_of(const Proofs *q, const double *joints, int64_t stretch, int64_t link, double *ends)
{
    const double *p = joints + 2 * (stretch * (q->links + 1) + link);
    double share = link == q->mount_link ? q->mount_share : 0.0;
    for (int d = 0; d < 2; d++) {
        ends[d] = p[d] + share * (p[2 + d] - p[d]);
        ends[2 + d] = p[2 + d];
    }
}

static void box_about(const double *points, int count, double grow, double *box)
{
    for (int d = 0; d < 2; d++) {
        double low = points[d], high = points[d];
        for (int k = 1; k < count; k++) {
            low = fmin(low, points[2 * k + d]);
            high = fmax(high, points[2 * k + d]);
        }
        box[d] = low - grow;
        box[2 + d] = high + grow;
    }
}

/* Whether a segment lies beyond a distance on one side of its own line; four products settle most of them. */
static int to_one_side(const double *corners, const double *segment, double distance)
{
    double low = INFINITY, high = -INFINITY;
    for (int k = 0; k < 4; k++) {
        double side = cross(segment, segment + 2, corners + 2 * k);
        low = fmin(low, side);
        high = fmax(high, side);
    }
    double away = distance * hypot(segment[2] - segment[0], segment[3] - segment[1]);
    return low > away || high < -away;
}

static int strictly_within(const double *a, const double *b, const double *c, const double *p)
{
    double one = cross(a, b, p), two = cross(b, c, p), three = cross(c, a, p);
    return (one > 0.0 && two > 0.0 && three > 0.0) || (one < 0.0 && two < 0.0 && three < 0.0);
}

/* Whether the hull of four corners is farther from a segment than a distance.

   The hull is the union of its corners' four triangles: with all six lines between corners nothing depends on which of
   them are its sides. */
static int hull_apart(const double *corners, const double *segment, double distance)
{
    static const int line[6][2] = {{0, 1}, {2, 3}, {0, 2}, {1, 3}, {0, 3}, {1, 2}};
    static const int triangle[4][3] = {{0, 1, 2}, {0, 1, 3}, {0, 2, 3}, {1, 2, 3}};
    double unused[2], nearest = INFINITY;
    if (to_one_side(corners, segment, distance)) return 1;
    for (int k = 0; k < 6; k++)
        if (crosses(corners + 2 * line[k][0], corners + 2 * line[k][1], segment, segment + 2)) return 0;
    for (int k = 0; k < 4; k++) {
        const double *a = corners + 2 * triangle[k][0], *b = corners + 2 * triangle[k][1];
        if (strictly_within(a, b, corners + 2 * triangle[k][2], segment)) return 0;
        nearest = fmin(nearest, to_segment(corners + 2 * k, segment, segment + 2, unused));
    }
    for (int k = 0; k < 6; k++)
        for (int end = 0; end < 4; end += 2) {
            const double *a = corners + 2 * line[k][0], *b = corners + 2 * line[k][1];
            nearest = fmin(nearest, to_segment(segment + end, a, b, unused));
        }
    return sqrt(nearest) > distance;
}

/* Whether a point that is on no edge lies in a solid, by the parity of the edges that a ray from it crosses. */
static int in_solid(const Proofs *q, const double *p)
{
    double box[4] = {p[0], p[1], p[0], p[1]};
    Walk walk;
    begin_walk(&walk, &q->solids, box);
    for (int64_t solid = next_item(&walk); solid >= 0; solid = next_item(&walk)) {
        int inside = 0;
        for (int64_t k = q->first_segment[solid]; k < q->past_segments[solid]; k++) {
            const double *a = q->segments + 4 * k, *b = a + 2;
            if ((a[1] > p[1]) == (b[1] > p[1])) continue;
            /* The ray goes to the right: it meets an upward edge that has p on its left, a downward one on its right. */
            if ((cross(a, b, p) > 0.0) == (b[1] > a[1])) inside = !inside;
        }
        if (inside) return 1;
    }
    return 0;
}

/* Whether a link half-way touches a wall, so that no bisection can help. */
static int touches(const Proofs *q, int64_t stretch, int64_t link)
{
    double ends[4], box[4], unused[2];
    ends_of(q, q->middle, stretch, link, ends);
    box_about(ends, 2, q->least[link] + q->largest_rounding, box);
    Walk walk;
    begin_walk(&walk, &q->tree, box);
    for (int64_t k = next_item(&walk); k >= 0; k = next_item(&walk)) {
        const double *segment = q->segments + 4 * k;
        double square = between(ends, ends + 2, segment, segment + 2, unused);
        if (!(sqrt(square) > q->least[link] + q->rounding[k])) return 1;
    }
    return in_solid(q, ends);
}

/* Whether a link is proved clear; ``outside``: it is known to have a point outside of all solids. */
static int clear(const Proofs *q, int64_t stretch, int64_t link, int outside)
{
    double corners[8], box[4];
    double need = q->least[link] + q->sag[stretch * q->links + link];
    ends_of(q, q->start, stretch, link, corners);
    ends_of(q, q->end, stretch, link, corners + 4);
    box_about(corners, 4, need + q->largest_rounding, box);
    if (!isfinite(box[0] + box[1] + box[2] + box[3])) return 0;
    Walk walk;
    begin_walk(&walk, &q->tree, box);
    for (int64_t k = next_item(&walk); k >= 0; k = next_item(&walk))
        if (!hull_apart(corners, q->segments + 4 * k, need + q->rounding[k])) return 0;
    /* A hull that is apart from every edge is either inside or outside as a whole. */
    return outside || !in_solid(q, corners);
}

/* Look at one link; ``outside`` as above. Returns whether it is clear. */
static int look_at(Proofs *q, int64_t stretch, int64_t link, int outside)
{
    if (q->least[link] < 0.0) return 0; /* a link without a body proves nothing of the next */
    if (clear(q, stretch, link, outside)) return 1;
    int64_t k = q->count++;
    q->stretch[k] = stretch;
    q->link[k] = link;
    q->touching[k] = touches(q, stretch, link) != 0;
    return 0;
}

PUBLIC void wall_proofs(Proofs *q)
{
    q->count = 0;
    /* Neighbouring links share a joint: where one is clear of all solids, so is that point of the next. */
    int outside = 0;
    if (q->asked < 0)
        for (int64_t stretch = 0; stretch < q->stretches; stretch++) {
            outside = 0;
            for (int64_t link = q->mount_link; link < q->links; link++) outside = look_at(q, stretch, link, outside);
        }
    for (int64_t k = 0; k < q->asked; k++) {
        int64_t stretch = q->asked_stretch[k], link = q->asked_link[k];
        int follows = k && q->asked_stretch[k - 1] == stretch && q->asked_link[k - 1] == link - 1;
        outside = look_at(q, stretch, link, outside && follows);
    }
}
