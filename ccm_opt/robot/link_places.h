/* Where the links of an arm of universal joints are, how far they move while its joints turn evenly, and how near two
   links are to each other. */

#ifndef LINK_PLACES_H
#define LINK_PLACES_H

#include "vectors.h"

/* Joints and tip, (links + 1, 3), and rotations of the links, (links, 3, 3), from two bends a joint and then the feed,
   which carries the start along the base's direction where the arm is fed. */
static inline void place_links(int64_t links, const double *lengths, int64_t fed, const double *start,
                               const double *base, const double *bends, double *points, double *rotations)
{
    for (int d = 0; d < 3; d++) points[d] = start[d] + (fed ? base[3 * d] * bends[2 * links] : 0.0);
    for (int64_t j = 0; j < links; j++) {
        const double *before = j ? rotations + 9 * (j - 1) : base;
        double *after = rotations + 9 * j;
        double ca = cos(bends[2 * j]), sa = sin(bends[2 * j]), cb = cos(bends[2 * j + 1]), sb = sin(bends[2 * j + 1]);
        for (int d = 0; d < 3; d++) {
            double x = before[3 * d], y = before[3 * d + 1], z = before[3 * d + 2], along = ca * x + sa * y;
            after[3 * d] = cb * along - sb * z;
            after[3 * d + 1] = ca * y - sa * x;
            after[3 * d + 2] = sb * along + cb * z;
            points[3 * (j + 1) + d] = points[3 * j + d] + lengths[j] * after[3 * d];
        }
    }
}

/* Bounds on the rates of turning of the links, (links,), and on the second derivatives of joints and tip, (links + 1,),
   from the rotations in the middle of the interval and the turns of the joints over it. Axes of a joint: z of the link
   before it, and y of that after the turn about z, which is y of the link after it. */
static inline void bound_motion(int64_t links, const double *lengths, const double *base,
                                const double *rotations, const double *turns, double *speed, double *bow)
{
    double rate[3] = {0.0, 0.0, 0.0}, drift = 0.0, before = 0.0;
    bow[0] = 0.0;
    for (int64_t j = 0; j < links; j++) {
        const double *frame = j ? rotations + 9 * (j - 1) : base;
        const double *after = rotations + 9 * j;
        double da = turns[2 * j], db = turns[2 * j + 1];
        for (int d = 0; d < 3; d++) rate[d] += da * frame[3 * d + 2] + db * after[3 * d + 1];
        drift += before * hypot(da, db) + fabs(da * db);
        double norm = sqrt(rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2]);
        double most = norm + 0.5 * drift;
        speed[j] = most;
        bow[j + 1] = bow[j] + lengths[j] * (most * most + drift);
        before = most;
    }
}

/* Squared distance of the points at shares s and t of two segments p + s u and r + t w. */
static inline double at(const double *p, const double *u, const double *r, const double *w, double s, double t)
{
    double sum = 0.0;
    for (int d = 0; d < 3; d++) {
        double x = p[d] + s * u[d] - r[d] - t * w[d];
        sum += x * x;
    }
    return sum;
}

/* The nearest points of two segments: the best of the inner one, if there is one, and of the four ends. */
static inline double segments(const double *p, const double *u, const double *r, const double *w, double *s, double *t)
{
    double from[3] = {p[0] - r[0], p[1] - r[1], p[2] - r[2]};
    double uu = dot(u, u), uw = dot(u, w), ww = dot(w, w), pu = dot(from, u), pw = dot(from, w);
    double best = INFINITY;
    double shares[5][2];
    int count = 0;
    double det = uu * ww - uw * uw;
    if (det > 1e-14 * uu * ww) {
        double a = (uw * pw - ww * pu) / det, b = (uu * pw - uw * pu) / det;
        if (a > 0.0 && a < 1.0 && b > 0.0 && b < 1.0) {
            shares[count][0] = a;
            shares[count++][1] = b;
        }
    }
    double none = 1e-300;
    shares[count][0] = 0.0, shares[count++][1] = clamped(pw / fmax(ww, none));
    shares[count][0] = 1.0, shares[count++][1] = clamped((pw + uw) / fmax(ww, none));
    shares[count][0] = clamped(-pu / fmax(uu, none)), shares[count++][1] = 0.0;
    shares[count][0] = clamped((uw - pu) / fmax(uu, none)), shares[count++][1] = 1.0;
    for (int k = 0; k < count; k++) {
        double square = at(p, u, r, w, shares[k][0], shares[k][1]);
        if (square >= best) continue;
        best = square;
        *s = shares[k][0];
        *t = shares[k][1];
    }
    return sqrt(best);
}

/* The length of the longest link. */
static inline double longest_link(const double *points, int64_t links)
{
    double most = 0.0;
    for (int64_t j = 0; j < links; j++) {
        const double *p = points + 3 * j;
        double u[3] = {p[3] - p[0], p[4] - p[1], p[5] - p[2]};
        most = fmax(most, dot(u, u));
    }
    return sqrt(most);
}

/* The next second link, from link j on, that must not touch link i and whose nearest point may be within a reach of it:
   no link is longer than the longest, so that one whose start is farther off than the reach and twice that is too far,
   and those that follow start at most that much farther on. */
static inline int64_t next_in_reach(const double *points, int64_t links, const int32_t *next_pair, int64_t i, int64_t j,
                                    double reach, double longest)
{
    const double *p = points + 3 * i;
    const int32_t *next = next_pair + i * (links + 1);
    for (j = next[j]; j < links; j = next[j + 1]) {
        const double *r = points + 3 * j;
        double apart[3] = {r[0] - p[0], r[1] - p[1], r[2] - p[2]};
        double square = dot(apart, apart), most = reach + 2.0 * longest;
        if (square <= most * most) return j;
        j += whole_within((sqrt(square) - most) / fmax(longest, 1e-300) - 1.0, 0, links - 1 - j);
    }
    return links;
}

/* Distance of the axes of links i and j; s and t are where they are nearest. */
static inline double links_apart(const double *points, int64_t i, int64_t j, double *s, double *t)
{
    const double *p = points + 3 * i, *r = points + 3 * j;
    double u[3] = {p[3] - p[0], p[4] - p[1], p[5] - p[2]};
    double w[3] = {r[3] - r[0], r[4] - r[1], r[5] - r[2]};
    return segments(p, u, r, w, s, t);
}

#endif
