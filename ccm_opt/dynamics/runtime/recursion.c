/* Inverse and forward dynamics along an arm of any number of links, around one link's functions.

   The functions of one link (rnea_base, rnea_outward, rnea_tip, rnea_inward, aba_velocity, aba_tip, aba_inertia,
   aba_base, aba_acceleration, and for what is fixed to it rnea_attached and aba_attached) are generated before this
   text, with BODY, the numbers of a link's body, and STATE and SOLVED, those that aba_inertia passes on and keeps for
   each link. Where joints are those of arcs (ARCS) there is no ABA: drives move them together, and forward dynamics
   solve for the accelerations of the drives. Arrays are those of the Python side: one row a link or a state,
   contiguous. */

/* Working memory of an arm, numbers a link: sines and cosines side by side (6) and as they are computed (6); then the
   loads (6) of the links and those of what is fixed to them (6) of the inverse dynamics, or the motion (6) and SOLVED
   numbers of the forward dynamics. */
#ifdef ARCS
#define SOLVED 6
#endif
#define WORK (18 + SOLVED)
PUBLIC const int64_t work_per_link = WORK;

typedef struct {
    int64_t links;
    const double *bodies; /* (links, BODY) */
    const double *drives; /* (links, 6) */
    const double *world;  /* (5,) */
    const double *attached; /* (links, 10), or missing */
    double *work;         /* (links, WORK) */
    int64_t coupled;        /* number of drives that move the revolutes together; 0 where each has its own */
    const double *coupling; /* derivatives of the revolutes by their values, (3 links, coupled) */
    const double *armature; /* inertia that is added to theirs, (coupled,); may be missing */
    double *reduced;        /* working memory, (4, 3 links) and (coupled + 1, coupled + 4) */
} Arm;

/* Number of coordinates in which the forward dynamics and the closed loop are computed, without a feed. */
static inline int64_t coordinates(const Arm *arm) { return arm->coupled ? arm->coupled : 3 * arm->links; }

