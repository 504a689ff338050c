/* The closed loop: simulation/controller.py says what it computes. Its m coordinates are the angles of all revolutes, 3
   links, or where drives move them together, the n values of the drives, and then those of the axes of the base. */

typedef struct {
    const Arm *plant;
    const Arm *model;
    const Arm *stiffened;  /* the model whose rotors have kd * step more inertia; for PD alone */
    int64_t count;         /* steps */
    int64_t held;          /* of these the first, in which the brakes hold the arm */
    int64_t computed;      /* whether the law is computed torque */
    double step;
    const double *kp;        /* (m,) */
    const double *kd;        /* (m,) */
    const double *limit;     /* (m,) */
    const double *carried;   /* (m - n,) inertia that each axis of the base moves, at most [kg, kg m²] */
    const double *reference; /* (count, 3, m): positions, velocities, accelerations */
    const double *noise;     /* (count, 2, n) */
    double *x;               /* (2, m): positions, velocities; start, then end */
    double *states;          /* (count, 2, m) */
    double *efforts;         /* (count, m) */
    double *work;            /* (loop_rows, m) */
} Loop;

/* Rows of a loop's working memory: five for a control or for an integration, one for the efforts. */
enum { EFFORT_ROW = 5, ROWS };
PUBLIC const int64_t loop_rows = ROWS;

static double clamped(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

/* Efforts of computed torque, before they saturate. */
static void computed_torque(const Loop *loop, const double *reference, const double *noise, double *effort)
{
    int64_t n = coordinates(loop->model);
    int64_t m = n + of_base(loop->model);
    const double *x = loop->x;
    const double *v = x + m;
    double *middle_q = loop->work;
    double *middle_qd = middle_q + m;
    double *a = middle_qd + m;
    double half = 0.5 * loop->step;
    for (int64_t i = 0; i < m; i++) {
        double q = i < n ? x[i] + noise[i] : x[i]; /* the base is measured exactly */
        double qd = i < n ? v[i] + noise[n + i] : v[i];
        a[i] = reference[2 * m + i] + (loop->kp[i] * (reference[i] - q) + loop->kd[i] * (reference[m + i] - qd));
        middle_q[i] = q + half * qd;
        middle_qd[i] = qd + half * a[i];
    }
    inverse(loop->model, middle_q, middle_qd, a, effort);

    int lacks = 0;
    for (int64_t i = n; i < m; i++) {
        double lacking = clamped(effort[i], loop->limit[i]) - effort[i];
        a[i] += lacking / loop->carried[i - n];
        lacks |= lacking != 0.0;
    }
    if (lacks) inverse(loop->model, middle_q, middle_qd, a, effort); /* torques for what the base can do */
}

/* Efforts of PD with the gravity torques of the pose, before they saturate: errors are those at the end of the step. */
static void proportional_derivative(const Loop *loop, const double *reference, const double *noise, double *effort)
{
    int64_t n = coordinates(loop->model);
    int64_t m = n + of_base(loop->model);
    const double *x = loop->x;
    const double *v = x + m;
    double h = loop->step;
    double *q = loop->work;
    double *qd = q + m;
    double *rest = qd + m;
    double *a = rest + m;
    for (int64_t i = 0; i < m; i++) {
        q[i] = i < n ? x[i] + noise[i] : x[i];
        qd[i] = i < n ? v[i] + noise[n + i] : v[i];
        rest[i] = 0.0;
    }
    inverse(loop->model, q, rest, rest, effort);
    for (int64_t i = n; i < m; i++) {
        double feedback = loop->kp[i] * (reference[i] - x[i]) + loop->kd[i] * (reference[m + i] - v[i]);
        effort[i] = clamped(effort[i] + feedback, loop->limit[i]);
    }
    for (int64_t i = 0; i < n; i++) {
        double rate = reference[m + i] - qd[i];
        double ahead = reference[i] - q[i] + h * rate;
        effort[i] += loop->kp[i] * ahead + loop->kd[i] * (rate + h * reference[2 * m + i]);
    }
    forward(loop->stiffened, q, qd, effort, a);
    for (int64_t i = 0; i < n; i++) effort[i] -= h * loop->kd[i] * a[i];
}

/* The efforts that are held over a step. */
static void control(const Loop *loop, const double *reference, const double *noise, double *effort)
{
    int64_t m = coordinates(loop->model) + of_base(loop->model);
    if (loop->computed)
        computed_torque(loop, reference, noise, effort);
    else
        proportional_derivative(loop, reference, noise, effort);
    for (int64_t i = 0; i < m; i++) effort[i] = clamped(effort[i], loop->limit[i]);
}

/* One classical Runge-Kutta step of x'' = f(x, x') under held efforts. */
static void advance(const Loop *loop, const double *effort)
{
    static const double at[] = {0.0, 0.5, 0.5, 1.0};
    static const double weight[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    int64_t m = coordinates(loop->plant) + of_base(loop->plant);
    double h = loop->step;
    double *x = loop->x;
    double *v = x + m;
    double *q = loop->work;
    double *qd = q + m;
    double *a = qd + m;
    double *dx = a + m;
    double *dv = dx + m;
    memset(dx, 0, 2 * m * sizeof(double));
    for (int stage = 0; stage < 4; stage++) {
        double part = at[stage] * h;
        for (int64_t i = 0; i < m; i++) { /* qd and a are those of the stage before: in the first there is none */
            q[i] = stage ? x[i] + part * qd[i] : x[i];
            qd[i] = stage ? v[i] + part * a[i] : v[i];
        }
        forward(loop->plant, q, qd, effort, a);
        for (int64_t i = 0; i < m; i++) {
            dx[i] += weight[stage] * qd[i];
            dv[i] += weight[stage] * a[i];
        }
    }
    for (int64_t i = 0; i < m; i++) {
        x[i] += h * dx[i];
        v[i] += h * dv[i];
    }
}

PUBLIC void simulate(const Loop *loop)
{
    int64_t n = coordinates(loop->plant);
    int64_t m = n + of_base(loop->plant);
    double *effort = loop->work + EFFORT_ROW * m;
    for (int64_t s = 0; s < loop->count; s++) {
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
