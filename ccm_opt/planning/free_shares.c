/* How far straight motions of link headings come before a pose that is refuted: sampled_check.py in C.

   Between poses that are looked at in a row every link turns by the same angle, so that cosines and sines follow by
   complex products. */

#include "rrt_connect.h"

#define MOST_POSES (INT64_C(1) << 31) /* on a motion */

typedef struct {
    int64_t links, mount_link, parts, side, stride; /* parts: of a link between places looked up */
    const int32_t *next_pair;       /* the first link from j on that must not touch i, (links, links + 1) */
    const double *lengths, *radii;  /* (links,); radii of links without a body are negative */
    double mount_at, mean_length, longest, thickest, base_x, base_y, corner_x, corner_y, cell, spacing;
    const uint8_t *blocked; /* (side, side), by row and column, with a frame of one cell */
    double *work;           /* 8 numbers a link, and two more */

    int64_t motions;
    const double *start, *end; /* (motions, links) */
    double *share;             /* (motions,) */
} Shares;

static int blocked_at(const Shares *s, double x, double y)
{
    int64_t column = whole_within((x - s->corner_x) / s->cell + 1.0, -1, s->side);
    int64_t row = whole_within((y - s->corner_y) / s->cell + 1.0, -1, s->side);
    if (column < 0 || row < 0 || column >= s->side || row >= s->side) return 1;
    return s->blocked[row * s->side + column];
}

static double clamped(double t)
{
    return t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t;
}

static double to_segment(double px, double py, const double *a, const double *b)
{
    double dx = b[0] - a[0], dy = b[1] - a[1];
    double t = clamped(((px - a[0]) * dx + (py - a[1]) * dy) / (dx * dx + dy * dy));
    double x = px - a[0] - t * dx, y = py - a[1] - t * dy;
    return x * x + y * y;
}

static double side_of(const double *p, const double *q, const double *r)
{
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
}

/* Whether two links with joints p, q and r, t are nearer than the square of a distance, or cross. */
static int links_meet(const double *p, const double *q, const double *r, const double *t, double square)
{
    if (to_segment(p[0], p[1], r, t) < square || to_segment(q[0], q[1], r, t) < square) return 1;
    if (to_segment(r[0], r[1], p, q) < square || to_segment(t[0], t[1], p, q) < square) return 1;
    return side_of(p, q, r) * side_of(p, q, t) < 0.0 && side_of(r, t, p) * side_of(r, t, q) < 0.0;
}

static int on_itself(const Shares *s, const double *joints)
{
    double close = s->longest + 2.0 * s->thickest;
    for (int64_t i = 0; i < s->links; ++i) {
        const double *p = joints + 2 * i;
        double mx = p[0] + p[2], my = p[1] + p[3];
        const int32_t *next = s->next_pair + i * (s->links + 1);
        for (int64_t j = next[0]; j < s->links; j = next[j + 1]) {
            const double *r = joints + 2 * j;
            double x = 0.5 * (r[0] + r[2] - mx), y = 0.5 * (r[1] + r[3] - my);
            double apart = x * x + y * y;
            if (apart >= close * close) {
                /* Nothing comes nearer by more than a link's length from one link to the next. */
                j += whole_within((sqrt(apart) - close) / s->longest, 0, s->links - 1 - j);
                continue;
            }
            double both = s->radii[i] + s->radii[j];
            if (both < 0.0) continue;
            if (links_meet(p, p + 2, r, r + 2, both * both)) return 1;
        }
    }
    return 0;
}

/* Whether the pose with given cosines and sines of the links touches something for sure. */
static int refuted(const Shares *s, const double *cosines, const double *sines, double *joints)
{
    joints[0] = s->base_x;
    joints[1] = s->base_y;
    for (int64_t j = 0; j < s->links; ++j) {
        const double *p = joints + 2 * j;
        double length = s->lengths[j], part = length / (double)s->parts;
        joints[2 * j + 2] = p[0] + length * cosines[j];
        joints[2 * j + 3] = p[1] + length * sines[j];
        if (j < s->mount_link || s->radii[j] < 0.0) continue;
        double mount = j == s->mount_link ? s->mount_at * length : 0.0;
        if (j == s->mount_link && blocked_at(s, p[0] + mount * cosines[j], p[1] + mount * sines[j])) return 1;
        for (int64_t k = 1; k <= s->parts; ++k) {
            double along = part * (double)k;
            if (along > mount && blocked_at(s, p[0] + along * cosines[j], p[1] + along * sines[j])) return 1;
        }
    }
    return on_itself(s, joints);
}

