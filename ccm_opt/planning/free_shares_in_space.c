/* How far straight motions of the joints come in space before a pose touches something: by samples, so near to each
   other that no link passes through anything unseen. */

#include "link_places.h"
#include "surface_walk.h"

#define MOST_POSES 100000 /* on a motion */
#define NEAR 0.4          /* cells within which of the gap that the grid tells the tree is asked: its values are no more
                             than that off between the places, but beside edges */
#define TOLD 0.01         /* share of what is kept by which the tree may tell less */
#define STRIDE 0.5        /* share of what is kept by which a link may move unseen */

typedef struct {
    int64_t links, first_link, first_pair, counts[3];
    double length, mount, wall, pair, low[3], cell; /* wall, pair: that axes keep from surfaces and from each other */
    const double *place, *base;
    const double *grid; /* distances at the places of a grid, (nx, ny, nz) */
    Surfaces surfaces;
    double *work; /* 16 numbers a link, and 4 more */

    int64_t motions;
    const double *start, *end; /* (motions, c) */
    double *share;             /* (motions,) */
} Motions;

/* Distance at a place, between the eight of the grid about it; of places beyond the grid that of its border. */
static double grid_distance(const Motions *m, const double *place)
{
    int64_t next[3], stride[3] = {m->counts[1] * m->counts[2], m->counts[2], 1}, from = 0;
    double share[3], value[8];
    for (int d = 0; d < 3; d++) {
        double at = larger((place[d] - m->low[d]) / m->cell, 0.0);
        int64_t k = whole_within(at, 0, m->counts[d] - 1);
        next[d] = k + 1 < m->counts[d] ? stride[d] : 0;
        share[d] = smaller(at - (double)k, 1.0);
        from += k * stride[d];
    }
    for (int k = 0; k < 8; k++)
        value[k] = m->grid[from + (k & 1 ? next[0] : 0) + (k & 2 ? next[1] : 0) + (k & 4 ? next[2] : 0)];
    for (int d = 2, half = 4; d >= 0; d--, half /= 2)
        for (int k = 0; k < half; k++) value[k] += share[d] * (value[k + half] - value[k]);
    return value[0];
}

/* Gap of a link beyond what is kept, or less; negative where it touches. */
static double link_room(const Motions *m, const double *joint, double from)
{
    int64_t parts = whole_within(ceil((1.0 - from) * m->length / m->cell), 1, 1000);
    double step = (1.0 - from) / (double)parts, least = INFINITY, place[3], line[3];
    minus(joint + 3, joint, line);
    for (int64_t k = 0; k < parts; k++) {
        along(joint, from + ((double)k + 0.5) * step, line, place);
        least = smaller(least, grid_distance(m, place));
    }
    least -= 0.5 * step * m->length + m->wall;
    if (least >= NEAR * m->cell || m->surfaces.nodes == NULL) return least;
    Segment segment = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, 0.0};
    along(joint, from, line, segment.start);
    for (int d = 0; d < 3; d++) segment.line[d] = (1.0 - from) * line[d];
    segment.square = dot(segment.line, segment.line);
    nearest_face(&m->surfaces, &segment, m->wall + NEAR * m->cell, TOLD * m->wall, &least);
    return least - m->wall;
}

/* Rooms of the links of a pose, (links,); returns whether it touches nothing. */
static int pose_room(const Motions *m, const double *q, double *points, double *room)
{
    place_links(m->links, m->length, 0, m->place, m->base, q, points, points + 3 * (m->links + 1));
    /* The tip is what meets walls first. */
    for (int64_t j = m->links - 1; j >= m->first_link; j--) {
        room[j] = link_room(m, points + 3 * j, j == m->first_link ? m->mount / m->length - (double)j : 0.0);
        if (room[j] < 0.0) return 0;
    }
    for (int64_t i = 0; i + m->first_pair < m->links; i++)
        for (int64_t j = i + m->first_pair; (j = next_in_reach(points, m->links, i, j, m->pair, m->length)) < m->links; j++) {
            double s, t;
            if (links_apart(points, i, j, &s, &t) < m->pair) return 0;
        }
    return 1;
}

PUBLIC void free_shares_in_space(Motions *m)
{
    int64_t n = m->links, c = 2 * n;
    double *moved = m->work, *room = moved + n, *points = room + n; /* and rotations behind them */
    double *q = points + 12 * n + 3;
    for (int64_t k = 0; k < m->motions; k++) {
        const double *from = m->start + k * c, *to = m->end + k * c;
        double turn = 0.0, sum = 0.0, share = 0.0, reached = 0.0;
        for (int64_t j = 0; j < n; j++) {
            turn += hypot(to[2 * j] - from[2 * j], to[2 * j + 1] - from[2 * j + 1]);
            sum += turn * m->length;
            moved[j] = sum;
            room[j] = INFINITY;
        }
        for (int64_t pose = 0; pose < MOST_POSES; pose++) {
            for (int64_t i = 0; i < c; i++) q[i] = from[i] + share * (to[i] - from[i]);
            if (!pose_room(m, q, points, room)) break;
            reached = share;
            if (share >= 1.0) break;
            double step = 1.0;
            for (int64_t j = m->first_link; j < n; j++)
                if (moved[j] > 0.0) step = smaller(step, (room[j] + STRIDE * m->wall) / moved[j]);
            share = smaller(share + step, 1.0);
        }
        m->share[k] = reached;
    }
}
