/* Inverse and forward dynamics along an arm of any number of links, around one link's functions.

   The functions of one link (rnea_base, rnea_outward, rnea_tip, rnea_inward, aba_velocity, aba_tip, aba_inertia,
   aba_base, aba_acceleration) are generated before this text, with STATE and SOLVED, the numbers that aba_inertia
   passes on and keeps for each link. Arrays are those of the Python side: one row a link or a state, contiguous. */

/* Working memory of an arm, numbers a link: sines and cosines side by side (6) and as they are computed (6); then the
   loads (6) of the inverse dynamics, or the motion (6) and SOLVED numbers of the forward dynamics. */
#define WORK (18 + SOLVED)
PUBLIC const int64_t work_per_link = WORK;

typedef struct {
    int64_t links;
    const double *bodies; /* (links, 4) */
    const double *drives; /* (links, 6) */
    const double *world;  /* (5,) */
    double *work;         /* (links, WORK) */
} Arm;

typedef struct {
    const Arm *arm;
    int64_t count;
    const double *q;     /* (count, 3 links) */
    const double *qd;    /* (count, 3 links) */
    const double *third; /* accelerations or torques, (count, 3 links) */
    const double *feed;  /* acceleration of the base or thrust on it, (count,) */
    double *out;         /* torques or accelerations, (count, 3 links) */
    double *out_feed;    /* thrust or acceleration of the base, (count,) */
    const double *carried; /* for a base that axes carry, else missing: its state (ω, ω̇, a less gravity), (count, 9) */
    double *wrench;        /* out: force and moment on that base, (count, 6) */
} Call;

/* Row k of an array. Generated code tests every pointer for null before each access, for callers that leave arguments
   out. Here none is: saying so lets the compiler drop the tests, which cost RNEA 7 % and ABA 14 %. */
static inline double *row(const double *array, int64_t width, int64_t k)
{
    const double *start = array + width * k;
    if (!start) __builtin_unreachable();
    return (double *)start;
}

/* The angles' sines and cosines, three and three a link. */
static ALWAYS_INLINE void trigonometry(const Arm *arm, const double *q, double *trig)
{
    int64_t n = 3 * arm->links;
    double *s = trig + 2 * n;
    double *c = s + n;
    sines(n, q, s, c);
    for (int64_t k = 0; k < arm->links; k++)
        for (int i = 0; i < 3; i++) {
            trig[6 * k + i] = s[3 * k + i];
            trig[6 * k + 3 + i] = c[3 * k + i];
        }
}

/* Torques, and the thrust as result: rnea.py. A state of the base replaces a feed where it is given, and then the force
   and moment on the base are put out. What a link passes on is written over what it was given two links ago. */
static WIDE double inverse_on(const Arm *arm, const double *q, const double *qd, const double *qdd, double feed,
                              const double *carried, double *tau, double *wrench)
{
    int64_t links = arm->links;
    double *trig = arm->work;
    double *loads = trig + 12 * links;
    trigonometry(arm, q, trig);

    double state[2][9];
    if (carried)
        memcpy(state[0], carried, sizeof(state[0]));
    else
        rnea_base((const double *[]){arm->world, &feed}, (double *[]){state[0]}, 0, 0, 0);
    for (int64_t k = 0; k < links; k++) {
        const double *in[] = {state[k & 1], row(trig, 6, k), row(qd, 3, k), row(qdd, 3, k), row(arm->bodies, 4, k)};
        double *out[] = {state[(k + 1) & 1], row(loads, 6, k)};
        rnea_outward(in, out, 0, 0, 0);
    }

    double force[2][6];
    rnea_tip((const double *[]){state[links & 1], arm->world}, (double *[]){force[links & 1]}, 0, 0, 0);
    for (int64_t k = links - 1; k >= 0; k--) {
        const double *in[] = {force[(k + 1) & 1], row(trig, 6, k), row(loads, 6, k), row(qd, 3, k), row(qdd, 3, k),
                              row(arm->bodies, 4, k), row(arm->drives, 6, k)};
        double *out[] = {force[k & 1], row(tau, 3, k)};
        rnea_inward(in, out, 0, 0, 0);
    }
    if (wrench) memcpy(wrench, force[0], sizeof(force[0]));
    return force[0][0];
}

static double inverse(const Arm *arm, const double *q, const double *qd, const double *qdd, double feed, double *tau)
{
    return inverse_on(arm, q, qd, qdd, feed, NULL, tau, NULL);
}

/* Accelerations of the joints, and that of the base as result: aba.py. */
static WIDE double forward(const Arm *arm, const double *q, const double *qd, const double *tau, double thrust, double *qdd)
{
    int64_t links = arm->links;
    double *trig = arm->work;
    double *motion = trig + 12 * links;
    double *solved = motion + 6 * links;
    trigonometry(arm, q, trig);

    double omega[2][3] = {{0}};
    for (int64_t k = 0; k < links; k++) {
        const double *in[] = {omega[k & 1], row(trig, 6, k), row(qd, 3, k)};
        double *out[] = {omega[(k + 1) & 1], row(motion, 6, k)};
        aba_velocity(in, out, 0, 0, 0);
    }

    double body[2][STATE];
    aba_tip((const double *[]){arm->world}, (double *[]){body[links & 1]}, 0, 0, 0);
    for (int64_t k = links - 1; k >= 0; k--) {
        const double *in[] = {body[(k + 1) & 1], row(trig, 6, k), row(motion, 6, k), row(tau, 3, k), row(qd, 3, k),
                              row(arm->bodies, 4, k), row(arm->drives, 6, k)};
        double *out[] = {body[k & 1], row(solved, SOLVED, k)};
        aba_inertia(in, out, 0, 0, 0);
    }

    double feed;
    double state[2][6];
    aba_base((const double *[]){body[0], &thrust, arm->world}, (double *[]){state[0], &feed}, 0, 0, 0);
    for (int64_t k = 0; k < links; k++) {
        const double *in[] = {state[k & 1], row(trig, 6, k), row(motion, 6, k), row(solved, SOLVED, k),
                              row(arm->bodies, 4, k)};
        double *out[] = {state[(k + 1) & 1], row(qdd, 3, k)};
        aba_acceleration(in, out, 0, 0, 0);
    }
    return feed;
}

PUBLIC void inverse_dynamics(const Call *call)
{
    int64_t n = 3 * call->arm->links;
    for (int64_t i = 0; i < call->count; i++)
        call->out_feed[i] = inverse_on(call->arm, call->q + i * n, call->qd + i * n, call->third + i * n, call->feed[i],
                                       call->carried ? call->carried + 9 * i : NULL, call->out + i * n,
                                       call->wrench ? call->wrench + 6 * i : NULL);
}

PUBLIC void forward_dynamics(const Call *call)
{
    int64_t n = 3 * call->arm->links;
    for (int64_t i = 0; i < call->count; i++)
        call->out_feed[i] = forward(call->arm, call->q + i * n, call->qd + i * n, call->third + i * n, call->feed[i],
                                    call->out + i * n);
}
