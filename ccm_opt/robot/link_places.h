/* Where the links of an arm are, how far they move while its joints turn evenly, and how near two links are to each
   other. Joints are universal, R' = R Rz(a) Ry(b); or each is the vertex of two equal tangents of an arc, and turns by
   the rotation vector (0, b, a), so that links are the tangents of arcs of constant length and grow with the turns. */

#ifndef LINK_PLACES_H
#define LINK_PLACES_H

#include "vectors.h"

#define AXIS 7 /* numbers of an axis */
#define MOST_AXES 6

/* The axes between the ground and an arm, in order, and the arm's base where all of them are at zero. Of each axis, in
   the world and at zero: 1 where it is revolute and 0 where it is prismatic, its direction, and a point on it. */
typedef struct {
    int64_t count;
    const double *axes;             /* (count, AXIS) */
    const double *start, *rotation; /* of the base: the place of the first joint, (3,), and its rotation, (3, 3) */
} Carrier;

/* Turn a vector by an angle, given by its cosine and sine, about a unit vector. */
static inline void turn_about(const double *unit, double c, double s, double *v)
{
    double along = (1.0 - c) * dot(unit, v);
    double x = v[0], y = v[1], z = v[2];
    v[0] = c * x + s * (unit[1] * z - unit[2] * y) + along * unit[0];
    v[1] = c * y + s * (unit[2] * x - unit[0] * z) + along * unit[1];
    v[2] = c * z + s * (unit[0] * y - unit[1] * x) + along * unit[2];
}

/* Move a point by an axis of a carrier. */
static inline void move_point(const double *axis, double value, double c, double s, double *p)
{
    if (axis[0] == 0.0) {
        for (int d = 0; d < 3; d++) p[d] += axis[1 + d] * value;
        return;
    }
    double off[3] = {p[0] - axis[4], p[1] - axis[5], p[2] - axis[6]};
    turn_about(axis + 1, c, s, off);
    for (int d = 0; d < 3; d++) p[d] = axis[4 + d] + off[d];
}

/* Place of the first joint, (3,), and rotation of the base, (3, 3), at given positions of the axes, and where wanted
   (else NULL) the directions and points of the axes there, (count, 6). */
static inline void place_base(const Carrier *carrier, const double *values, double *place, double *rotation, double *now)
{
    for (int d = 0; d < 3; d++) place[d] = carrier->start[d];
    for (int k = 0; k < 9; k++) rotation[k] = carrier->rotation[k];
    for (int64_t k = carrier->count - 1; k >= 0; k--) {
        const double *axis = carrier->axes + AXIS * k;
        int turns = axis[0] != 0.0;
        double c = turns ? cos(values[k]) : 1.0, s = turns ? sin(values[k]) : 0.0;
        move_point(axis, values[k], c, s, place);
        if (turns)
            for (int column = 0; column < 3; column++) {
                double v[3] = {rotation[column], rotation[3 + column], rotation[6 + column]};
                turn_about(axis + 1, c, s, v);
                for (int d = 0; d < 3; d++) rotation[3 * d + column] = v[d];
            }
        if (!now) continue;
        for (int d = 0; d < 6; d++) now[6 * k + d] = axis[1 + d];
        for (int64_t later = k + 1; later < carrier->count; later++) {
            if (turns) turn_about(axis + 1, c, s, now + 6 * later);
            move_point(axis, values[k], c, s, now + 6 * later + 3);
        }
    }
}

#define MOST_TURN 3.0 /* of an arc whose tangents meet */

/* Twice the ratio of the tangents of an arc to its length, tan(x) / x of half its turn x, and how it changes with the
   turn: first derivative over the turn, and second derivative. */
typedef struct {
    double length, slope, curve;
} Tangent;

static inline Tangent tangent(double turn)
{
    double x = 0.5 * turn, s = x * x;
    if (s < 1e-4) {
        Tangent series = {1.0 + s / 3.0 + 2.0 / 15.0 * s * s, 1.0 / 6.0 + 2.0 / 15.0 * s + 17.0 / 210.0 * s * s,
                          1.0 / 6.0 + 0.4 * s + 17.0 / 42.0 * s * s};
        return series;
    }
    double t = tan(x), u = 1.0 + t * t;
    Tangent exact = {t / x, 0.25 * (x * u - t) / (s * x), 0.5 * (u * (s * t - x) + t) / (s * x)};
    return exact;
}

/* Axes about which an arc's joint turns everything beyond it while its bends a and b change, from the rotation of the
   link before it: those of the left Jacobian of the rotation vector (0, b, a). */
