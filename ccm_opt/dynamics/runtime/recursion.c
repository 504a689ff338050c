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
    const int64_t *first;   /* index of the first link that each moves, (coupled,) */
    const double *armature; /* inertia that is added to theirs, (coupled,); may be missing */
    double *reduced;        /* working memory, (4, 3 links) and (n, n + 4) for n coordinates and axes */
    int64_t axes;           /* number of axes between the ground and the base; 0 for none but a feed axis */
    const double *axis;     /* (axes, 7): 1 for a revolute, direction, point; in the world where all are at zero */
    const double *inertia;  /* (axes,) of the drives of these axes */
    const double *ground;   /* (15,): gravity, place and rotation of the base where all axes are at zero */
} Arm;

enum { MOST_AXES = 6 };

/* Number of coordinates in which the forward dynamics and the closed loop are computed, without those of the base. */
static inline int64_t coordinates(const Arm *arm) { return arm->coupled ? arm->coupled : 3 * arm->links; }

/* Number of coordinates of the base: of its axes, or one of a feed axis, which stays where there is none. */
static inline int64_t of_base(const Arm *arm) { return arm->axes ? arm->axes : 1; }

/* The base as axes carry it, in its own frame. */
typedef struct {
    double state[9];             /* its (ω, ω̇, a less gravity) */
    double twists[MOST_AXES][6]; /* for a unit of each axis the rates of turn and of its place */
} Base;

