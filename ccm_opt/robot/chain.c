/* Places and rotations of the links of an arm of universal joints, from the base outward, and their derivatives:
   Omega_i = Omega_(i-1) + z dq_a + y' dq_b and dP_(i+1) = dP_i + l_i Omega_i x t_i. */

#include "link_places.h"

typedef struct {
    int64_t poses, links, fed; /* fed is 1 where the last coordinate carries the base, else 0 */
    const double *lengths;       /* of the links, (links,) */
    const double *start, *base;  /* place of the first joint without feed, (3,), and rotation of the base, (3, 3) */
    const double *q;             /* two bends a joint, then the feed, (poses, 2 links + fed) */
    double *points, *rotations;  /* out: (poses, links + 1, 3) and (poses, links, 3, 3) */
} PlacesQuery;

PUBLIC void places(PlacesQuery *q)
{
    int64_t n = q->links;
    for (int64_t pose = 0; pose < q->poses; pose++)
        place_links(n, q->lengths, q->fed, q->start, q->base, q->q + pose * (2 * n + q->fed),
                    q->points + pose * 3 * (n + 1), q->rotations + pose * 9 * n);
}

typedef struct {
    int64_t links, unknowns, fed; /* fed is 1 where the last coordinate carries the base, else 0 */
    const double *lengths;        /* of the links, (links,) */
    const double *start, *base;   /* place of the first joint without feed, (3,), and rotation of the base, (3, 3) */
    const double *q;              /* coordinates: two bends a joint, then the feed, (2 links + fed,) */
    const double *slopes;         /* derivatives of the coordinates by the unknowns, (2 links + fed, unknowns) */
    double *points, *rotations;   /* out: (links + 1, 3) and (links, 3, 3) */
    double *turning, *moving;     /* out: derivatives of turns, (links, 3, unknowns), of places, (links + 1, 3, unknowns) */
} ChainQuery;

PUBLIC void chain(ChainQuery *q)
{
    int64_t p = q->unknowns, n = q->links;
    const double *feed = q->slopes + 2 * n * p;
    place_links(n, q->lengths, q->fed, q->start, q->base, q->q, q->points, q->rotations);
    for (int d = 0; d < 3; d++)
        for (int64_t k = 0; k < p; k++) q->moving[d * p + k] = q->fed ? q->base[3 * d] * feed[k] : 0.0;
    for (int64_t j = 0; j < n; j++) {
        const double *before = j ? q->rotations + 9 * (j - 1) : q->base;
        const double *after = q->rotations + 9 * j;
        const double *about_a = q->slopes + 2 * j * p, *about_b = about_a + p;
        double *turn = q->turning + 3 * j * p, *move = q->moving + 3 * (j + 1) * p;
        for (int d = 0; d < 3; d++)
            for (int64_t k = 0; k < p; k++)
                turn[d * p + k] = (j ? turn[(d - 3) * p + k] : 0.0) + before[3 * d + 2] * about_a[k]
                                  + after[3 * d + 1] * about_b[k];
        for (int d = 0; d < 3; d++) {
            int e = (d + 1) % 3, f = (d + 2) % 3;
            double te = q->lengths[j] * after[3 * e], tf = q->lengths[j] * after[3 * f];
            for (int64_t k = 0; k < p; k++)
                move[d * p + k] = move[(d - 3) * p + k] + turn[e * p + k] * tf - turn[f * p + k] * te;
        }
    }
}
