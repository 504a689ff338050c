/* Frames, rates and moments of rigid links, for the verifier alone: chain_motion.py and newton_euler.py say what each is. */

#include "native.h"

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

typedef struct {
    int64_t count, links;
    const double *ahead, *left, *up;                    /* (count, 3) axes of the base */
    const double *bends;                                /* (count, links, 2) bends about z and y */
    const double *fixed;                                /* (links, 3, 3) turns of parts of bodies before their joints; may be missing */
    double *first_axes, *second_axes, *along, *across;  /* (count, links, 3) */
} LinkFrames;

PUBLIC void link_frames(LinkFrames *q)
{
    for (int64_t t = 0; t < q->count; t++) {
        double ahead[3], left[3], up[3];
        memcpy(ahead, q->ahead + 3 * t, sizeof ahead);
        memcpy(left, q->left + 3 * t, sizeof left);
        memcpy(up, q->up + 3 * t, sizeof up);
        for (int64_t link = 0; link < q->links; link++) {
            int64_t at = q->links * t + link;
            if (q->fixed) {
                const double *turn = q->fixed + 9 * link;
                for (int k = 0; k < 3; k++) {
                    double x = ahead[k], y = left[k], z = up[k];
                    ahead[k] = turn[0] * x + turn[3] * y + turn[6] * z;
                    left[k] = turn[1] * x + turn[4] * y + turn[7] * z;
                    up[k] = turn[2] * x + turn[5] * y + turn[8] * z;
                }
            }
            double c = cos(q->bends[2 * at]), s = sin(q->bends[2 * at]);
            double e = cos(q->bends[2 * at + 1]), f = sin(q->bends[2 * at + 1]);
            memcpy(q->first_axes + 3 * at, up, sizeof up);
            for (int k = 0; k < 3; k++) {
                double turned = c * ahead[k] + s * left[k];
                left[k] = c * left[k] - s * ahead[k];
                /* A rotation about left turns up towards ahead, and ahead downwards. */
                ahead[k] = e * turned - f * up[k];
                up[k] = e * up[k] + f * turned;
            }
            memcpy(q->second_axes + 3 * at, left, sizeof left);
            memcpy(q->along + 3 * at, ahead, sizeof ahead);
            memcpy(q->across + 3 * at, up, sizeof up);
        }
    }
}

typedef struct {
    int64_t count, links, planar;
    const double *lengths;                               /* (links,) */
    const double *first_axes, *second_axes, *along;      /* (count, links, 3) */
    const double *rates, *gains;                         /* (count, links, 2) derivatives of the bends */
    const double *base_rate, *base_growth, *base_gain;   /* (count, 3) */
    double *rate, *growth, *ends, *middles;              /* (count, links, 3) */
} LinkRates;

PUBLIC void link_rates(LinkRates *q)
{
    for (int64_t t = 0; t < q->count; t++) {
        double turned[3] = {0.0, 0.0, 0.0}, gained[3] = {0.0, 0.0, 0.0}, moved[3] = {0.0, 0.0, 0.0};
        for (int64_t link = 0; link < q->links; link++) {
            int64_t at = q->links * t + link;
            const double *first = q->first_axes + 3 * at, *second = q->second_axes + 3 * at, *along = q->along + 3 * at;
            double a = q->rates[2 * at], b = q->rates[2 * at + 1], da = q->gains[2 * at], db = q->gains[2 * at + 1];
            double *rate = q->rate + 3 * at, *growth = q->growth + 3 * at;
            double before[3], between[3], swung[3], added[3], swing[3];
            for (int k = 0; k < 3; k++) {
                double turn = a * first[k] + b * second[k];
                turned[k] += turn;
                rate[k] = turned[k] + q->base_rate[3 * t + k];
                before[k] = rate[k] - turn;
                between[k] = before[k] + a * first[k];
            }
            cross(before, first, swung);
            cross(between, second, added);
            for (int k = 0; k < 3; k++) {
                double gain = da * first[k] + db * second[k];
                /* The first axis moves with the preceding link, the second with the rotation about the first as well. */
                if (!q->planar) gain = gain + a * swung[k] + b * added[k];
                gained[k] += gain;
                growth[k] = gained[k] + q->base_growth[3 * t + k];
            }
            cross(rate, along, added);
            cross(rate, added, swung);
            cross(growth, along, swing);
            for (int k = 0; k < 3; k++) {
                double step = q->lengths[link] * (swing[k] + swung[k]);
                moved[k] += step;
                q->ends[3 * at + k] = q->base_gain[3 * t + k] + moved[k];
                q->middles[3 * at + k] = q->ends[3 * at + k] - 0.5 * step;
            }
        }
    }
}

typedef struct {
    int64_t count, links, planar;
    const double *lengths, *masses, *transverse, *axial; /* (links,) moments of inertia about the middle of each link */
    double payload;
    const double *gravity;                               /* (3,) */
    const double *along, *rate, *growth, *ends, *middles; /* (count, links, 3) */
    const double *first_axes, *second_axes, *last_axes;  /* (count, links, 3) of the three revolutes of each joint */
    const double *forces, *moments;                      /* (count, links, 3) of what is fixed to links; may be missing */
    double *torques;                                     /* (count, links, 3) */
    double *force, *moment;                              /* (count, 3) on the base */
} JointMoments;

PUBLIC void joint_moments(JointMoments *q)
{
    for (int64_t t = 0; t < q->count; t++) {
        double onward[3] = {0.0, 0.0, 0.0}, about[3] = {0.0, 0.0, 0.0}, at_tip[3];
        for (int k = 0; k < 3; k++)
            at_tip[k] = q->payload * (q->ends[3 * (q->links * (t + 1) - 1) + k] - q->gravity[k]);
        for (int64_t link = q->links - 1; link >= 0; link--) {
            int64_t at = q->links * t + link;
            const double *along = q->along + 3 * at, *rate = q->rate + 3 * at, *growth = q->growth + 3 * at;
            double lever[3], pushed[3], moment[3], turned[3];
            double across = q->transverse[link], more = q->axial[link] - across;
            /* (w . x)' = a . x, as w . (w x x) is zero. */
            double spin = dot(rate, along), gain = dot(growth, along);
            cross(rate, along, turned);
            for (int k = 0; k < 3; k++) {
                double needed = q->masses[link] * (q->middles[3 * at + k] - q->gravity[k]);
                onward[k] += q->forces ? needed + q->forces[3 * at + k] : needed;
                /* The force of all links beyond acts at the link's full length, its own at half its length. */
                pushed[k] = onward[k] - needed + at_tip[k] + 0.5 * needed;
                lever[k] = q->lengths[link] * along[k];
            }
            cross(lever, pushed, moment);
            for (int k = 0; k < 3; k++) {
                double change = across * growth[k];
                if (!q->planar) change = change + more * (gain * along[k] + spin * turned[k]);
                moment[k] = moment[k] + change;
                about[k] += q->moments ? moment[k] + q->moments[3 * at + k] : moment[k];
            }
            q->torques[3 * at] = dot(about, q->first_axes + 3 * at);
            q->torques[3 * at + 1] = dot(about, q->second_axes + 3 * at);
            q->torques[3 * at + 2] = dot(about, q->last_axes + 3 * at);
        }
        for (int k = 0; k < 3; k++) {
            q->force[3 * t + k] = onward[k] + at_tip[k];
            q->moment[3 * t + k] = about[k];
        }
    }
}
