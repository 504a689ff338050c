/* The recursions along an arm of any number of links, and its closed loop, around one link's functions.

   The functions of one link (rnea_base, rnea_outward, rnea_tip, rnea_inward, aba_velocity, aba_tip, aba_inertia,
   aba_base, aba_acceleration) are generated before this text, with STATE and SOLVED, the numbers that aba_inertia
   passes on and keeps for each link. Arrays are those of the Python side: one row a link or a state, contiguous. */

#include <math.h>
#include <string.h>

#define FAR 1e5  /* rad: beyond it the reduction below would lose digits */

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

typedef struct {
    long links;
    const double *bodies, *drives, *world; /* (links, 4), (links, 6), (5,) */
    double *work;                          /* (links, 24 + SOLVED) */
} Arm;

typedef struct {
    const Arm *arm;
    long count;
    const double *q, *qd, *third, *feed; /* (count, 3 links) each; (count,) */
    double *out, *out_feed;              /* (count, 3 links); (count,) */
} Call;

typedef struct {
    const Arm *plant, *model;
    long count, held, computed; /* steps; of these held by the brakes; whether the law is computed torque */
    double step, kp, kd, feed_kp, feed_kd, feed_limit;
    const double *limit;        /* (3 links,) */
    const double *reference;    /* (count, 3, 3 links + 1): positions, velocities, accelerations, the feed last */
    const double *noise;        /* (count, 2, 3 links) */
    double *x;                  /* (2, 3 links + 1): positions, velocities; start, then end */
    double *states, *efforts;   /* (count, 2, 3 links + 1), (count, 3 links + 1) */
    double *work;               /* (9, 3 links + 1) */
} Loop;

/* Sine and cosine by Taylor's series on [-pi/4, pi/4] after reduction by quarter turns (pi/2 in three parts, the first
   two of 33 bits, so that their products with the number of turns are exact); for all angles at once. */
static void sines(long n, const double *restrict x, double *restrict s, double *restrict c)
{
    double far = 0.0;
    for (long i = 0; i < n; i++) far = fabs(x[i]) <= FAR ? far : 1.0;
    if (far > 0.0) {
        for (long i = 0; i < n; i++) {
            s[i] = sin(x[i]);
            c[i] = cos(x[i]);
        }
        return;
    }
    const double shift = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to an integer */
    for (long i = 0; i < n; i++) {
        double turns = (x[i] * 0x1.45f306dc9c883p-1 + shift) - shift;
        double r = ((x[i] - turns * 0x1.921fb5440p+0) - turns * 0x1.0b4611a60p-34) - turns * 0x1.3198a2e037073p-69;
        double z = r * r;
        double sine = r + r * z * (-1.0 / 6 + z * (1.0 / 120 + z * (-1.0 / 5040 + z * (1.0 / 362880
            + z * (-1.0 / 39916800 + z * (1.0 / 6227020800.0 + z * (-1.0 / 1307674368000.0)))))));
        double cosine = 1.0 - 0.5 * z + z * z * (1.0 / 24 + z * (-1.0 / 720 + z * (1.0 / 40320 + z * (-1.0 / 3628800
            + z * (1.0 / 479001600.0 + z * (-1.0 / 87178291200.0 + z * (1.0 / 20922789888000.0)))))));
        int quarter = (int)turns;
        double first = quarter & 1 ? cosine : sine, second = quarter & 1 ? sine : cosine;
        s[i] = quarter & 2 ? -first : first;
        c[i] = (quarter + 1) & 2 ? -second : second;
    }
}

/* The angles' sines and cosines, three and three a link. */
static void trigonometry(const Arm *arm, const double *q, double *trig)
{
    long n = 3 * arm->links;
    double *s = trig + 2 * n, *c = s + n;
    sines(n, q, s, c);
    for (long k = 0; k < arm->links; k++)
        for (int i = 0; i < 3; i++) {
            trig[6 * k + i] = s[3 * k + i];
            trig[6 * k + 3 + i] = c[3 * k + i];
        }
}

static double inverse(const Arm *arm, const double *q, const double *qd, const double *qdd, double feed, double *tau)
{
    long links = arm->links;
    double *trig = arm->work, *loads = trig + 12 * links, state[2][9];
    trigonometry(arm, q, trig);
    rnea_base((const double *[]){arm->world, &feed}, (double *[]){state[0]}, 0, 0, 0);
    for (long k = 0; k < links; k++) {
        const double *in[] = {state[k & 1], trig + 6 * k, qd + 3 * k, qdd + 3 * k, arm->bodies + 4 * k};
        rnea_outward(in, (double *[]){state[~k & 1], loads + 6 * k}, 0, 0, 0);
    }
    double force[2][6];
    rnea_tip((const double *[]){state[links & 1], arm->world}, (double *[]){force[links & 1]}, 0, 0, 0);
    for (long k = links - 1; k >= 0; k--) {
        const double *in[] = {force[~k & 1], trig + 6 * k, loads + 6 * k, qd + 3 * k, qdd + 3 * k,
                              arm->bodies + 4 * k, arm->drives + 6 * k};
        rnea_inward(in, (double *[]){force[k & 1], tau + 3 * k}, 0, 0, 0);
    }
    return force[0][0];
}

