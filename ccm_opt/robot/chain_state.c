/* Where the links of an arm in space are and how they move with the coordinates of a curve: chain_state.py in C.

   q = B v + q0, R_i = R_(i-1) Rz(a_i) Ry(b_i), Omega_i = Omega_(i-1) + z B_a + y' B_b and
   dP_(i+1) = dP_i + l Omega_i x t_i. */

#include "native.h"

typedef struct {
    int64_t links, coordinates, dimension;
    double link_length;
    const double *base;     /* (3,) */
    const double *rotation; /* of the straight arm, (3, 3) */
    const double *matrix;   /* B, (coordinates, dimension) */
    const double *offset;   /* q0, (coordinates,) */
    const double *v;        /* (dimension,) */
    double *q;              /* results: (coordinates,) */
    double *positions;      /* (links + 1, 3) */
    double *rotations;      /* (links, 3, 3) */
    double *omega;          /* (links, 3, dimension) */
    double *jacobian;       /* (links + 1, 3, dimension) */
} Chain;

static void configure(const Chain *c)
{
    for (int64_t row = 0; row < c->coordinates; row++) {
        const double *weights = c->matrix + row * c->dimension;
        double sum = 0.0;
        for (int64_t k = 0; k < c->dimension; k++) sum += weights[k] * c->v[k];
        c->q[row] = sum + c->offset[row];
    }
}

/* Where the base is, and how it moves: along the direction with every axis that carries it. */
static void place_base(const Chain *c)
{
    const int64_t p = c->dimension;
    for (int axis = 0; axis < 3; axis++) {
        double direction = c->rotation[3 * axis];
        double *moved = c->jacobian + axis * p;
        double place = c->base[axis];
        for (int64_t k = 0; k < p; k++) moved[k] = 0.0;
        for (int64_t row = 2 * c->links; row < c->coordinates; row++) {
            place += direction * c->q[row];
            for (int64_t k = 0; k < p; k++) moved[k] += direction * c->matrix[row * p + k];
        }
        c->positions[axis] = place;
    }
}

/* R Rz(a) Ry(b). */
static void turn(const double *R, double a, double b, double *turned)
{
    double ca = cos(a), sa = sin(a), cb = cos(b), sb = sin(b);
    for (int row = 0; row < 3; row++) {
        double x = R[3 * row], y = R[3 * row + 1], z = R[3 * row + 2];
        double along = ca * x + sa * y;
        turned[3 * row] = cb * along - sb * z;
        turned[3 * row + 1] = ca * y - sa * x;
        turned[3 * row + 2] = sb * along + cb * z;
    }
}

static void carry(const Chain *c, int64_t link, const double *before)
{
    const int64_t p = c->dimension;
    const double *R = c->rotations + 9 * link;
    const double *about_z = c->matrix + 2 * link * p;
    const double *about_y = about_z + p;
    double *turned = c->omega + 3 * link * p;
    for (int axis = 0; axis < 3; axis++) {
        double z = before[3 * axis + 2];
        double y = R[3 * axis + 1]; /* the turn about it leaves the y axis where it is */
        double *row = turned + axis * p;
        if (link == 0) {
            for (int64_t k = 0; k < p; k++) row[k] = z * about_z[k] + y * about_y[k];
        } else {
            const double *last = row - 3 * p;
            for (int64_t k = 0; k < p; k++) row[k] = last[k] + z * about_z[k] + y * about_y[k];
        }
    }
    double l = c->link_length;
    double x = l * R[0], y = l * R[3], z = l * R[6];
    const double *wx = turned, *wy = turned + p, *wz = turned + 2 * p;
    const double *from = c->jacobian + 3 * link * p;
    double *to = c->jacobian + 3 * (link + 1) * p;
    for (int64_t k = 0; k < p; k++) to[k] = from[k] + wy[k] * z - wz[k] * y;
    for (int64_t k = 0; k < p; k++) to[p + k] = from[p + k] + wz[k] * x - wx[k] * z;
    for (int64_t k = 0; k < p; k++) to[2 * p + k] = from[2 * p + k] + wx[k] * y - wy[k] * x;
}

PUBLIC void chain_state(const Chain *c)
{
    configure(c);
    place_base(c);
    const double *before = c->rotation;
    for (int64_t link = 0; link < c->links; link++) {
        double *R = c->rotations + 9 * link;
        turn(before, c->q[2 * link], c->q[2 * link + 1], R);
        for (int axis = 0; axis < 3; axis++)
            c->positions[3 * (link + 1) + axis] = c->positions[3 * link + axis] + c->link_length * R[3 * axis];
        carry(c, link, before);
        before = R;
    }
}
