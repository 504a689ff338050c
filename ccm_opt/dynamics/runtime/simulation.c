/* The closed loop: simulation/controller.py says what it computes. It has n coordinates and then the feed: the angles of
   all revolutes, 3 links, or where drives move them together, the values of the drives. */

typedef struct {
    const Arm *plant;
    const Arm *model;
    const Arm *stiffened;  /* the model whose rotors have kd * step more inertia; for PD alone */
    int64_t count;         /* steps */
    int64_t held;          /* of these the first, in which the brakes hold the arm */
    int64_t computed;      /* whether the law is computed torque */
    double step;
    double feed_kp;
    double feed_kd;
    double feed_limit;
    const double *kp;        /* (n,) */
    const double *kd;        /* (n,) */
    const double *limit;     /* (n,) */
    const double *reference; /* (count, 3, n + 1): positions, velocities, accelerations, the feed last */
    const double *noise;     /* (count, 2, n) */
    double *x;               /* (2, n + 1): positions, velocities; start, then end */
    double *states;          /* (count, 2, n + 1) */
    double *efforts;         /* (count, n + 1) */
    double *work;            /* (loop_rows, n + 1) */
} Loop;

/* Rows of a loop's working memory: five for a control or for an integration, one for the efforts. */
enum { EFFORT_ROW = 5, ROWS };
PUBLIC const int64_t loop_rows = ROWS;

static double clamped(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

static double moved_mass(const Arm *arm)
{
    double mass = arm->world[3];
    for (int64_t k = 0; k < arm->links; k++)
        mass += arm->bodies[BODY * k] + (arm->attached ? arm->attached[10 * k] : 0.0);
    return mass;
}

/* Efforts of computed torque, before they saturate. */
static void computed_torque(const Loop *loop, const double *reference, const double *noise, double *effort)
{
    int64_t n = coordinates(loop->model);
    int64_t m = n + 1;
    const double *x = loop->x;
    const double *v = x + m;
    double *middle_q = loop->work;
    double *middle_qd = middle_q + m;
    double *a = middle_qd + m;
    double half = 0.5 * loop->step;
    for (int64_t i = 0; i < n; i++) {
        double q = x[i] + noise[i];
        double qd = v[i] + noise[n + i];
        a[i] = reference[2 * m + i] + (loop->kp[i] * (reference[i] - q) + loop->kd[i] * (reference[m + i] - qd));
        middle_q[i] = q + half * qd;
        middle_qd[i] = qd + half * a[i];
    }
    double feed = loop->feed_kp * (reference[n] - x[n]) + loop->feed_kd * (reference[m + n] - v[n]);
    double a_feed = reference[2 * m + n] + feed;
    effort[n] = inverse(loop->model, middle_q, middle_qd, a, a_feed, effort);

    double lacking = clamped(effort[n], loop->feed_limit) - effort[n];
    if (lacking != 0.0) { /* torques for what the base can do */
        a_feed += lacking / moved_mass(loop->model);
        effort[n] = inverse(loop->model, middle_q, middle_qd, a, a_feed, effort);
    }
}

/* Efforts of PD with the gravity torques of the pose, before they saturate: errors are those at the end of the step. */
static void proportional_derivative(const Loop *loop, const double *reference, const double *noise, double *effort)
{
    int64_t n = coordinates(loop->model);
    int64_t m = n + 1;
    const double *x = loop->x;
    const double *v = x + m;
    double h = loop->step;
    double *q = loop->work;
    double *qd = q + m;
    double *rest = qd + m;
    double *a = rest + m;
    for (int64_t i = 0; i < n; i++) {
        q[i] = x[i] + noise[i];
        qd[i] = v[i] + noise[n + i];
        rest[i] = 0.0;
    }
    double feed = loop->feed_kp * (reference[n] - x[n]) + loop->feed_kd * (reference[m + n] - v[n]);
    effort[n] = clamped(inverse(loop->model, q, rest, rest, 0.0, effort) + feed, loop->feed_limit);
    for (int64_t i = 0; i < n; i++) {
        double rate = reference[m + i] - qd[i];
        double ahead = reference[i] - q[i] + h * rate;
        effort[i] += loop->kp[i] * ahead + loop->kd[i] * (rate + h * reference[2 * m + i]);
    }
    forward(loop->stiffened, q, qd, effort, effort[n], a);
    for (int64_t i = 0; i < n; i++) effort[i] -= h * loop->kd[i] * a[i];
}

/* The efforts that are held over a step. */
static void control(const Loop *loop, const double *reference, const double *noise, double *effort)
{
    int64_t n = coordinates(loop->model);
    if (loop->computed)
        computed_torque(loop, reference, noise, effort);
    else
        proportional_derivative(loop, reference, noise, effort);
    for (int64_t i = 0; i < n; i++) effort[i] = clamped(effort[i], loop->limit[i]);
    effort[n] = clamped(effort[n], loop->feed_limit);
}

/* One classical Runge-Kutta step of x'' = f(x, x') under held efforts. */
static void advance(const Loop *loop, const double *effort)
{
    static const double at[] = {0.0, 0.5, 0.5, 1.0};
    static const double weight[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    int64_t n = coordinates(loop->plant);
    int64_t m = n + 1;
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
        a[n] = forward(loop->plant, q, qd, effort, effort[n], a);
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
    int64_t m = n + 1;
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
