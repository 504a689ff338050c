/* Which pairs of links are not proved apart over stretches of a motion: pair_proofs.py in C. */

#include "native.h"

typedef struct {
    int64_t stretches, links;
    const int32_t *next_pair;            /* the first link from j on that must not touch i, (links, links + 1) */
    double longest;                      /* length of a link */
    const double *least;                 /* what each link adds to the distance to be kept, (links,) */
    const double *start, *end, *middle;  /* joints, (stretches, links + 1, 2) */
    const double *sag;                   /* (stretches, links) */
    const double *moved;                 /* by which any joint leaves its mean place, (stretches,) */

    int64_t asked; /* pairs to look at; -1 for all */
    const int64_t *asked_stretch, *asked_first, *asked_second;

    int64_t capacity, count; /* room for results; the count may exceed it, and is then needed */
    int64_t *stretch, *first, *second;
    uint8_t *touching;
} Proofs;

static inline double clipped(double share) { return fmin(fmax(share, 0.0), 1.0); }

/* The vector between closest points of links i and j that do not cross: the least of four end-to-link distances. */
static void closest(const double *joints, int64_t i, int64_t j, double *best_x, double *best_y)
{
    const double *p = joints + 2 * i, *r = joints + 2 * j;
    double dx = p[2] - p[0], dy = p[3] - p[1];
    double ex = r[2] - r[0], ey = r[3] - r[1];
    double wx = p[0] - r[0], wy = p[1] - r[1];
    double dd = fmax(dx * dx + dy * dy, 1e-30), ee = fmax(ex * ex + ey * ey, 1e-30);
    double dw = dx * wx + dy * wy, ew = ex * wx + ey * wy, de = dx * ex + dy * ey;
    double on_first[4] = {clipped(-dw / dd), clipped((de - dw) / dd), 0.0, 1.0};
    double on_second[4] = {0.0, 1.0, clipped(ew / ee), clipped((ew + de) / ee)};
    double least = INFINITY;
    for (int k = 0; k < 4; k++) {
        double x = wx + on_first[k] * dx - on_second[k] * ex;
        double y = wy + on_first[k] * dy - on_second[k] * ey;
        if (x * x + y * y < least) {
            least = x * x + y * y;
            *best_x = x;
            *best_y = y;
        }
    }
}

/* The least difference of corners, one of each link, along a direction. */
static double least_along(const double *joints, int64_t i, int64_t j, double x, double y)
{
    const double *p = joints + 2 * i, *r = joints + 2 * j;
    double first = fmin(p[0] * x + p[1] * y, p[2] * x + p[3] * y);
    double second = fmax(r[0] * x + r[1] * y, r[2] * x + r[3] * y);
    return first - second;
}

static void look_at(Proofs *q, int64_t stretch, int64_t i, int64_t j)
{
    int64_t joints = 2 * stretch * (q->links + 1);
    const double *sag = q->sag + stretch * q->links;
    double x = 0.0, y = 0.0;
    closest(q->middle + joints, i, j, &x, &y);
    double distance = hypot(x, y), length = fmax(distance, 1e-12);
    x /= length;
    y /= length;
    double corners = fmin(least_along(q->start + joints, i, j, x, y), least_along(q->end + joints, i, j, x, y));
    /* What the links before i turn moves both alike. */
    double bent = sag[j] - (i > 0 ? sag[i - 1] : 0.0);
    double least = q->least[i] + q->least[j];
    if (corners > least + bent) return;

    int64_t k = q->count++;
    if (k >= q->capacity) return;
    q->stretch[k] = stretch;
    q->first[k] = i;
    q->second[k] = j;
    q->touching[k] = distance <= least;
}

/* Pairs whose links' middles are so near that they may meet. */
static void look_at_all(Proofs *q)
{
    for (int64_t s = 0; s < q->stretches; s++) {
        const double *a = q->start + 2 * s * (q->links + 1), *b = q->end + 2 * s * (q->links + 1);
        for (int64_t i = 0; i < q->links; i++) {
            double x = 0.25 * (a[2 * i] + a[2 * i + 2] + b[2 * i] + b[2 * i + 2]);
            double y = 0.25 * (a[2 * i + 1] + a[2 * i + 3] + b[2 * i + 1] + b[2 * i + 3]);
            const int32_t *next = q->next_pair + i * (q->links + 1);
            for (int64_t j = next[0]; j < q->links; j = next[j + 1]) {
                double dx = 0.25 * (a[2 * j] + a[2 * j + 2] + b[2 * j] + b[2 * j + 2]) - x;
                double dy = 0.25 * (a[2 * j + 1] + a[2 * j + 3] + b[2 * j + 1] + b[2 * j + 3]) - y;
                double reach = q->least[i] + q->least[j] + q->longest + 2.0 * q->moved[s];
                if (dx * dx + dy * dy < reach * reach) look_at(q, s, i, j);
            }
        }
    }
}

PUBLIC void pair_proofs(Proofs *q)
{
    q->count = 0;
    if (q->asked < 0) look_at_all(q);
    for (int64_t k = 0; k < q->asked; k++) look_at(q, q->asked_stretch[k], q->asked_first[k], q->asked_second[k]);
}
