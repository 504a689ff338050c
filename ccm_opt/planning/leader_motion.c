/* The quadratic program of bends that are smooth along the feed: leader_motion.py says what it is. */

#include "native.h"

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

typedef struct {
    int64_t count, links, width;   /* keyframes, links, and subdiagonals of the matrix */
    double uneven, pull;           /* weights on squared second differences of bends, and on displacements across [1/m²] */
    const double *bends;           /* (count, 2 links) */
    const int64_t *index;          /* (count, 2 links) of each bend among the free ones; −1 where it is kept */
    const double *points, *place;  /* (count, links + 1, 3) joints and tip as they are, and where they are pulled to */
    const double *frames;          /* (count, links, 3, 3) rotations of the links */
    const double *base;            /* (3, 3) rotation of the base */
    double *matrix;                /* (free bends, width + 1), zeros: columns from the diagonal downwards */
    double *gradient;              /* (free bends,), zeros */
    double *slopes;                /* working memory, (3, 2 links) */
} SmoothingProgram;

/* Second differences of each bend over three keyframes in turn. */
static void add_unevenness(SmoothingProgram *q)
{
    const double share[3] = {1.0, -2.0, 1.0};
    int64_t bends = 2 * q->links;
    for (int64_t k = 0; k + 2 < q->count; k++) {
        for (int64_t b = 0; b < bends; b++) {
            const double *bend = q->bends + bends * k + b;
            const int64_t *index = q->index + bends * k + b;
            double bent = q->uneven * (bend[0] - 2.0 * bend[bends] + bend[2 * bends]);
            for (int64_t i = 0; i < 3; i++) {
                if (index[i * bends] < 0) continue;
                q->gradient[index[i * bends]] += share[i] * bent;
                for (int64_t j = 0; j <= i; j++) {
                    int64_t column = index[j * bends];
                    if (column < 0) continue;
                    q->matrix[column * (q->width + 1) + index[i * bends] - column] += q->uneven * share[i] * share[j];
                }
            }
        }
    }
}

/* Direction along the arm at the end of a link: the mean of those of the links before and after it. */
static void along_arm(const double *frames, int64_t link, int64_t links, double *out)
{
    const double *own = frames + 9 * link;
    for (int k = 0; k < 3; k++) out[k] = own[3 * k] + (link + 1 < links ? own[9 + 3 * k] : 0.0);
    double length = sqrt(dot(out, out));
    for (int k = 0; k < 3; k++) out[k] /= length;
}

/* Displacement of a point across the arm for a unit of the bend about an axis through a joint. */
static void across_arm(const double *axis, const double *joint, const double *point, const double *along, double *out)
{
    double lever[3] = {point[0] - joint[0], point[1] - joint[1], point[2] - joint[2]};
    out[0] = axis[1] * lever[2] - axis[2] * lever[1];
    out[1] = axis[2] * lever[0] - axis[0] * lever[2];
    out[2] = axis[0] * lever[1] - axis[1] * lever[0];
    double part = dot(out, along);
    for (int k = 0; k < 3; k++) out[k] -= part * along[k];
}

/* Displacements of the ends of all links across the arm in a keyframe. */
static void add_displacements(SmoothingProgram *q, int64_t keyframe)
{
    int64_t links = q->links, bends = 2 * links;
    const double *points = q->points + 3 * (links + 1) * keyframe, *place = q->place + 3 * (links + 1) * keyframe;
    const double *frames = q->frames + 9 * links * keyframe;
    const int64_t *index = q->index + bends * keyframe;
    int64_t first = 0;
    while (first < bends && index[first] < 0) first++;
    for (int64_t end = first / 2; end < links; end++) {
        double along[3], off[3];
        along_arm(frames, end, links, along);
        for (int k = 0; k < 3; k++) off[k] = points[3 * (end + 1) + k] - place[3 * (end + 1) + k];
        /* The slopes of free bends, one after the other, in each of the three directions. */
        int64_t found = 0;
        for (int64_t b = first; b < 2 * (end + 1); b++) {
            if (index[b] < 0) continue;
            int64_t link = b / 2, column = b % 2 ? 1 : 2;
            const double *from = b % 2 ? frames + 9 * link : link ? frames + 9 * (link - 1) : q->base;
            double axis[3] = {from[column], from[3 + column], from[6 + column]}, slope[3];
            across_arm(axis, points + 3 * link, points + 3 * (end + 1), along, slope);
            for (int k = 0; k < 3; k++) q->slopes[bends * k + found] = slope[k];
            q->gradient[index[b]] += q->pull * dot(slope, off);
            found++;
        }
        const double *x = q->slopes, *y = x + bends, *z = y + bends;
        for (int64_t j = 0; j < found; j++) {
            double *restrict column = q->matrix + (index[first] + j) * (q->width + 1);
            double u = q->pull * x[j], v = q->pull * y[j], w = q->pull * z[j];
            for (int64_t i = j; i < found; i++) column[i - j] += u * x[i] + v * y[i] + w * z[i];
        }
    }
}

PUBLIC void smoothing_program(SmoothingProgram *q)
{
    add_unevenness(q);
    for (int64_t k = 0; k < q->count; k++) add_displacements(q, k);
}
