/* Rates and moments of sections that bend evenly, for the verifier alone: arc_dynamics.py says what each is. */

#include "native.h"

#define TERMS 13 /* of the series */

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* out += A × B. */
static void add_cross(const double *a, const double *b, double *out)
{
    out[0] += a[1] * b[2] - a[2] * b[1];
    out[1] += a[2] * b[0] - a[0] * b[2];
    out[2] += a[0] * b[1] - a[1] * b[0];
}

/* A vector in the frame at the beginning of an arc, in the world. */
static void in_world(const double *frame, double x, double y, double z, double *out)
{
    for (int k = 0; k < 3; k++) out[k] = frame[3 * k] * x + frame[3 * k + 1] * y + frame[3 * k + 2] * z;
}

typedef struct {
    int64_t count, links;
    const double *arcs;                                           /* (links,) lengths */
    const double *series;                                         /* (3, 3, TERMS) S, A, B and derivatives by s */
    const double *bends, *rates, *gains;                          /* (count, links, 2) about z and y */
    const double *base, *frames;                                  /* (count, 3, 3), (count, links, 3, 3) */
    const double *first_axes, *second_axes;                       /* (count, links, 3) */
    const double *base_rate, *base_growth, *base_gain, *base_place; /* (count, 3) */
    double *rate, *growth, *ends, *places;                        /* (count, links, 3) */
    double *reaches;                                              /* (count, links, 2, 3) */
} ArcRates;

/* S, A and B at s, and their first two derivatives by s. */
static void functions(const double *series, double s, double values[3][3])
{
    for (int k = 0; k < 9; k++) {
        double value = 0.0;
        for (int term = TERMS - 1; term >= 0; term--) value = series[TERMS * k + term] + value * s;
        values[k / 3][k % 3] = value;
    }
}

PUBLIC void arc_rates(ArcRates *q)
{
    for (int64_t t = 0; t < q->count; t++) {
        double rate[3], growth[3], place[3], gained[3];
        memcpy(rate, q->base_rate + 3 * t, sizeof rate);
        memcpy(growth, q->base_growth + 3 * t, sizeof growth);
        memcpy(place, q->base_place + 3 * t, sizeof place);
        memcpy(gained, q->base_gain + 3 * t, sizeof gained);
        for (int64_t link = 0; link < q->links; link++) {
            int64_t at = q->links * t + link;
            const double *frame = link ? q->frames + 9 * (at - 1) : q->base + 9 * t;
            double a = q->bends[2 * at], b = q->bends[2 * at + 1], h = q->arcs[link];
            double da = q->rates[2 * at], db = q->rates[2 * at + 1], dda = q->gains[2 * at], ddb = q->gains[2 * at + 1];
            double by_s[3][3], by_time[3][3];
            functions(q->series, a * a + b * b, by_s);
            double s_rate = 2.0 * (a * da + b * db), s_gain = 2.0 * (da * da + db * db + a * dda + b * ddb);
            for (int k = 0; k < 3; k++) {
                by_time[k][0] = by_s[k][0];
                by_time[k][1] = by_s[k][1] * s_rate;
                by_time[k][2] = by_s[k][2] * s_rate * s_rate + by_s[k][1] * s_gain;
            }
            const double *s = by_time[0], *f = by_time[1], *g = by_time[2];
            double step[3], speed[3], rush[3], grown[3], turn[3], bow[3];
            in_world(frame, h * s[0], h * f[0] * a, -h * f[0] * b, step);
            in_world(frame, h * s[1], h * (f[1] * a + f[0] * da), -h * (f[1] * b + f[0] * db), speed);
            in_world(frame, h * s[2], h * (f[2] * a + 2.0 * f[1] * da + f[0] * dda),
                     -h * (f[2] * b + 2.0 * f[1] * db + f[0] * ddb), rush);
            double across = b * da - a * db, gain = b * dda - a * ddb;
            in_world(frame, f[1] * across + f[0] * gain, ddb + (g[1] * a + g[0] * da) * across + g[0] * a * gain,
                     dda - (g[1] * b + g[0] * db) * across - g[0] * b * gain, grown);
            /* Rates and accelerations of the body before, which carries the arc, then of its end. */
            for (int k = 0; k < 3; k++) {
                turn[k] = da * q->first_axes[3 * at + k] + db * q->second_axes[3 * at + k];
                bow[k] = 2.0 * speed[k];
                gained[k] += rush[k];
                place[k] += step[k];
            }
            add_cross(rate, step, bow);
            add_cross(rate, bow, gained);
            add_cross(growth, step, gained);
            add_cross(rate, turn, growth);
            for (int k = 0; k < 3; k++) {
                growth[k] += grown[k];
                rate[k] += turn[k];
            }
            memcpy(q->rate + 3 * at, rate, sizeof rate);
            memcpy(q->growth + 3 * at, growth, sizeof growth);
            memcpy(q->ends + 3 * at, gained, sizeof gained);
            memcpy(q->places + 3 * at, place, sizeof place);
            double slope = by_s[0][1], own = by_s[1][0], change = by_s[1][1];
            in_world(frame, h * 2.0 * a * slope, h * (own + 2.0 * a * a * change), -h * 2.0 * a * b * change,
                     q->reaches + 6 * at);
            in_world(frame, h * 2.0 * b * slope, h * 2.0 * a * b * change, -h * (own + 2.0 * b * b * change),
                     q->reaches + 6 * at + 3);
        }
    }
}

