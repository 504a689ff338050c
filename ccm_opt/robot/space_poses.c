/* Joints and rotations of an arm in space in many configurations: space_kinematics.py in C. */

#include "native.h"

typedef struct {
    int64_t poses, links, coordinates;
    double link_length;
    const double *base;     /* (3,) */
    const double *rotation; /* of the straight arm, (3, 3) */
    const double *q;        /* (poses, coordinates) */
    double *positions;      /* (poses, links + 1, 3) */
    double *rotations;      /* (poses, links, 3, 3) */
} Poses;

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

PUBLIC void space_poses(const Poses *p)
{
    for (int64_t pose = 0; pose < p->poses; pose++) {
        const double *q = p->q + pose * p->coordinates;
        double *place = p->positions + 3 * pose * (p->links + 1);
        double *R = p->rotations + 9 * pose * p->links;
        const double *before = p->rotation;
        double carried = 0.0;
        for (int64_t axis = 2 * p->links; axis < p->coordinates; axis++) carried += q[axis];
        for (int axis = 0; axis < 3; axis++) place[axis] = p->base[axis] + carried * p->rotation[3 * axis];
        for (int64_t link = 0; link < p->links; link++) {
            turn(before, q[2 * link], q[2 * link + 1], R);
            for (int axis = 0; axis < 3; axis++) place[3 + axis] = place[axis] + p->link_length * R[3 * axis];
            before = R;
            R += 9;
            place += 3;
        }
    }
}
