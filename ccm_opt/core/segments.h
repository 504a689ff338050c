/* Distances and crossings of segments in the plane.

   Differences of given coordinates and products of these are correct to a relative 2⁻⁵³ each. So a side can only be
   taken for the other where the point is within some 2⁻⁵¹ of their distance from the line, and a crossing that is missed
   shows as a distance of that size. */

#ifndef SEGMENTS_H
#define SEGMENTS_H

#include "native.h"

static inline double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1]; }

/* Twice the signed area of a triangle: positive where b lies to the left of oa. */
static inline double cross(const double *o, const double *a, const double *b)
{
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
}

/* The shortest vector from a point to a segment; returns its squared length. */
static inline double to_segment(const double *p, const double *a, const double *b, double *line)
{
    double d[2] = {b[0] - a[0], b[1] - a[1]}, from[2] = {p[0] - a[0], p[1] - a[1]};
    double square = dot(d, d);
    double at = square > 0.0 ? fmin(fmax(dot(from, d) / square, 0.0), 1.0) : 0.0;
    line[0] = at * d[0] - from[0];
    line[1] = at * d[1] - from[1];
    return dot(line, line);
}

static inline int crosses(const double *a, const double *b, const double *c, const double *d)
{
    double at_c = cross(a, b, c), at_d = cross(a, b, d), at_a = cross(c, d, a), at_b = cross(c, d, b);
    return ((at_c > 0.0) != (at_d > 0.0)) && ((at_a > 0.0) != (at_b > 0.0));
}

/* The shortest vector from one segment to another; returns its squared length. */
static inline double between(const double *a, const double *b, const double *c, const double *d, double *line)
{
    double best = 0.0, other[2];
    line[0] = line[1] = 0.0;
    if (crosses(a, b, c, d)) return best;
    best = to_segment(a, c, d, line);
    for (int k = 0; k < 3; k++) {
        /* From b to the second, then from its ends to the first, turned round. */
        double square = k == 0 ? to_segment(b, c, d, other) : to_segment(k == 1 ? c : d, a, b, other);
        if (square >= best) continue;
        best = square;
        line[0] = k == 0 ? other[0] : -other[0];
        line[1] = k == 0 ? other[1] : -other[1];
    }
    return best;
}

#endif
