/* Frames of links whose joints are those of arcs, for the verifier alone: chain_motion.py says how they turn. */

#include "native.h"

typedef struct {
    int64_t count, links;
    const double *base;  /* (count, 3, 3) rotations of the base */
    const double *bends; /* (count, links, 2) bends about z and y */
    const double *fixed; /* (links, 3, 3) rotations of parts of bodies before their joints turn; may be missing */
    double *frames;      /* (count, links, 3, 3) */
} ArcFrames;

/* out = A B, of three rows and columns each. */
static void product(const double *A, const double *B, double *out)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) out[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

/* A turn by an angle about a unit vector (0, y, z). */
PUBLIC void arc_frames(ArcFrames *q)
{
    for (int64_t t = 0; t < q->count; t++) {
        const double *before = q->base + 9 * t;
        for (int64_t k = 0; k < q->links; k++) {
            const double *bends = q->bends + 2 * (q->links * t + k);
            double *frame = q->frames + 9 * (q->links * t + k), moved[9];
            double angle = sqrt(bends[0] * bends[0] + bends[1] * bends[1]), most = angle > 0.0 ? angle : 1.0;
            double y = bends[1] / most, z = bends[0] / most, c = cos(angle), s = sin(angle), rest = 1.0 - c;
            double turn[9] = {c, -s * z, s * y, s * z, c + rest * y * y, rest * y * z, -s * y, rest * y * z, c + rest * z * z};
            if (q->fixed) {
                product(before, q->fixed + 9 * k, moved);
                before = moved;
            }
            product(before, turn, frame);
            before = frame;
        }
    }
}