static inline void arc_axes(const double *before, double a, double b, double *about_a, double *about_b)
{
    double s = a * a + b * b, turn = sqrt(s);
    double half = s < 1e-4 ? 0.5 - s / 24.0 + s * s / 720.0 : (1.0 - cos(turn)) / s;
    double third = s < 1e-4 ? 1.0 / 6.0 - s / 120.0 + s * s / 5040.0 : (turn - sin(turn)) / (s * turn);
    for (int d = 0; d < 3; d++) {
        double x = before[3 * d], y = before[3 * d + 1], z = before[3 * d + 2];
        about_a[d] = half * b * x + third * a * b * y + (1.0 - third * b * b) * z;
        about_b[d] = -half * a * x + (1.0 - third * a * a) * y + third * a * b * z;
    }
}

/* The same of joints of either kind: z of the link before a universal joint, and y of the link after it. */
static inline void joint_axes(const double *arcs, const double *before, const double *after, const double *bends,
                              double *about_a, double *about_b)
{
    if (arcs) {
        arc_axes(before, bends[0], bends[1], about_a, about_b);
        return;
    }
    for (int d = 0; d < 3; d++) {
        about_a[d] = before[3 * d + 2];
        about_b[d] = after[3 * d + 1];
    }
}

/* The rotation of the link before a joint, (3, 3), then turned by the link's constant rotation, if links have any. */
static inline const double *turned_before(const double *before, const double *turns, int64_t link, double *turned)
{
    if (!turns) return before;
    const double *turn = turns + 9 * link;
    for (int d = 0; d < 9; d++) {
        const double *row = before + d - d % 3;
        turned[d] = row[0] * turn[d % 3] + row[1] * turn[d % 3 + 3] + row[2] * turn[d % 3 + 6];
    }
    return turned;
}

/* The length of a link at neither of whose ends is an arc, of a body that is fixed to the arm; 0 of all others. */
static inline double fixed_length(const double *lengths, const double *arcs, int64_t link)
{
    return arcs[link] == 0.0 && arcs[link + 1] == 0.0 ? lengths[link] : 0.0;
}

/* Places and rotations of links that are tangents of arcs, as below. */
static inline void place_tangents(int64_t links, const double *lengths, const double *turns, const double *arcs,
                                  const double *base, const double *bends, double *points, double *rotations)
{
    double leg = 0.0; /* of the link before a joint, from the end of the arc before it */
    for (int64_t j = 0; j < links; j++) {
        double turned[9], *after = rotations + 9 * j;
        const double *before = turned_before(j ? rotations + 9 * (j - 1) : base, turns, j, turned);
        double a = bends[2 * j], b = bends[2 * j + 1], s = a * a + b * b, turn = sqrt(s);
        double sine = s < 1e-4 ? 1.0 - s / 6.0 + s * s / 120.0 : sin(turn) / turn;
        double half = s < 1e-4 ? 0.5 - s / 24.0 + s * s / 720.0 : (1.0 - cos(turn)) / s, next[2] = {0.0, 0.0};
        if (j + 1 < links) next[0] = bends[2 * j + 2], next[1] = bends[2 * j + 3];
        leg = arcs[j] * tangent(turn).length;
        double length = leg + arcs[j + 1] * tangent(hypot(next[0], next[1])).length + fixed_length(lengths, arcs, j);
        for (int d = 0; d < 3; d++) {
            double x = before[3 * d], y = before[3 * d + 1], z = before[3 * d + 2];
            after[3 * d] = x * (1.0 - half * s) + sine * (a * y - b * z);
            after[3 * d + 1] = y * (1.0 - half * a * a) - sine * a * x + half * a * b * z;
            after[3 * d + 2] = z * (1.0 - half * b * b) + sine * b * x + half * a * b * y;
            points[3 * (j + 1) + d] = points[3 * j + d] + length * after[3 * d];
        }
    }
}

/* Joints and tip, (links + 1, 3), and rotations of the links, (links, 3, 3), from two bends a joint and then the
   positions of the axes that carry the base. Of the arcs about the joints, if there are
   any, half the lengths are given, and zero for the tip and the joints of bodies beyond the last arc, (links + 1,). Links
   may have constant rotations relative to the link before them, turns, (links, 3, 3), which the bends follow; they may be
   missing. */
