/* Which samples of curves are kept so that straight lines between them stay near all others: as thinning.py does it, with
   the same roundings, and thus the same samples, many times as fast. */

#include <math.h>
#include <stdint.h>

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

#define LANES 4 /* columns that are looked at side by side */

/* Samples between two that are kept. */
typedef struct {
    double away; /* of the one that is farthest from the line */
    int64_t farthest;
    int64_t begin;
    int64_t end;
} Gap;

typedef struct {
    const double *time;    /* (samples,) */
    const double *columns; /* (samples, width) */
    int64_t samples;
    int64_t width;
    double tolerance;
    int64_t most;  /* samples that are kept in all */
    uint8_t *kept; /* (samples,), 1 for those that are kept: in, the first and the last among them, and out */
    Gap *queue;    /* (samples,), room for gaps: the one whose sample is farthest is in front, none behind its parent */
    double *rise;  /* (width,), room for what the columns grow by from one end of a gap to the other */
} Thinning;

static double larger(double a, double b)
{
    return a > b ? a : b;
}

/* How far the samples at one time are from the lines. */
static double away_at(const double *here, const double *begin, const double *rise, int64_t width, double share)
{
    double lanes[LANES] = {0.0, 0.0, 0.0, 0.0};
    int64_t k = 0;
    for (; k + LANES <= width; k += LANES)
        for (int lane = 0; lane < LANES; lane++)
            lanes[lane] = larger(fabs(here[k + lane] - (begin[k + lane] + share * rise[k + lane])), lanes[lane]);
    for (; k < width; k++) lanes[0] = larger(fabs(here[k] - (begin[k] + share * rise[k])), lanes[0]);
    return larger(larger(lanes[0], lanes[1]), larger(lanes[2], lanes[3]));
}

static void look_into(const Thinning *t, Gap *gap)
{
    const double *begin = t->columns + gap->begin * t->width;
    const double *end = t->columns + gap->end * t->width;
    double start = t->time[gap->begin];
    double length = t->time[gap->end] - start;
    for (int64_t k = 0; k < t->width; k++) t->rise[k] = end[k] - begin[k];
    gap->away = -1.0;
    for (int64_t row = gap->begin + 1; row < gap->end; row++) {
        double share = (t->time[row] - start) / length;
        double away = away_at(t->columns + row * t->width, begin, t->rise, t->width, share);
        if (away > gap->away) {
            gap->away = away;
            gap->farthest = row;
        }
    }
}

/* Of samples as far from their lines the earliest comes first. */
static int before(const Gap *a, const Gap *b)
{
    return a->away > b->away || (a->away == b->away && a->farthest < b->farthest);
}

/* Puts the gap between two samples into the queue, where it has any; how many there are then. */
static int64_t put(const Thinning *t, int64_t count, int64_t begin, int64_t end)
{
    if (end - begin < 2) return count;
    Gap gap = {0.0, begin + 1, begin, end};
    look_into(t, &gap);
    int64_t at = count;
    for (; at > 0 && before(&gap, &t->queue[(at - 1) / 2]); at = (at - 1) / 2) t->queue[at] = t->queue[(at - 1) / 2];
    t->queue[at] = gap;
    return count + 1;
}

/* Takes the first gap out of the queue, which has so many. */
static Gap take(const Thinning *t, int64_t count)
{
    Gap first = t->queue[0];
    Gap last = t->queue[count - 1];
    int64_t at = 0;
    for (;;) {
        int64_t child = 2 * at + 1;
        if (child >= count - 1) break;
        if (child + 1 < count - 1 && before(&t->queue[child + 1], &t->queue[child])) child++;
        if (!before(&t->queue[child], &last)) break;
        t->queue[at] = t->queue[child];
        at = child;
    }
    t->queue[at] = last;
    return first;
}

PUBLIC void thin_samples(Thinning *t)
{
    int64_t count = 0;
    int64_t found = 1;
    int64_t latest = 0;
    for (int64_t row = 1; row < t->samples; row++)
        if (t->kept[row]) {
            count = put(t, count, latest, row);
            latest = row;
            found++;
        }
    for (; count > 0 && found < t->most; found++) {
        Gap gap = take(t, count--);
        if (gap.away <= t->tolerance) return;
        t->kept[gap.farthest] = 1;
        count = put(t, count, gap.begin, gap.farthest);
        count = put(t, count, gap.farthest, gap.end);
    }
}