static double forward(const Arm *arm, const double *q, const double *qd, const double *tau, double thrust, double *qdd)
{
    long links = arm->links;
    double *trig = arm->work, *motion = trig + 12 * links, *solved = motion + 6 * links;
    double omega[2][3] = {{0}}, body[2][STATE], state[2][6], feed;
    trigonometry(arm, q, trig);
    for (long k = 0; k < links; k++) {
        const double *in[] = {omega[k & 1], trig + 6 * k, qd + 3 * k};
        aba_velocity(in, (double *[]){omega[~k & 1], motion + 6 * k}, 0, 0, 0);
    }
    aba_tip((const double *[]){arm->world}, (double *[]){body[links & 1]}, 0, 0, 0);
    for (long k = links - 1; k >= 0; k--) {
        const double *in[] = {body[~k & 1], trig + 6 * k, motion + 6 * k, tau + 3 * k, qd + 3 * k,
                              arm->bodies + 4 * k, arm->drives + 6 * k};
        aba_inertia(in, (double *[]){body[k & 1], solved + SOLVED * k}, 0, 0, 0);
    }
    aba_base((const double *[]){body[0], &thrust, arm->world}, (double *[]){state[0], &feed}, 0, 0, 0);
    for (long k = 0; k < links; k++) {
        const double *in[] = {state[k & 1], trig + 6 * k, motion + 6 * k, solved + SOLVED * k, arm->bodies + 4 * k};
        aba_acceleration(in, (double *[]){state[~k & 1], qdd + 3 * k}, 0, 0, 0);
    }
    return feed;
}

PUBLIC void inverse_dynamics(const Call *call)
{
    long n = 3 * call->arm->links;
    for (long i = 0; i < call->count; i++)
        call->out_feed[i] = inverse(call->arm, call->q + i * n, call->qd + i * n, call->third + i * n, call->feed[i],
                                    call->out + i * n);
}

PUBLIC void forward_dynamics(const Call *call)
{
    long n = 3 * call->arm->links;
    for (long i = 0; i < call->count; i++)
        call->out_feed[i] = forward(call->arm, call->q + i * n, call->qd + i * n, call->third + i * n, call->feed[i],
                                    call->out + i * n);
}

static double clamped(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

static double moved_mass(const Arm *arm)
{
    double mass = arm->world[3];
    for (long k = 0; k < arm->links; k++) mass += arm->bodies[4 * k];
    return mass;
}

/* The tracking law, held over a step: see controller.py. */
static void control(const Loop *loop, const double *reference, const double *noise, double *effort)
{
    long n = 3 * loop->model->links, m = n + 1;
    const double *x = loop->x, *v = x + m;
    double *q = loop->work, *qd = q + m, *wanted = qd + m, half = 0.5 * loop->step;
    double feed = loop->feed_kp * (reference[n] - x[n]) + loop->feed_kd * (reference[m + n] - v[n]);
    for (long i = 0; i < n; i++) {
        double seen = x[i] + noise[i], speed = v[i] + noise[n + i];
        double feedback = loop->kp * (reference[i] - seen) + loop->kd * (reference[m + i] - speed);
        if (loop->computed) {
            wanted[i] = reference[2 * m + i] + feedback;
            q[i] = seen + half * speed;
            qd[i] = speed + half * wanted[i];
        } else {
            wanted[i] = qd[i] = 0.0;
            q[i] = seen;
            effort[m + i] = feedback;
        }
    }
    if (loop->computed) {
        double base = reference[2 * m + n] + feed;
        effort[n] = inverse(loop->model, q, qd, wanted, base, effort);
        double lacking = clamped(effort[n], loop->feed_limit) - effort[n];
        if (lacking != 0.0) { /* torques for what the base can do */
            base += lacking / moved_mass(loop->model);
            effort[n] = inverse(loop->model, q, qd, wanted, base, effort);
        }
    } else {
        effort[n] = inverse(loop->model, q, qd, wanted, 0.0, effort) + feed;
        for (long i = 0; i < n; i++) effort[i] += effort[m + i];
    }
    for (long i = 0; i < n; i++) effort[i] = clamped(effort[i], loop->limit[i]);
    effort[n] = clamped(effort[n], loop->feed_limit);
}

/* One classical Runge-Kutta step of x'' = f(x, x') under held efforts. */
static void advance(const Loop *loop, const double *effort)
{
    long n = 3 * loop->plant->links, m = n + 1;
    double *x = loop->x, *v = x + m, *q = loop->work, *qd = q + m, *a = qd + m, *dx = a + m, *dv = dx + m;
    static const double at[] = {0.0, 0.5, 0.5, 1.0}, weight[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    double h = loop->step;
    memset(dx, 0, 2 * m * sizeof(double));
    for (int stage = 0; stage < 4; stage++) {
        double part = at[stage] * h;
        for (long i = 0; i < m; i++) {
            q[i] = stage ? x[i] + part * qd[i] : x[i];
            qd[i] = stage ? v[i] + part * a[i] : v[i];
        }
        a[n] = forward(loop->plant, q, qd, effort, effort[n], a);
        for (long i = 0; i < m; i++) {
            dx[i] += weight[stage] * qd[i];
            dv[i] += weight[stage] * a[i];
        }
    }
    for (long i = 0; i < m; i++) {
        x[i] += h * dx[i];
        v[i] += h * dv[i];
    }
}

PUBLIC void simulate(const Loop *loop)
{
    long n = 3 * loop->plant->links, m = n + 1;
    double *effort = loop->work + 5 * m;
    for (long s = 0; s < loop->count; s++) {
        if (s < loop->held) {
            memset(effort, 0, m * sizeof(double));
        } else {
            control(loop, loop->reference + 3 * m * s, loop->noise + 2 * n * s, effort);
            advance(loop, effort);
        }
        memcpy(loop->states + 2 * m * s, loop->x, 2 * m * sizeof(double));
        memcpy(loop->efforts + m * s, effort, m * sizeof(double));
    }
}