static inline void place_links(int64_t links, const double *lengths, const double *turns, const double *arcs,
                               const Carrier *carrier, const double *bends, double *points, double *rotations)
{
    double base[9];
    place_base(carrier, bends + 2 * links, points, base, NULL);
    if (arcs) {
        place_tangents(links, lengths, turns, arcs, base, bends, points, rotations);
        return;
    }
    for (int64_t j = 0; j < links; j++) {
        double turned[9], *after = rotations + 9 * j;
        const double *before = turned_before(j ? rotations + 9 * (j - 1) : base, turns, j, turned);
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

/* Bounds on the length of a tangent of an arc, and on its first two derivatives, while its joint turns evenly. */
typedef struct {
    double length, rate, curve;
} LegGrowth;

static const LegGrowth no_growth = {0.0, 0.0, 0.0};

static inline LegGrowth leg_growth(double arc, const double *middle, const double *turns)
{
    /* All three grow with the turn of the joint. */
    double change = hypot(turns[0], turns[1]), most = hypot(middle[0], middle[1]) + 0.5 * change;
    if (!(most < MOST_TURN)) {
        LegGrowth unbounded = {INFINITY, INFINITY, INFINITY};
        return arc > 0.0 ? unbounded : no_growth;
    }
    Tangent at_most = tangent(most);
    LegGrowth growth = {arc * at_most.length, arc * most * at_most.slope * change, arc * at_most.curve * change * change};
    return growth;
}

/* Bounds on the motion of a frame: its rate of turning in the middle of an interval, and bounds on how much that
   changes, on its norm, and on the second derivative of the frame's origin. */
typedef struct {
    double rate[3], drift, most, bow;
} FrameMotion;

static inline void turn_frame(FrameMotion *frame, double own_drift)
{
    frame->drift += own_drift;
    const double *w = frame->rate;
    frame->most = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) + 0.5 * frame->drift;
}

/* The motion of the base, from the positions of the axes in the middle of the interval and their changes over it. The
   way from the ground to the first joint leads over the points of the revolute axes, which turn with the axis before,
   and along the prismatic axes, by as much as they are moved out at most. */
static inline FrameMotion base_motion(const Carrier *carrier, const double *values, const double *steps, double *rotation)
{
    FrameMotion frame = {{0.0, 0.0, 0.0}, 0.0, 0.0, 0.0};
    double place[3], now[6 * MOST_AXES];
    place_base(carrier, values, place, rotation, now);
    const double *last = NULL; /* the point of the last revolute axis, at zero: nothing moves before the first */
    for (int64_t k = 0; k < carrier->count; k++) {
        const double *axis = carrier->axes + AXIS * k;
        double step = fabs(steps[k]), swing = frame.most * frame.most + frame.drift;
        if (axis[0] == 0.0) {
            frame.bow += (fabs(values[k]) + 0.5 * step) * swing + 2.0 * frame.most * step;
            continue;
        }
        if (last) {
            double way[3] = {axis[4] - last[0], axis[5] - last[1], axis[6] - last[2]};
            frame.bow += sqrt(dot(way, way)) * swing;
        }
        last = axis + 4;
        for (int d = 0; d < 3; d++) frame.rate[d] += steps[k] * now[6 * k + d];
        turn_frame(&frame, frame.most * step);
    }
    if (last) {
        double way[3] = {carrier->start[0] - last[0], carrier->start[1] - last[1], carrier->start[2] - last[2]};
        frame.bow += sqrt(dot(way, way)) * (frame.most * frame.most + frame.drift);
    }
    return frame;
}

/* Bounds on the rates of turning of the links, (links,), and on the second derivatives of joints and tip, (links + 1,),
   from the coordinates and rotations in the middle of the interval and the changes of the coordinates over it. A joint's own axes
   turn by |da db| at most where it is universal, and by half of da² + db² where it is of an arc: its Jacobian is the mean
   of the rotations by shares u of its vector, which turn by u times the change of the vector at most. */
static inline void bound_motion(int64_t links, const double *lengths, const double *arcs, const Carrier *carrier,
                                const double *bends, const double *rotations, const double *turns, double *speed,
                                double *bow)
{
    double base[9], about_a[3], about_b[3];
    FrameMotion motion = base_motion(carrier, bends + 2 * links, turns + 2 * links, base);
    LegGrowth leg = arcs ? leg_growth(arcs[0], bends, turns) : no_growth;
    bow[0] = motion.bow;
    for (int64_t j = 0; j < links; j++) {
        const double *frame = j ? rotations + 9 * (j - 1) : base;
        const double *after = rotations + 9 * j;
        double da = turns[2 * j], db = turns[2 * j + 1];
        joint_axes(arcs, frame, after, bends + 2 * j, about_a, about_b);
        for (int d = 0; d < 3; d++) motion.rate[d] += da * about_a[d] + db * about_b[d];
        turn_frame(&motion, motion.most * hypot(da, db) + (arcs ? 0.5 * (da * da + db * db) : fabs(da * db)));
        double most = motion.most, drift = motion.drift;
        speed[j] = most;
        if (arcs) {
            LegGrowth next = no_growth;
            if (j + 1 < links) next = leg_growth(arcs[j + 1], bends + 2 * j + 2, turns + 2 * j + 2);
            bow[j + 1] = bow[j] + (leg.length + next.length + fixed_length(lengths, arcs, j)) * (most * most + drift)
                         + 2.0 * (leg.rate + next.rate) * most + leg.curve + next.curve;
            leg = next;
        } else {
            bow[j + 1] = bow[j] + lengths[j] * (most * most + drift);
        }
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