/* The first of the steps `from`, `from` + `by`, ... up to `last` whose pose is refuted, or `last` + 1; steps that are
   multiples of `skip` have been looked at. */
static int64_t first_refuted(const Shares *s, const double *start, const double *end, int64_t count, int64_t from,
                             int64_t by, int64_t last, int64_t skip)
{
    int64_t links = s->links;
    double *cosines = s->work, *sines = cosines + links, *turn_c = sines + links, *turn_s = turn_c + links;
    double *joints = turn_s + links;
    for (int64_t j = 0; j < links; ++j) {
        double step = (end[j] - start[j]) / (double)count, at = start[j] + (double)from * step;
        cosines[j] = cos(at);
        sines[j] = sin(at);
        turn_c[j] = cos((double)by * step);
        turn_s[j] = sin((double)by * step);
    }
    for (int64_t k = from; k <= last; k += by) {
        if ((skip == 0 || k % skip != 0) && refuted(s, cosines, sines, joints)) return k;
        for (int64_t j = 0; j < links; ++j) {
            double c = cosines[j] * turn_c[j] - sines[j] * turn_s[j];
            sines[j] = sines[j] * turn_c[j] + cosines[j] * turn_s[j];
            cosines[j] = c;
        }
    }
    return last + 1;
}

/* How far a motion comes before a pose that is refuted. */
static double free_share(const Shares *s, const double *start, const double *end, int end_first)
{
    double travel = 0.0;
    for (int64_t j = 0; j < s->links; ++j) travel += s->lengths[j] / s->mean_length * fabs(end[j] - start[j]);
    int64_t count = whole_within(ceil(s->mean_length * travel / s->spacing), 1, MOST_POSES);
    if (!(travel < INFINITY) || count == MOST_POSES) return 0.0; /* no motion of an arm */
    if (end_first && first_refuted(s, start, end, count, count, 1, count, 0) <= count) return 0.0;
    /* Few poses on the way first: most motions that touch do so in a wide stretch. Then what lies before. */
    int64_t last = first_refuted(s, start, end, count, s->stride, s->stride, count, 0);
    if (last > count) last = count + 1;
    int64_t first = first_refuted(s, start, end, count, 1, 1, last - 1, s->stride);
    return (double)(first - 1) / (double)count;
}

PUBLIC void free_shares(Shares *s)
{
    for (int64_t m = 0; m < s->motions; ++m)
        s->share[m] = free_share(s, s->start + m * s->links, s->end + m * s->links, 0);
}

typedef struct {
    Growth growth; /* of link headings */
    Shares shares;
    double heading;      /* of the base */
    const double *turns; /* constant turns of the links, (links,); may be missing */
    const double *limit; /* of the bends, (links,) */
} Connection;

static double free_share_of_headings(void *check, const double *from, const double *to, int end_first)
{
    return free_share(&((const Connection *)check)->shares, from, to, end_first);
}

static double within_limits(const void *check, const double *from, const double *to)
{
    const Connection *one = check;
    double share = 1.0, before = one->heading, after = one->heading;
    for (int64_t j = 0; j < one->growth.size; ++j) {
        double turn = one->turns ? one->turns[j] : 0.0;
        double bend = from[j] - before - turn, change = to[j] - after - turn - bend;
        double room = one->limit[j] - (change < 0.0 ? -bend : bend);
        before = from[j];
        after = to[j];
        if (share * fabs(change) > room) share = room > 0.0 ? room / fabs(change) : 0.0;
    }
    return share;
}

PUBLIC void connect_in_plane(Connection *one) { grow(&one->growth, one, free_share_of_headings, within_limits); }
