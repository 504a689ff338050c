/* Places and rotations of the links of an arm of universal joints, from the base outward, and their derivatives:
   Omega_i = Omega_(i-1) + z dq_a + y' dq_b and dP_(i+1) = dP_i + l_i Omega_i x t_i. */

#include "link_places.h"

typedef struct {
    int64_t poses, links;
    const double *lengths, *arcs; /* of the links, (links,); arcs as in link_places.h */
    const double *turns; /* constant rotations of the links, as in link_places.h; may be missing */
    Carrier carrier;
    const double *q;              /* two bends a joint, then the axes of the base, (poses, 2 links + count) */
    double *points, *rotations;   /* out: (poses, links + 1, 3) and (poses, links, 3, 3) */
} PlacesQuery;

PUBLIC void places(PlacesQuery *q)
{
    int64_t n = q->links;
    for (int64_t pose = 0; pose < q->poses; pose++)
        place_links(n, q->lengths, q->turns, q->arcs, &q->carrier, q->q + pose * (2 * n + q->carrier.count),
                    q->points + pose * 3 * (n + 1), q->rotations + pose * 9 * n);
}

typedef struct {
    int64_t poses, links, unknowns;
    const double *lengths, *arcs; /* of the links, (links,); arcs as in link_places.h */
    const double *turns; /* constant rotations of the links, as in link_places.h; may be missing */
    Carrier carrier;
    const double *q;              /* coordinates: two bends a joint, then the axes of the base, (poses, 2 links + count) */
    int64_t shared;               /* whether the slopes of all poses are the same */
    const double *slopes;         /* derivatives of the coordinates by the unknowns, (poses or 1, 2 links + count, unknowns) */
    double *points, *rotations;   /* out: (poses, links + 1, 3) and (poses, links, 3, 3) */
    double *turning, *moving;     /* out: derivatives of turns, (poses, links, 3, unknowns), of places, (poses, links + 1, 3, unknowns) */
    double *base_turning;         /* working memory, (3, unknowns) */
} ChainQuery;

/* Derivatives of the turn, (3, unknowns), and place, (3, unknowns), of the base by the unknowns. */
static void move_base(const ChainQuery *q, double *rotation, double *turning, double *moving)
{
    int64_t p = q->unknowns;
    double place[3], now[6 * MOST_AXES];
    place_base(&q->carrier, q->q + 2 * q->links, place, rotation, now);
    for (int64_t k = 0; k < 3 * p; k++) turning[k] = moving[k] = 0.0;
    for (int64_t axis = 0; axis < q->carrier.count; axis++) {
        const double *slopes = q->slopes + (2 * q->links + axis) * p, *z = now + 6 * axis;
        int turns = q->carrier.axes[AXIS * axis] != 0.0;
        double off[3] = {place[0] - z[3], place[1] - z[4], place[2] - z[5]};
        for (int d = 0; d < 3; d++) {
            int e = (d + 1) % 3, f = (d + 2) % 3;
            double moved = turns ? z[e] * off[f] - z[f] * off[e] : z[d];
            for (int64_t k = 0; k < p; k++) moving[d * p + k] += moved * slopes[k];
            for (int64_t k = 0; turns && k < p; k++) turning[d * p + k] += z[d] * slopes[k];
        }
    }
}

/* Length of a link that consists of tangents of two arcs, and its derivatives by the bends of the joints at its ends. */
static double grown(const double *lengths, const double *arcs, const double *bends, int64_t link, int64_t links,
                    double *of_own, double *of_next)
{
    const double *own = bends + 2 * link, none[2] = {0.0, 0.0}, *next = link + 1 < links ? own + 2 : none;
    Tangent first = tangent(hypot(own[0], own[1])), last = tangent(hypot(next[0], next[1]));
    for (int i = 0; i < 2; i++) {
        of_own[i] = arcs[link] * first.slope * own[i];
        of_next[i] = arcs[link + 1] * last.slope * next[i];
    }
    return arcs[link] * first.length + arcs[link + 1] * last.length + fixed_length(lengths, arcs, link);
}

static void chain_of_pose(const ChainQuery *q)
{
    int64_t p = q->unknowns, n = q->links;
    double base[9], axis_a[3], axis_b[3];
    place_links(n, q->lengths, q->turns, q->arcs, &q->carrier, q->q, q->points, q->rotations);
    move_base(q, base, q->base_turning, q->moving);
    for (int64_t j = 0; j < n; j++) {
        const double *before = j ? q->rotations + 9 * (j - 1) : base;
        const double *after = q->rotations + 9 * j;
        const double *about_a = q->slopes + 2 * j * p, *about_b = about_a + p;
        double *turn = q->turning + 3 * j * p, *move = q->moving + 3 * (j + 1) * p;
        double length = q->lengths[j], of_next[2] = {0.0, 0.0}, of_own[2] = {0.0, 0.0};
        joint_axes(q->arcs, before, after, q->q + 2 * j, axis_a, axis_b);
        if (q->arcs) length = grown(q->lengths, q->arcs, q->q, j, n, of_own, of_next);
        for (int d = 0; d < 3; d++)
            for (int64_t k = 0; k < p; k++)
                turn[d * p + k] = (j ? turn - 3 * p : q->base_turning)[d * p + k] + axis_a[d] * about_a[k] + axis_b[d] * about_b[k];
        for (int d = 0; d < 3; d++) {
            int e = (d + 1) % 3, f = (d + 2) % 3;
            double te = length * after[3 * e], tf = length * after[3 * f];
            for (int64_t k = 0; k < p; k++)
                move[d * p + k] = move[(d - 3) * p + k] + turn[e * p + k] * tf - turn[f * p + k] * te;
            if (!q->arcs) continue;
            for (int i = 0; i < 2; i++) {
                double own = of_own[i] * after[3 * d], next = of_next[i] * after[3 * d];
                const double *bend = about_a + i * p, *bend_after = bend + 2 * p;
                for (int64_t k = 0; k < p; k++) move[d * p + k] += own * bend[k];
                if (j + 1 == n) continue;
                for (int64_t k = 0; k < p; k++) move[d * p + k] += next * bend_after[k];
            }
        }
    }
}

PUBLIC void chain(ChainQuery *q)
{
    int64_t n = q->links, p = q->unknowns, coordinates = 2 * n + q->carrier.count;
    ChainQuery pose = *q;
    for (int64_t k = 0; k < q->poses; k++) {
        chain_of_pose(&pose);
        pose.q += coordinates;
        if (!q->shared) pose.slopes += coordinates * p;
        pose.points += 3 * (n + 1);
        pose.rotations += 9 * n;
        pose.turning += 3 * n * p;
        pose.moving += 3 * (n + 1) * p;
    }
}