typedef struct {
    const Arm *arm;
    int64_t count;
    const double *q;     /* (count, 3 links), for forward dynamics of coupled revolutes (count, coupled) */
    const double *qd;    /* likewise */
    const double *third; /* accelerations or torques, likewise */
    const double *feed;  /* acceleration of the base or thrust on it, (count,) */
    double *out;         /* torques or accelerations, likewise */
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

/* The angles' sines and cosines, three and three a link; of arcs the angles themselves. */
#ifdef ARCS
#define TRIG 3
static ALWAYS_INLINE const double *trigonometry(const Arm *arm, const double *q)
{
    (void)arm;
    return q;
}
#else
#define TRIG 6
static ALWAYS_INLINE const double *trigonometry(const Arm *arm, const double *q)
{
    int64_t n = 3 * arm->links;
    double *trig = arm->work;
    double *s = trig + 2 * n;
    double *c = s + n;
    sines(n, q, s, c);
    for (int64_t k = 0; k < arm->links; k++)
        for (int i = 0; i < 3; i++) {
            trig[6 * k + i] = s[3 * k + i];
            trig[6 * k + 3 + i] = c[3 * k + i];
        }
    return trig;
}
#endif

/* Add what is fixed to a link to what it passes on: a row of a number of values. */
static inline void add(const double *extra, int64_t width, double *sum)
{
    for (int64_t i = 0; i < width; i++) sum[i] += extra[i];
}

/* Torques, and the thrust as result: rnea.py. A state of the base replaces a feed where it is given, and then the force
   and moment on the base are put out. What a link passes on is written over what it was given two links ago. */
static WIDE double inverse_on(const Arm *arm, const double *q, const double *qd, const double *qdd, double feed,
                              const double *carried, double *tau, double *wrench)
{
    int64_t links = arm->links;
    double *loads = arm->work + 12 * links;
    double *fixed = loads + 6 * links;
    const double *trig = trigonometry(arm, q);

    double state[2][9];
    if (carried)
        memcpy(state[0], carried, sizeof(state[0]));
    else
        rnea_base((const double *[]){arm->world, &feed}, (double *[]){state[0]}, 0, 0, 0);
    for (int64_t k = 0; k < links; k++) {
        const double *in[] = {state[k & 1], row(trig, TRIG, k), row(qd, 3, k), row(qdd, 3, k), row(arm->bodies, BODY, k)};
        double *out[] = {state[(k + 1) & 1], row(loads, 6, k)};
        rnea_outward(in, out, 0, 0, 0);
        if (arm->attached)
            rnea_attached((const double *[]){state[(k + 1) & 1], row(arm->attached, 10, k)},
                          (double *[]){row(fixed, 6, k)}, 0, 0, 0);
    }

    double force[2][6];
    rnea_tip((const double *[]){state[links & 1], arm->world}, (double *[]){force[links & 1]}, 0, 0, 0);
    for (int64_t k = links - 1; k >= 0; k--) {
        if (arm->attached) add(row(fixed, 6, k), 6, force[(k + 1) & 1]);
        const double *in[] = {force[(k + 1) & 1], row(trig, TRIG, k), row(loads, 6, k), row(qd, 3, k), row(qdd, 3, k),
                              row(arm->bodies, BODY, k), row(arm->drives, 6, k)};
        double *out[] = {force[k & 1], row(tau, 3, k)};
        rnea_inward(in, out, 0, 0, 0);
    }
    if (wrench) memcpy(wrench, force[0], sizeof(force[0]));
    return force[0][0];
}

/* The same of coupled revolutes, of which values, rates and efforts are those of their drives. */
static double inverse(const Arm *arm, const double *q, const double *qd, const double *qdd, double feed, double *tau)
{
    int64_t m = arm->coupled, n = 3 * arm->links;
    if (!m) return inverse_on(arm, q, qd, qdd, feed, NULL, tau, NULL);
    const double *given[] = {q, qd, qdd};
    double *spread = arm->reduced;
    for (int part = 0; part < 3; part++)
        for (int64_t i = 0; i < n; i++) {
            double sum = 0.0;
            for (int64_t k = 0; k < m; k++) sum += arm->coupling[m * i + k] * given[part][k];
            spread[n * part + i] = sum;
        }
    double thrust = inverse_on(arm, spread, spread + n, spread + 2 * n, feed, NULL, spread + 3 * n, NULL);
    for (int64_t k = 0; k < m; k++) tau[k] = 0.0;
    for (int64_t i = 0; i < n; i++)
        for (int64_t k = 0; k < m; k++) tau[k] += arm->coupling[m * i + k] * spread[3 * n + i];
    for (int64_t k = 0; arm->armature && k < m; k++) tau[k] += arm->armature[k] * qdd[k];
    return thrust;
}

/* Accelerations of drives of coupled revolutes, and that of the base as result: M x = u - h, where each column of M is
   what a unit of an acceleration takes, by Cholesky's method. */
static double forward_of_drives(const Arm *arm, const double *q, const double *qd, const double *tau, double thrust,
                                double *qdd)
{
    int64_t m = arm->coupled, size = m + (arm->world[4] != 0.0), wide = m + 1;
    double *mass = arm->reduced + 12 * arm->links, *still = mass + wide * wide, *unit = still + wide, *right = unit + wide;
    for (int64_t k = 0; k < m; k++) unit[k] = 0.0;
    right[m] = thrust - inverse(arm, q, qd, unit, 0.0, right);
    for (int64_t k = 0; k < m; k++) right[k] = tau[k] - right[k];
    still[m] = inverse(arm, q, unit, unit, 0.0, still);
    double *rest = qdd; /* zero until the result stands there */
    for (int64_t k = 0; k < m; k++) rest[k] = 0.0;
    for (int64_t j = 0; j < size; j++) {
        double *column = mass + wide * j;
        if (j < m) unit[j] = 1.0;
        column[m] = inverse(arm, q, rest, unit, j < m ? 0.0 : 1.0, column);
        if (j < m) unit[j] = 0.0;
        for (int64_t i = 0; i <= m; i++) column[i] -= still[i];
    }
    for (int64_t j = 0; j < size; j++) { /* the lower triangle, row by row */
        double *row_j = mass + wide * j;
        for (int64_t i = 0; i <= j; i++) {
            double sum = row_j[i];
            for (int64_t k = 0; k < i; k++) sum -= row_j[k] * mass[wide * i + k];
            row_j[i] = i < j ? sum / mass[wide * i + i] : sqrt(sum);
        }
        for (int64_t k = 0; k < j; k++) right[j] -= row_j[k] * right[k];
        right[j] /= row_j[j];
    }
    for (int64_t j = size - 1; j >= 0; j--) {
        for (int64_t k = j + 1; k < size; k++) right[j] -= mass[wide * k + j] * right[k];
        right[j] /= mass[wide * j + j];
    }
    for (int64_t k = 0; k < m; k++) qdd[k] = right[k];
    return size > m ? right[m] : 0.0;
}

#ifdef ARCS
#define forward forward_of_drives
#else
/* Accelerations of the joints, and that of the base as result: aba.py. */
static WIDE double forward_of_joints(const Arm *arm, const double *q, const double *qd, const double *tau, double thrust, double *qdd)
{
    int64_t links = arm->links;
    double *motion = arm->work + 12 * links;
    double *solved = motion + 6 * links;
    const double *trig = trigonometry(arm, q);

    double omega[2][3] = {{0}};
    for (int64_t k = 0; k < links; k++) {
        const double *in[] = {omega[k & 1], row(trig, TRIG, k), row(qd, 3, k)};
        double *out[] = {omega[(k + 1) & 1], row(motion, 6, k)};
        aba_velocity(in, out, 0, 0, 0);
    }

    double body[2][STATE];
    aba_tip((const double *[]){arm->world}, (double *[]){body[links & 1]}, 0, 0, 0);
    for (int64_t k = links - 1; k >= 0; k--) {
        if (arm->attached) {
            double fixed[STATE];
            aba_attached((const double *[]){row(motion, 6, k), row(arm->attached, 10, k)}, (double *[]){fixed}, 0, 0, 0);
            add(fixed, STATE, body[(k + 1) & 1]);
        }
        const double *in[] = {body[(k + 1) & 1], row(trig, TRIG, k), row(motion, 6, k), row(tau, 3, k), row(qd, 3, k),
                              row(arm->bodies, BODY, k), row(arm->drives, 6, k)};
        double *out[] = {body[k & 1], row(solved, SOLVED, k)};
        aba_inertia(in, out, 0, 0, 0);
    }

    double feed;
    double state[2][6];
    aba_base((const double *[]){body[0], &thrust, arm->world}, (double *[]){state[0], &feed}, 0, 0, 0);
    for (int64_t k = 0; k < links; k++) {
        const double *in[] = {state[k & 1], row(trig, TRIG, k), row(motion, 6, k), row(solved, SOLVED, k),
                              row(arm->bodies, BODY, k)};
        double *out[] = {state[(k + 1) & 1], row(qdd, 3, k)};
        aba_acceleration(in, out, 0, 0, 0);
    }
    return feed;
}

static double forward(const Arm *arm, const double *q, const double *qd, const double *tau, double thrust, double *qdd)
{
    return arm->coupled ? forward_of_drives(arm, q, qd, tau, thrust, qdd) : forward_of_joints(arm, q, qd, tau, thrust, qdd);
}
#endif

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
    int64_t n = coordinates(call->arm);
    for (int64_t i = 0; i < call->count; i++)
        call->out_feed[i] = forward(call->arm, call->q + i * n, call->qd + i * n, call->third + i * n, call->feed[i],
                                    call->out + i * n);
}
