/* Shapes of an arm in space, moved onto a goal of its tip by Newton's method with the least change of points in which
   its configurations are affine, and towards the joint limits from beyond them. Obstacles play no part. */

#include "link_places.h"

#define ROWS 7       /* of the tip's place, direction and roll */
#define RIDGE 1e-9   /* of the equations, whose rows for a direction are one too many */
#define ARRIVED 1e-7 /* error that counts as none */
#define BACK 1.3     /* of what joints are bent beyond their limits, by how much they are bent back */

typedef struct {
    int64_t links, size, shapes, directed, rolled, steps; /* whether the goal has a direction, a roll; most steps */
    double whole, largest;                        /* length of the arm; largest step */
    const double *lengths, *arcs;                 /* of the links, (links,); arcs as in link_places.h */
    const double *turns;                          /* constant rotations of the links; may be missing */
    Carrier carrier;
    const double *offset, *slopes;       /* (c,) and (size, c) */
    const double *low, *high, *inverse;  /* limits of the coordinates, (c,); of the slopes, (c, size) */
    double position[3], direction[3];
    double up[3], beside[3], own[3], room; /* where the up axis points, direction x up, the axis in the last link */
    double *work;   /* 28 numbers a link, 8 an axis and a coordinate of points, and 12 more */
    double *points; /* (shapes, size), moved */
    double *missed; /* (shapes,): errors that are left, in arm lengths and radians */
} GoalShapes;

/* Solve equations with a symmetric positive definite matrix, in place. */
static void solve_rows(double matrix[ROWS][ROWS], double *value)
{
    for (int i = 0; i < ROWS; i++)
        for (int j = 0; j <= i; j++) {
            double sum = matrix[i][j];
            for (int k = 0; k < j; k++) sum -= matrix[i][k] * matrix[j][k];
            matrix[i][j] = i == j ? sqrt(sum) : sum / matrix[j][j];
        }
    for (int i = 0; i < ROWS; i++) {
        for (int k = 0; k < i; k++) value[i] -= matrix[i][k] * value[k];
        value[i] /= matrix[i][i];
    }
    for (int i = ROWS; i-- > 0;) {
        for (int k = i + 1; k < ROWS; k++) value[i] -= matrix[k][i] * value[k];
        value[i] /= matrix[i][i];
    }
}

/* The error of the roll; its derivative is the lever times the rate of rotation. */
static double roll_error(const GoalShapes *g, const double *last, double *lever)
{
    double axis[3], turned[3];
    for (int d = 0; d < 3; d++) axis[d] = dot(last + 3 * d, g->own), lever[d] = 0.0;
    if (!g->rolled) return 0.0;
    double along = dot(axis, g->up), aside = dot(axis, g->beside), square = along * along + aside * aside;
    double roll = atan2(aside, along), beyond = larger(fabs(roll) - g->room, 0.0);
    if (g->room > 0.0 && beyond == 0.0) return 0.0;
    for (int d = 0; d < 3; d++) turned[d] = (along * g->beside[d] - aside * g->up[d]) / square;
    cross(axis, turned, lever);
    return roll > 0.0 ? -beyond : beyond;
}

