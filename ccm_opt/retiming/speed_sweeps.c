/* The two sweeps of reachability.py in C, one interval after the other, which numpy cannot do at once.

   Rows are beta x + gamma y <= 1, with x and y the squared speeds at the begin and the end of an interval. */

#include <math.h>
#include <stdint.h>

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

typedef struct {
    int64_t intervals, rows, newton_steps;
    double rounding;
    const double *beta, *gamma; /* (intervals, rows) */
    const double *cap;          /* bound on the squared speed, (intervals + 1,) */
    double *lines;              /* working memory, 4 numbers for a row */
    double *most;               /* working memory: greatest x of every interval, (intervals,) */
    double *reach;              /* greatest squared speed from which the end can be reached, (intervals + 1,) */
    double *squared;            /* result, (intervals + 1,) */
} Sweeps;

/* Bounds on y that are linear in x. */
typedef struct {
    int64_t count;
    double *start, *slope;
} Lines;

/* The rows of one interval as bounds on y: above it, and, negated, below it. */
typedef struct {
    Lines above, below;
    double most, reach;
} Stage;

static void least(const Lines *lines, double x, double bound, double *value, double *slope)
{
    *value = bound;
    *slope = 0.0;
    for (int64_t k = 0; k < lines->count; k++) {
        double at = lines->start[k] + lines->slope[k] * x;
        if (at < *value) {
            *value = at;
            *slope = lines->slope[k];
        }
    }
}

static Stage stage_of(const Sweeps *q, int64_t interval, double reach)
{
    const double *beta = q->beta + interval * q->rows;
    const double *gamma = q->gamma + interval * q->rows;
    double *lines = q->lines;
    Stage stage = {{0, lines, lines + q->rows}, {0, lines + 2 * q->rows, lines + 3 * q->rows}, 0.0, reach};
    double most = q->cap[interval];
    for (int64_t k = 0; k < q->rows; k++) {
        double effect = gamma[k] * reach;
        /* A row on which y has no more effect than rounding bounds x only. */
        if (fabs(effect) > q->rounding) {
            /* gamma > 0 bounds y from above, y <= (1 - beta x) / gamma; gamma < 0 bounds -y by (1 - beta x) / -gamma. */
            Lines *side = effect > 0.0 ? &stage.above : &stage.below;
            double size = fabs(gamma[k]);
            side->start[side->count] = 1.0 / size;
            side->slope[side->count++] = -beta[k] / size;
        }
        /* As bounds on x the rows are loosest at y = 0 or, where gamma < 0, at y = reach. */
        if (beta[k] > 0.0) {
            double bound = (1.0 + fmax(-gamma[k], 0.0) * reach) / beta[k];
            if (bound < most) most = bound;
        }
    }
    stage.most = most;
    return stage;
}

static void room(const Stage *stage, double x, double *high, double *low, double *rise, double *fall)
{
    double negated, slope;
    least(&stage->above, x, stage->reach, high, rise);
    least(&stage->below, x, 0.0, &negated, &slope);
    *low = -negated;
    *fall = -slope;
}

/* The greatest x that leaves some y, by Newton's method on the room for y, from the right. */
static double greatest(const Stage *stage, int64_t most_steps)
{
    double x = stage->most;
    for (int64_t step = 0; step < most_steps; step++) {
        double high, low, rise, fall;
        room(stage, x, &high, &low, &rise, &fall);
        if (high >= low || rise >= fall) break;
        x = fmax(x - (high - low) / (rise - fall), 0.0);
    }
    return x;
}

PUBLIC void speed_sweeps(void *query)
{
    Sweeps *q = query;
    q->reach[q->intervals] = 0.0;
    for (int64_t k = q->intervals - 1; k >= 0; k--) {
        Stage stage = stage_of(q, k, q->reach[k + 1]);
        q->most[k] = stage.most;
        q->reach[k] = greatest(&stage, q->newton_steps);
    }
    q->squared[0] = 0.0;
    for (int64_t k = 0; k < q->intervals; k++) {
        double high, low, rise, fall;
        Stage stage = stage_of(q, k, q->reach[k + 1]);
        room(&stage, fmin(q->squared[k], stage.most), &high, &low, &rise, &fall);
        q->squared[k + 1] = fmin(fmax(fmax(high, low), 0.0), stage.reach);
    }
}