typedef struct {
    const Arm *arm;
    int64_t count;
    const double *q;     /* (count, 3 links), for forward dynamics of coupled revolutes (count, coupled) */
    const double *qd;    /* likewise */
    const double *third; /* accelerations or torques, likewise */
    const double *place; /* positions of the axes that carry the base, (count, axes); of a feed axis none is needed */
    const double *pace;  /* their velocities, likewise */
    const double *feed;  /* accelerations of the base along its axes, or efforts of these, (count, of_base) */
    double *out;         /* torques or accelerations, likewise */
    double *out_feed;    /* efforts or accelerations of the axes, (count, of_base) */
    double *packed;      /* working memory of forward dynamics, (4, coordinates + of_base) */
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

static inline double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void add_cross(const double *a, const double *b, double *sum)
{
    sum[0] += a[1] * b[2] - a[2] * b[1];
    sum[1] += a[2] * b[0] - a[0] * b[2];
    sum[2] += a[0] * b[1] - a[1] * b[0];
}

/* out = M v of a (3, 3) matrix, row by row. */
static inline void turned(const double *M, const double *v, double *out)
{
    for (int i = 0; i < 3; i++) out[i] = dot3(M + 3 * i, v);
}

/* Where axes carry the base, and how it moves: a product of exponentials, as in robot/base_axes.py. */
static void carried_base(const Arm *arm, const double *place, const double *pace, const double *gain, Base *base)
{
    double R[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, shift[3] = {0}, along[MOST_AXES][3], at[MOST_AXES][3];
    for (int64_t k = 0; k < arm->axes; k++) {
        const double *axis = arm->axis + 7 * k, *z = axis + 1, *c = axis + 4;
        turned(R, z, along[k]);
        turned(R, c, at[k]);
        add(shift, 3, at[k]);
        if (axis[0] == 0.0) {
            for (int i = 0; i < 3; i++) shift[i] += place[k] * along[k][i];
            continue;
        }
        /* R ← R exp(q ẑ), by columns R e + sin q R (z × e) + (1 − cos q) R (z × (z × e)); the axis stays where it is. */
        double sine = sin(place[k]), rest = 2.0 * sin(0.5 * place[k]) * sin(0.5 * place[k]), turn[9];
        for (int j = 0; j < 3; j++) {
            double e[3] = {j == 0, j == 1, j == 2}, once[3] = {0}, twice[3] = {0};
            add_cross(z, e, once);
            add_cross(z, once, twice);
            for (int i = 0; i < 3; i++) turn[3 * i + j] = e[i] + sine * once[i] + rest * twice[i];
        }
        double after[9];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                after[3 * i + j] = R[3 * i] * turn[j] + R[3 * i + 1] * turn[3 + j] + R[3 * i + 2] * turn[6 + j];
        memcpy(R, after, sizeof R);
        double moved[3];
        turned(R, c, moved);
        for (int i = 0; i < 3; i++) shift[i] = at[k][i] - moved[i];
    }
    const double *rest_rotation = arm->ground + 6;
    double frame[9], p[3]; /* of the base: columns of the frame are its axes in the world */
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            frame[3 * i + j] = R[3 * i] * rest_rotation[j] + R[3 * i + 1] * rest_rotation[3 + j] + R[3 * i + 2] * rest_rotation[6 + j];
    turned(R, arm->ground + 3, p);
    add(shift, 3, p);

    /* Rate of turn, its derivative, and the acceleration of the base, which an axis turns with all that is beyond it. */
    double w[3] = {0}, dw[3] = {0}, a[3] = {-arm->ground[0], -arm->ground[1], -arm->ground[2]};
    double unit[MOST_AXES][6] = {{0}};
    for (int64_t k = 0; k < arm->axes; k++) {
        double *angular = unit[k], *linear = unit[k] + 3;
        if (arm->axis[7 * k] == 0.0) {
            memcpy(linear, along[k], 3 * sizeof(double));
        } else {
            double lever[3] = {p[0] - at[k][0], p[1] - at[k][1], p[2] - at[k][2]};
            memcpy(angular, along[k], 3 * sizeof(double));
            add_cross(along[k], lever, linear);
        }
        double turn[3] = {pace[k] * angular[0], pace[k] * angular[1], pace[k] * angular[2]};
        double move[3] = {pace[k] * linear[0], pace[k] * linear[1], pace[k] * linear[2]};
        for (int i = 0; i < 3; i++) {
            dw[i] += gain[k] * angular[i];
            a[i] += gain[k] * linear[i];
        }
        double both[3] = {2.0 * w[0] + turn[0], 2.0 * w[1] + turn[1], 2.0 * w[2] + turn[2]};
        add_cross(w, turn, dw);
        add_cross(both, move, a); /* ∂²p/∂q_j∂q_k = z_j × ∂p/∂q_k for j up to k */
        add(turn, 3, w);
    }
    double *parts[] = {w, dw, a};
    for (int part = 0; part < 3; part++)
        for (int i = 0; i < 3; i++)
            base->state[3 * part + i] = frame[i] * parts[part][0] + frame[3 + i] * parts[part][1] + frame[6 + i] * parts[part][2];
    for (int64_t k = 0; k < arm->axes; k++)
        for (int part = 0; part < 6; part += 3)
            for (int i = 0; i < 3; i++)
                base->twists[k][part + i] = frame[i] * unit[k][part] + frame[3 + i] * unit[k][part + 1] + frame[6 + i] * unit[k][part + 2];
}

/* Torques, and efforts of the axes of the base: rnea.py. What a link passes on is written over what it was given two
   links ago. */
static WIDE void inverse_on(const Arm *arm, const double *q, const double *qd, const double *qdd, const double *place,
                            const double *pace, const double *gain, double *tau, double *effort)
{
    int64_t links = arm->links;
    double *loads = arm->work + 12 * links;
    double *fixed = loads + 6 * links;
    const double *trig = trigonometry(arm, q);

    double state[2][9];
    Base base;
    if (arm->axes) {
        carried_base(arm, place, pace, gain, &base);
        memcpy(state[0], base.state, sizeof base.state);
    } else {
        rnea_base((const double *[]){arm->world, gain}, (double *[]){state[0]}, 0, 0, 0);
    }
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
    if (!arm->axes) effort[0] = force[0][0];
    for (int64_t k = 0; k < arm->axes; k++) /* force and moment on the base */
        effort[k] = dot3(base.twists[k] + 3, force[0]) + dot3(base.twists[k], force[0] + 3) + arm->inertia[k] * gain[k];
}

/* The same for coordinates and, behind them, those of the base; of coupled revolutes they are those of their drives. */
static void inverse(const Arm *arm, const double *q, const double *qd, const double *qdd, double *tau)
{
    int64_t m = coordinates(arm), n = 3 * arm->links;
    if (!arm->coupled) {
        inverse_on(arm, q, qd, qdd, q + m, qd + m, qdd + m, tau, tau + m);
        return;
    }
    const double *given[] = {q, qd, qdd};
    double *spread = arm->reduced;
    for (int part = 0; part < 3; part++)
        for (int64_t i = 0; i < n; i++) {
            double sum = 0.0;
            for (int64_t k = 0; k < m; k++) sum += arm->coupling[m * i + k] * given[part][k];
            spread[n * part + i] = sum;
        }
    inverse_on(arm, spread, spread + n, spread + 2 * n, q + m, qd + m, qdd + m, spread + 3 * n, tau + m);
    for (int64_t k = 0; k < m; k++) tau[k] = 0.0;
    for (int64_t i = 0; i < n; i++)
        for (int64_t k = 0; k < m; k++) tau[k] += arm->coupling[m * i + k] * spread[3 * n + i];
    for (int64_t k = 0; arm->armature && k < m; k++) tau[k] += arm->armature[k] * qdd[k];
}

/* Solve M x = b in place of b, for a symmetric positive definite matrix of which the lower triangle is given, row by row,
   and overwritten: Cholesky's method. */
static void solve(int64_t size, int64_t wide, double *mass, double *b)
{
    for (int64_t j = 0; j < size; j++) {
        double *row_j = mass + wide * j;
        for (int64_t i = 0; i <= j; i++) {
            double sum = row_j[i];
            for (int64_t k = 0; k < i; k++) sum -= row_j[k] * mass[wide * i + k];
            row_j[i] = i < j ? sum / mass[wide * i + i] : sqrt(sum);
        }
        for (int64_t k = 0; k < j; k++) b[j] -= row_j[k] * b[k];
        b[j] /= row_j[j];
    }
    for (int64_t j = size - 1; j >= 0; j--) {
        for (int64_t k = j + 1; k < size; k++) b[j] -= mass[wide * k + j] * b[k];
        b[j] /= mass[wide * j + j];
    }
}

/* Efforts of drives for a unit of the acceleration of one, at rest and without gravity: of those that first move the same
   link or one beyond it, which is a column of M from the diagonal on. It goes into the lower triangle of M. */
static WIDE void mass_column(const Arm *arm, const double *trig, int64_t drive, int64_t wide, double *mass)
{
    static const double rest[9] = {0};
    int64_t links = arm->links, m = arm->coupled;
    const int64_t *first = arm->first;
    double *gain = arm->reduced + 3 * links, *tau = gain + 3 * links;
    double *loads = arm->work + 12 * links, *fixed = loads + 6 * links;
    double state[2][9], force[2][6];
    memcpy(state[first[drive] & 1], rest, sizeof rest);
    for (int64_t k = first[drive]; k < links; k++) {
        for (int64_t i = 3 * k; i < 3 * k + 3; i++) gain[i] = arm->coupling[m * i + drive];
        const double *in[] = {state[k & 1], row(trig, TRIG, k), rest, row(gain, 3, k), row(arm->bodies, BODY, k)};
        double *out[] = {state[(k + 1) & 1], row(loads, 6, k)};
        rnea_outward(in, out, 0, 0, 0);
        if (arm->attached)
            rnea_attached((const double *[]){state[(k + 1) & 1], row(arm->attached, 10, k)},
                          (double *[]){row(fixed, 6, k)}, 0, 0, 0);
    }
    rnea_tip((const double *[]){state[links & 1], arm->world}, (double *[]){force[links & 1]}, 0, 0, 0);
    for (int64_t k = links - 1; k >= first[drive]; k--) {
        if (arm->attached) add(row(fixed, 6, k), 6, force[(k + 1) & 1]);
        const double *in[] = {force[(k + 1) & 1], row(trig, TRIG, k), row(loads, 6, k), rest, row(gain, 3, k),
                              row(arm->bodies, BODY, k), row(arm->drives, 6, k)};
        double *out[] = {force[k & 1], row(tau, 3, k)};
        rnea_inward(in, out, 0, 0, 0);
    }
    for (int64_t j = 0; j < m; j++) {
        if (first[j] < first[drive]) continue;
        double sum = arm->armature && j == drive ? arm->armature[j] : 0.0;
        for (int64_t i = 3 * first[j]; i < 3 * links; i++) sum += arm->coupling[m * i + j] * tau[i];
        mass[j > drive ? wide * j + drive : wide * drive + j] = sum;
    }
}

/* Accelerations of drives of coupled revolutes and of the base, from their efforts: M x = u - h, where each column of M is
   what a unit of an acceleration takes. */
static void forward_of_drives(const Arm *arm, const double *q, const double *qd, const double *tau, double *qdd)
{
    int64_t m = coordinates(arm), wide = m + of_base(arm), size = arm->axes || arm->world[4] != 0.0 ? wide : m;
    double *mass = arm->reduced + 12 * arm->links, *still = mass + wide * wide, *unit = still + wide, *right = unit + wide;
    double *rest = qdd; /* zero until the result stands there */
    for (int64_t k = 0; k < wide; k++) unit[k] = rest[k] = 0.0;
    inverse(arm, q, qd, unit, right);
    for (int64_t j = 0; j < size; j++) right[j] = tau[j] - right[j];
    if (size > m) inverse(arm, q, rest, unit, still);
    for (int64_t j = m; j < size; j++) { /* of the base, which moves all links, with gravity and without */
        double *column = mass + wide * j;
        unit[j] = 1.0;
        inverse(arm, q, rest, unit, column);
        unit[j] = 0.0;
        for (int64_t i = 0; i < wide; i++) column[i] -= still[i];
    }
    const double *trig = trigonometry(arm, arm->reduced);
    for (int64_t j = 0; j < m; j++) mass_column(arm, trig, j, wide, mass);
    solve(size, wide, mass, right);
    memcpy(qdd, right, size * sizeof(double));
}

#ifdef ARCS
#define forward forward_of_drives
#else
/* The base's accelerations (ω̇, a less gravity) and those of the axes that carry it, from what the whole arm is to it, an
   articulated body with the moment and force A (ω̇, a) + P, and the efforts of the axes. */
static void moved_base(const Arm *arm, const Base *base, const double *packed, const double *effort, double *gain,
                       double *state)
{
    double A[6][6], mass[MOST_AXES * MOST_AXES], held[6];
    for (int i = 0; i < 6; i++)
        for (int j = i; j < 6; j++) A[i][j] = A[j][i] = *packed++;
    for (int i = 0; i < 6; i++) held[i] = packed[i] + dot3(A[i], base->state + 3) + dot3(A[i] + 3, base->state + 6);
    for (int64_t k = 0; k < arm->axes; k++) {
        const double *twist = base->twists[k];
        double moved[6];
        for (int i = 0; i < 6; i++) moved[i] = dot3(A[i], twist) + dot3(A[i] + 3, twist + 3);
        gain[k] = effort[k] - dot3(twist, held) - dot3(twist + 3, held + 3);
        for (int64_t j = 0; j < arm->axes; j++)
            mass[arm->axes * k + j] = dot3(base->twists[j], moved) + dot3(base->twists[j] + 3, moved + 3);
        mass[(arm->axes + 1) * k] += arm->inertia[k];
    }
    solve(arm->axes, arm->axes, mass, gain);
    memcpy(state, base->state + 3, 6 * sizeof(double));
    for (int64_t k = 0; k < arm->axes; k++)
        for (int i = 0; i < 6; i++) state[i] += gain[k] * base->twists[k][i];
}

/* Accelerations of the joints and, behind them, of the base, from their efforts: aba.py. */
static WIDE void forward_of_joints(const Arm *arm, const double *q, const double *qd, const double *tau, double *qdd)
{
    int64_t links = arm->links, n = 3 * links;
    double *motion = arm->work + 12 * links;
    double *solved = motion + 6 * links;
    const double *trig = trigonometry(arm, q);

    double omega[2][3] = {{0}};
    Base base;
    if (arm->axes) {
        static const double none[MOST_AXES] = {0};
        carried_base(arm, q + n, qd + n, none, &base);
        memcpy(omega[0], base.state, sizeof omega[0]);
    }
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

    double state[2][6];
    if (arm->axes)
        moved_base(arm, &base, body[0], tau + n, qdd + n, state[0]);
    else
        aba_base((const double *[]){body[0], tau + n, arm->world}, (double *[]){state[0], qdd + n}, 0, 0, 0);
    for (int64_t k = 0; k < links; k++) {
        const double *in[] = {state[k & 1], row(trig, TRIG, k), row(motion, 6, k), row(solved, SOLVED, k),
                              row(arm->bodies, BODY, k)};
        double *out[] = {state[(k + 1) & 1], row(qdd, 3, k)};
        aba_acceleration(in, out, 0, 0, 0);
    }
}

static void forward(const Arm *arm, const double *q, const double *qd, const double *tau, double *qdd)
{
    (arm->coupled ? forward_of_drives : forward_of_joints)(arm, q, qd, tau, qdd);
}
#endif

PUBLIC void inverse_dynamics(const Call *call)
{
    int64_t n = 3 * call->arm->links, axes = call->arm->axes, width = of_base(call->arm);
    for (int64_t i = 0; i < call->count; i++)
        inverse_on(call->arm, call->q + i * n, call->qd + i * n, call->third + i * n, call->place + i * axes,
                   call->pace + i * axes, call->feed + i * width, call->out + i * n, call->out_feed + i * width);
}

/* One state at a time, with the base behind the coordinates: in `packed`, (4, coordinates + of_base). */
PUBLIC void forward_dynamics(const Call *call)
{
    const Arm *arm = call->arm;
    int64_t n = coordinates(arm), axes = arm->axes, width = of_base(arm), wide = n + width;
    double *q = call->packed, *qd = q + wide, *tau = qd + wide, *qdd = tau + wide;
    for (int64_t i = 0; i < call->count; i++) {
        memcpy(q, call->q + i * n, n * sizeof(double));
        memcpy(qd, call->qd + i * n, n * sizeof(double));
        memcpy(tau, call->third + i * n, n * sizeof(double));
        memcpy(q + n, call->place + i * axes, axes * sizeof(double));
        memcpy(qd + n, call->pace + i * axes, axes * sizeof(double));
        memcpy(tau + n, call->feed + i * width, width * sizeof(double));
        forward(arm, q, qd, tau, qdd);
        memcpy(call->out + i * n, qdd, n * sizeof(double));
        memcpy(call->out_feed + i * width, qdd + n, width * sizeof(double));
    }
}
