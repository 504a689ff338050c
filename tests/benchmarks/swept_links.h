/* Poses and motions of a planar arm of line segments with a radius, checked against walls and the arm itself, for the
 * sampling planners that ours is compared with. A motion is proved free by how far its links can move, halved where
 * that is too coarse. It shares nothing with the package. C and C++. */

#ifndef SWEPT_LINKS_H
#define SWEPT_LINKS_H

#include <math.h>

#define MOST_LINKS 400

typedef struct {
    long links, edges, first_pair, mount_link;
    double length, radius, gap, heading, mount_share;
    const double *base, *limits, *walls, *rounding; /* walls: 4 numbers an edge */
} Scene;

/* ---------------------------------------------------------------- distances */
static double point_segment(const double *p, const double *a, const double *b) {
    double dx = b[0] - a[0], dy = b[1] - a[1], x = p[0] - a[0], y = p[1] - a[1];
    double square = dx * dx + dy * dy, t = square > 0.0 ? (x * dx + y * dy) / square : 0.0;
    t = t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t;
    x -= t * dx;
    y -= t * dy;
    return sqrt(x * x + y * y);
}

static double side(const double *p, const double *q, const double *r) {
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
}

static double segments(const double *p, const double *q, const double *r, const double *s) {
    if (side(p, q, r) * side(p, q, s) < 0.0 && side(r, s, p) * side(r, s, q) < 0.0) return 0.0;
    return fmin(fmin(point_segment(p, r, s), point_segment(q, r, s)), fmin(point_segment(r, p, q), point_segment(s, p, q)));
}

/* ---------------------------------------------------------------- swept motions */
/* 1 when nothing comes nearer than it may while no joint k moves farther than moved[k] from the pose and no two links
 * i < j come nearer by more than the turns between them allow; 0 when the pose touches; -1 when neither is sure. */
static int judged(const Scene *s, const double *headings, const double *turns, double half) {
    double at[2 * (MOST_LINKS + 1)], moved = 0.0;
    int sure = 1;
    at[0] = s->base[0];
    at[1] = s->base[1];
    for (long i = 0; i < s->links; ++i) {
        at[2 * i + 2] = at[2 * i] + s->length * cos(headings[i]);
        at[2 * i + 3] = at[2 * i + 1] + s->length * sin(headings[i]);
    }
    for (long i = 0; i < s->links; ++i) {
        moved += s->length * fabs(turns[i]) * half;
        if (i < s->mount_link) continue;
        double p[2] = {at[2 * i], at[2 * i + 1]};
        const double *q = at + 2 * i + 2;
        if (i == s->mount_link) {
            p[0] += s->mount_share * (q[0] - p[0]);
            p[1] += s->mount_share * (q[1] - p[1]);
        }
        double mx = 0.5 * (p[0] + q[0]), my = 0.5 * (p[1] + q[1]);
        for (long k = 0; k < s->edges; ++k) {
            const double *w = s->walls + 4 * k;
            double keep = s->gap + s->rounding[k];
            double ex = w[2] - w[0], ey = w[3] - w[1], x = 0.5 * (w[0] + w[2]) - mx, y = 0.5 * (w[1] + w[3]) - my;
            double far = keep + moved + 0.5 * s->length + 0.5 * sqrt(ex * ex + ey * ey);
            if (x * x + y * y > far * far) continue;
            double d = segments(p, q, w, w + 2);
            if (d <= keep) return 0;
            if (d <= keep + moved) sure = 0;
        }
        for (long j = i + s->first_pair; s->first_pair > 0 && j < s->links; ++j) {
            double relative = 0.0, keep = 2.0 * s->radius;
            for (long k = i + 1; k <= j; ++k) relative += s->length * fabs(turns[k] - turns[i]) * half;
            double d = segments(at + 2 * i, at + 2 * i + 2, at + 2 * j, at + 2 * j + 2);
            if (d <= keep) return 0;
            if (d <= keep + relative) sure = 0;
        }
    }
    return sure ? 1 : -1;
}

static int swept_free(const Scene *s, const double *start, const double *turns, double from, double to, int depth) {
    double headings[MOST_LINKS], middle = 0.5 * (from + to);
    for (long i = 0; i < s->links; ++i) headings[i] = start[i] + middle * turns[i];
    int judgement = judged(s, headings, turns, 0.5 * (to - from));
    if (judgement >= 0) return judgement;
    if (depth == 0) return 0;
    return swept_free(s, start, turns, from, middle, depth - 1) && swept_free(s, start, turns, middle, to, depth - 1);
}

/* Whether the arm touches nothing while its bends go straight from a to b, within two shares of the way. */
static int part_free(const Scene *s, const double *a, const double *b, double from, double to) {
    double start[MOST_LINKS], turns[MOST_LINKS], first = s->heading, last = s->heading;
    for (long i = 0; i < s->links; ++i) {
        first += a[i];
        last += b[i];
        start[i] = first;
        turns[i] = last - first;
    }
    return swept_free(s, start, turns, from, to, 16);
}

static int motion_free(const Scene *s, const double *a, const double *b) { return part_free(s, a, b, 0.0, 1.0); }

#endif