typedef struct {
    int64_t count, links;
    const double *masses, *transverse, *axial; /* (links,) moments of inertia about the middle of each body */
    const double *centres;                     /* (links,) how far along the body its middle is from the end of its arc */
    double payload;
    const double *gravity;                                        /* (3,) */
    const double *base_place, *frames;                            /* (count, 3), (count, links, 3, 3) */
    const double *rate, *growth, *ends, *places, *reaches;        /* as in ArcRates, likewise the next */
    const double *first_axes, *second_axes;
    const double *forces, *moments;                               /* (count, links, 3) of what is fixed to bodies, about
                                                                     the ends of their arcs; may be missing */
    double *torques;                                              /* (count, links, 3) */
    double *force, *moment;                                       /* (count, 3) on the base */
} ArcMoments;

PUBLIC void arc_moments(ArcMoments *q)
{
    for (int64_t t = 0; t < q->count; t++) {
        double force[3] = {0.0, 0.0, 0.0}, moment[3] = {0.0, 0.0, 0.0}, own[3];
        for (int64_t link = q->links - 1; link >= 0; link--) {
            int64_t at = q->links * t + link;
            const double *rate = q->rate + 3 * at, *growth = q->growth + 3 * at, *place = q->places + 3 * at;
            const double *start = link ? place - 3 : q->base_place + 3 * t, *ends = q->ends + 3 * at;
            double along[3], centre[3], needed[3], middle[3], added[3] = {0.0, 0.0, 0.0};
            double whirl[3] = {0.0, 0.0, 0.0}, turned[3] = {0.0, 0.0, 0.0};
            for (int k = 0; k < 3; k++) {
                along[k] = q->frames[9 * at + 3 * k];
                centre[k] = q->centres[link] * along[k];
                middle[k] = ends[k] - q->gravity[k];
            }
            add_cross(growth, centre, middle);
            add_cross(rate, centre, whirl);
            add_cross(rate, whirl, middle);
            add_cross(rate, along, turned);
            /* (w . x)' = a . x, as w . (w x x) is zero. */
            double across = q->transverse[link], more = q->axial[link] - across;
            double spin = dot(rate, along), gain = dot(growth, along);
            for (int k = 0; k < 3; k++) {
                needed[k] = q->masses[link] * middle[k];
                centre[k] += place[k];
                moment[k] += across * growth[k] + more * (gain * along[k] + spin * turned[k]);
                if (q->forces) {
                    added[k] = q->forces[3 * at + k];
                    moment[k] += q->moments[3 * at + k];
                }
                if (link == q->links - 1) added[k] += q->payload * (ends[k] - q->gravity[k]);
                force[k] += needed[k] + added[k];
            }
            /* Forces and moments of this body and all beyond it are summed about the world's origin. */
            add_cross(centre, needed, moment);
            add_cross(place, added, moment);
            /* The end of the arc turns about the beginning only as its own place changes: of moments about that end,
               the force's part is by the reach. */
            memcpy(own, moment, sizeof own);
            add_cross(force, place, own);
            q->torques[3 * at] = dot(q->first_axes + 3 * at, own) + dot(q->reaches + 6 * at, force);
            q->torques[3 * at + 1] = dot(q->second_axes + 3 * at, own) + dot(q->reaches + 6 * at + 3, force);
            q->torques[3 * at + 2] = 0.0;
            if (link == 0) {
                memcpy(own, moment, sizeof own);
                add_cross(force, start, own);
            }
        }
        memcpy(q->force + 3 * t, force, sizeof force);
        memcpy(q->moment + 3 * t, own, sizeof own);
    }
}