/* Errors of the tip, (7,), and their derivatives by the coordinates, (c, 7); returns the largest error. */
static double tip_errors(const GoalShapes *g, const double *q, double *frames, double *error, double *by_bends)
{
    int64_t n = g->links;
    double *rotations = frames + 3 * (n + 1), size = g->whole, most = 0.0, place[3], base[9], now[6 * MOST_AXES];
    place_links(n, g->lengths, g->turns, g->arcs, &g->carrier, q, frames, rotations);
    place_base(&g->carrier, q + 2 * n, place, base, now);
    const double *tip = frames + 3 * n, *last = rotations + 9 * (n - 1);
    double ahead[3] = {last[0], last[3], last[6]}, lever[3];
    error[6] = roll_error(g, last, lever);
    for (int d = 0; d < 3; d++) {
        error[d] = (g->position[d] - tip[d]) / size;
        error[3 + d] = g->directed ? g->direction[d] - ahead[d] : 0.0;
    }
    for (int d = 0; d < ROWS; d++) most = larger(most, fabs(error[d]));
    for (int64_t i = 0; i < 2 * n; i++) {
        int64_t j = i / 2;
        const double *frame = j ? rotations + 9 * (j - 1) : base, *after = rotations + 9 * j;
        double axes[2][3], *axis = axes[i % 2], arm[3];
        joint_axes(g->arcs, frame, after, q + 2 * j, axes[0], axes[1]);
        minus(tip, frames + 3 * j, arm);
        cross(axis, arm, by_bends + ROWS * i);
        if (g->arcs) {
            double grows = g->arcs[j] * tangent(hypot(q[2 * j], q[2 * j + 1])).slope * q[i];
            for (int d = 0; d < 3; d++) by_bends[ROWS * i + d] += grows * (frame[3 * d] + after[3 * d]);
        }
        cross(axis, ahead, by_bends + ROWS * i + 3);
        by_bends[ROWS * i + 6] = dot(lever, axis);
    }
    for (int64_t k = 0; k < g->carrier.count; k++) {
        const double *axis = now + 6 * k;
        double *row = by_bends + ROWS * (2 * n + k), arm[3];
        int turns = g->carrier.axes[AXIS * k] != 0.0;
        minus(tip, axis + 3, arm);
        cross(axis, arm, row);
        cross(axis, ahead, row + 3);
        row[6] = turns ? dot(lever, axis) : 0.0;
        for (int d = 0; d < 3 && !turns; d++) row[d] = axis[d], row[3 + d] = 0.0;
    }
    for (int64_t i = 0; i < 2 * n + g->carrier.count; i++)
        for (int d = 0; d < 3; d++) {
            by_bends[ROWS * i + d] /= size;
            if (!g->directed) by_bends[ROWS * i + 3 + d] = 0.0;
        }
    return most;
}

/* The change of the point that moves coordinates back which are beyond their limits; returns whether there are any. */
static int bend_back(const GoalShapes *g, const double *q, double *back)
{
    int bent = 0;
    for (int64_t d = 0; d < g->size; d++) back[d] = 0.0;
    for (int64_t i = 0; i < 2 * g->links + g->carrier.count; i++) {
        double beyond = q[i] > g->high[i] ? q[i] - g->high[i] : q[i] < g->low[i] ? q[i] - g->low[i] : 0.0;
        if (beyond == 0.0) continue;
        bent = 1;
        for (int64_t d = 0; d < g->size; d++) back[d] -= BACK * beyond * g->inverse[i * g->size + d];
    }
    return bent;
}

static double move_onto_goal(const GoalShapes *g, double *point)
{
    int64_t c = 2 * g->links + g->carrier.count;
    double *q = g->work, *by_bends = q + c, *rows = by_bends + ROWS * c, *back = rows + ROWS * g->size;
    double *frames = back + g->size;
    for (int64_t step = 0;; step++) {
        double error[ROWS], matrix[ROWS][ROWS], norm = 0.0;
        memcpy(q, g->offset, (size_t)c * sizeof(double));
        for (int64_t d = 0; d < g->size; d++)
            for (int64_t i = 0; i < c; i++) q[i] += point[d] * g->slopes[d * c + i];
        double most = tip_errors(g, q, frames, error, by_bends);
        int bent = bend_back(g, q, back);
        if (!(most > ARRIVED || bent) || step == g->steps) return most;
        for (int64_t d = 0; d < g->size; d++) {
            double *row = rows + ROWS * d;
            for (int r = 0; r < ROWS; r++) row[r] = 0.0;
            for (int64_t i = 0; i < c; i++)
                for (int r = 0; r < ROWS; r++) row[r] += g->slopes[d * c + i] * by_bends[ROWS * i + r];
        }
        for (int i = 0; i < ROWS; i++)
            for (int j = 0; j < ROWS; j++) {
                matrix[i][j] = i == j ? RIDGE : 0.0;
                for (int64_t d = 0; d < g->size; d++) matrix[i][j] += rows[ROWS * d + i] * rows[ROWS * d + j];
            }
        for (int64_t d = 0; d < g->size; d++)
            for (int r = 0; r < ROWS; r++) error[r] -= rows[ROWS * d + r] * back[d];
        solve_rows(matrix, error);
        for (int64_t d = 0; d < g->size; d++) {
            double change = back[d];
            for (int r = 0; r < ROWS; r++) change += rows[ROWS * d + r] * error[r];
            rows[ROWS * d] = change;
            norm += change * change;
        }
        double share = norm > g->largest * g->largest ? g->largest / sqrt(norm) : 1.0;
        for (int64_t d = 0; d < g->size; d++) point[d] += share * rows[ROWS * d];
    }
}

PUBLIC void shapes_onto_goal(GoalShapes *g)
{
    for (int64_t k = 0; k < g->shapes; k++) g->missed[k] = move_onto_goal(g, g->points + k * g->size);
}
