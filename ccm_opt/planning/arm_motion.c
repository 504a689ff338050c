/* How far the points of an arm of universal joints move while its joints turn evenly, and how near its links are to each
   other. space_link_motion.py says what is computed. */

#include "link_places.h"

typedef struct {
    int64_t links;
    const double *lengths, *arcs; /* of the links, (links,); arcs as in link_places.h */
    const double *bends;     /* coordinates in the middle of the interval, (2 links + count,) */
    const double *rotations; /* of the links in the middle of the interval, (links, 3, 3) */
    const double *turns;     /* changes of the coordinates over the interval, (2 links + count,) */
    Carrier carrier;
    double *speed;          /* out: bounds on the rates of turning of the links, (links,) */
    double *bow;            /* out: bounds on the second derivatives of joints and tip, (links + 1,) */
} MotionQuery;

PUBLIC void motion_bounds(MotionQuery *q)
{
    bound_motion(q->links, q->lengths, q->arcs, &q->carrier, q->bends, q->rotations, q->turns, q->speed, q->bow);
}

typedef struct {
    int64_t links;
    const int32_t *next_pair;  /* the first link from j on that must not touch i, (links, links + 1) */
    double reach;              /* nearer pairs than this are reported */
    const double *points;      /* joints and tip, (links + 1, 3) */
    int64_t capacity, count;   /* the count may exceed the capacity, and is then needed */
    int64_t *first, *second;   /* out, (capacity,) */
    double *first_at, *second_at, *distance; /* out: places on the links as shares, and distances of the axes */
    double *normal;            /* out: unit vectors from the second to the first, (capacity, 3) */
} PairQuery;

PUBLIC void near_links(PairQuery *q)
{
    q->count = 0;
    double longest = longest_link(q->points, q->links);
    for (int64_t i = 0; i < q->links; i++) {
        const double *p = q->points + 3 * i;
        double u[3] = {p[3] - p[0], p[4] - p[1], p[5] - p[2]}, s = 0.0, t = 0.0;
        int64_t j = next_in_reach(q->points, q->links, q->next_pair, i, 0, q->reach, longest);
        for (; j < q->links; j = next_in_reach(q->points, q->links, q->next_pair, i, j + 1, q->reach, longest)) {
            double distance = links_apart(q->points, i, j, &s, &t);
            if (distance >= q->reach) continue;
            int64_t k = q->count++;
            if (k >= q->capacity) continue;
            const double *r = q->points + 3 * j;
            q->first[k] = i;
            q->second[k] = j;
            q->first_at[k] = s;
            q->second_at[k] = t;
            q->distance[k] = distance;
            for (int d = 0; d < 3; d++)
                q->normal[3 * k + d] = (p[d] + s * u[d] - r[d] - t * (r[3 + d] - r[d])) / fmax(distance, 1e-12);
        }
    }
}

typedef struct {
    int64_t links, poses;
    const int32_t *next_pair; /* as above */
    double reach;            /* pairs with this gap or more are not reported */
    const double *radii;     /* (links,) */
    const double *points;    /* joints and tip, (poses, links + 1, 3) */
    int64_t *first, *second; /* out: of the nearest pair of each pose, or -1, (poses,) */
    double *gap;             /* out: of their surfaces, or the reach, (poses,) */
} NearestPairQuery;

PUBLIC void nearest_links(NearestPairQuery *q)
{
    for (int64_t pose = 0; pose < q->poses; pose++) {
        const double *points = q->points + 3 * (q->links + 1) * pose;
        double least = q->reach, longest = longest_link(points, q->links), thickest = 0.0, s, t;
        for (int64_t j = 0; j < q->links; j++) thickest = fmax(thickest, q->radii[j]);
        q->first[pose] = q->second[pose] = -1;
        for (int64_t i = 0; i < q->links; i++) {
            double near = least + q->radii[i] + thickest;
            int64_t j = next_in_reach(points, q->links, q->next_pair, i, 0, near, longest);
            for (; j < q->links; j = next_in_reach(points, q->links, q->next_pair, i, j + 1, near, longest)) {
                double gap = links_apart(points, i, j, &s, &t) - (q->radii[i] + q->radii[j]);
                if (gap >= least) continue;
                least = gap;
                near = least + q->radii[i] + thickest;
                q->first[pose] = i;
                q->second[pose] = j;
            }
        }
        q->gap[pose] = least;
    }
}

typedef struct {
    int64_t joints, links, knots; /* joints: of one pose after another */
    double spacing;         /* of the knots, the first of which is at 0 */
    const double *places;   /* arc lengths of the joints, (joints,) */
    const double *lengths;  /* of the links, (links,) */
    double *shapes;         /* out: turns by a unit of curvature at each knot, (joints, knots) */
} ShapeQuery;

static inline double ramp(double x) { return x > 0.0 ? x * x * x : 0.0; }

static inline double square(double x) { return x > 0.0 ? x * x : 0.0; }

/* Six times the twice integrated hat of a knot, at so many spacings beyond the first knot. */
static double hat(double top, int64_t knot, int64_t knots)
{
    if (knot == 0) return 3.0 * square(top) - ramp(top) + ramp(top - 1.0);
    double x = top - (double)knot;
    if (knot == knots - 1) return ramp(x + 1.0) - ramp(x) - 3.0 * square(x);
    return ramp(x + 1.0) - 2.0 * ramp(x) + ramp(x - 1.0);
}

PUBLIC void curve_shapes(ShapeQuery *q)
{
    for (int64_t j = 0; j < q->joints; j++) {
        double top = q->places[j] / q->spacing;
        int64_t link = j % q->links;
        double length = q->lengths[link], ratio = length / q->lengths[link ? link - 1 : 0];
        double scale = q->spacing * q->spacing / (6.0 * length);
        double behind = length / q->spacing, before = behind / ratio;
        for (int64_t k = 0; k < q->knots; k++) {
            /* A joint knows the curvature within a link of its place alone. */
            double x = top - (double)k, turn = 0.0;
            if (x > -1.0 - behind && x < 1.0 + before) {
                double far = hat(top + behind, k, q->knots), near = hat(top - before, k, q->knots);
                turn = scale * (far - (1.0 + ratio) * hat(top, k, q->knots) + ratio * near);
            }
            q->shapes[j * q->knots + k] = turn;
        }
    }
}
