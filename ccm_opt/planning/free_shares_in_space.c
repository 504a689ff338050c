/* How far straight motions of the joints come in space before a pose touches something: by samples, so near to each
   other that no link passes through anything unseen. */

#include "link_places.h"
#include "rrt_connect.h"
#include "surface_walk.h"

#define MOST_POSES 100000 /* on a motion */
#define NEAR 0.4          /* cells within which of what the grid tells the tree is asked: its values are no more than
                             that off between the places, but beside edges */
#define TOLD 0.01         /* share of what is kept by which the tree may tell less */
#define SLACK 0.1         /* cells by which values of the grid may be too small */
#define STRIDE 0.5        /* share of what is kept by which a link may move unseen */
#define FASTER 1.1        /* by which a link may become faster while no link turns by more than this: */
#define TURN 0.2          /* [rad] */
#define EMERGING 0.25     /* share of the way on which bends grow beyond a tube that the base moves unseen */
#define BLOCK 4           /* places along a side of a block; measured: with 2 or 3 it takes a third longer */
#define MOST_NEAR 31      /* triangles known for a block */

/* Distances at the places of a grid, (nx, ny, nz), up to the reach; 0 where nobody has asked yet. For each block of
   places the triangles that may be nearest to one of them, the nearest to its middle first: a walk through the tree
   for each place would cost several times as much. */
typedef struct {
    int64_t counts[3], blocks[3];
    double low[3], cell, reach;
    float *values;
    int8_t *known;  /* (blocks,): number of triangles and one more; 0 where nobody has asked yet */
    int32_t *faces; /* (blocks, MOST_NEAR) */
    float *gaps;    /* likewise, of the faces from the middle of the block */
} Grid;

typedef struct {
    int64_t links, first_link;
    const int32_t *next_pair;                      /* as in arm_motion.c */
    const double *arcs;                            /* as in link_places.h, or missing */
    const double *turns;                           /* likewise: constant rotations of the links */
    const double *lengths, *radii;                 /* of the links, (links,) */
    const double *wall;                            /* that axes keep from surfaces, (links,) */
    double mount, longest, pair; /* share of the first link inside the mount, longest link, gap between links */
    Carrier carrier;
    const double *low, *high; /* limits of the coordinates, (c,) */
    const double *beyond;     /* how far out of a guide tube what each bend waits for is at a feed of zero, (2 links,);
                                 missing without a tube */
    double straight, whole;   /* distances from the tube up to which bends are zero, and from which on they are whole */
    Grid wide, fine;     /* the latter tells just what is near to the gap that is kept */
    Surfaces surfaces;
    double *work; /* 19 numbers a link, 3 an axis, and 6 more */

    int64_t motions;
    const double *start, *end; /* (motions, c) */
    double *share;             /* (motions,) */
} Motions;

/* Put a triangle among those that are known; returns their number, one more than there is space for at most. */
static int8_t put_among(int32_t *faces, float *gaps, int8_t known, float gap, int32_t face)
{
    if (known >= MOST_NEAR) return MOST_NEAR + 1;
    int8_t k = known;
    for (; k > 0 && gaps[k - 1] > gap; k--) {
        gaps[k] = gaps[k - 1];
        faces[k] = faces[k - 1];
    }
    gaps[k] = gap;
    faces[k] = face;
    return (int8_t)(known + 1);
}

/* Find the triangles that may be nearest to a place of a block; returns their number likewise. */
static int8_t look_about(const Motions *m, const Grid *grid, const double *place, int32_t *faces, float *gaps)
{
    Segment middle = {{place[0], place[1], place[2]}, {0.0, 0.0, 0.0}, 0.0};
    double radius = 0.5 * sqrt(3.0) * (BLOCK - 1) * grid->cell, limit = grid->reach + radius;
    Probe probe = probe_of(&middle);
    int8_t known = 0;
    Walk walk;
    walk.top = 0;
    walk.least = limit;
    step_to(&walk, 0, least_gap(&probe, m->surfaces.nodes, limit));
    while (known <= MOST_NEAR && next_node(&walk, limit)) {
        const Node *node = m->surfaces.nodes + walk.node;
        for (int32_t face = node->first; known <= MOST_NEAR && face < node->first + node->count; face++) {
            Found found = {limit, {0.0, 0.0, {0.0, 0.0, 0.0}}, -1};
            look_at(&m->surfaces, &middle, face, &found);
            if (found.face < 0) continue;
            limit = smaller(limit, found.gap + 2.0 * radius);
            while (known > 0 && gaps[known - 1] > (float)limit) known--;
            known = put_among(faces, gaps, known, (float)found.gap, face);
        }
        if (node->count == 0) step_down(&walk, &m->surfaces, &probe, node, limit);
    }
    return known;
}

/* Distance at a place of a grid, up to the reach. */
static double place_gap(const Motions *m, const Grid *grid, const int64_t *index)
{
    Segment point = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, 0.0};
    double middle[3], apart[3], least;
    int64_t block = 0;
    for (int d = 0; d < 3; d++) {
        int64_t at = index[d] / BLOCK;
        block = block * grid->blocks[d] + at;
        point.start[d] = grid->low[d] + (double)index[d] * grid->cell;
        middle[d] = grid->low[d] + ((double)(at * BLOCK) + 0.5 * (BLOCK - 1)) * grid->cell;
    }
    int32_t *faces = grid->faces + MOST_NEAR * block;
    float *gaps = grid->gaps + MOST_NEAR * block;
    if (grid->known[block] == 0) grid->known[block] = (int8_t)(look_about(m, grid, middle, faces, gaps) + 1);
    int8_t known = (int8_t)(grid->known[block] - 1);
    if (known > MOST_NEAR) {
        nearest_face(&m->surfaces, &point, grid->reach, SLACK * grid->cell, &least);
        return least;
    }
    minus(point.start, middle, apart);
    double off = sqrt(dot(apart, apart));
    Found found = {grid->reach, {0.0, 0.0, {0.0, 0.0, 0.0}}, -1};
    for (int8_t k = 0; k < known && (double)gaps[k] - off < found.gap; k++)
        look_at(&m->surfaces, &point, faces[k], &found);
    return found.gap;
}

static double grid_value(const Motions *m, const Grid *grid, int64_t at, const int64_t *index)
{
    float known = grid->values[at];
    if (known != 0.0f) return (double)known;
    known = (float)(m->surfaces.nodes == NULL ? grid->reach : place_gap(m, grid, index));
    grid->values[at] = known != 0.0f ? known : 1e-30f;
    return (double)grid->values[at];
}

/* Distance at a place, between the eight of the grid about it; of places beyond the grid that of its border. */
static double grid_distance(const Motions *m, const Grid *grid, const double *place)
{
    int64_t first[3], step[3], stride[3] = {grid->counts[1] * grid->counts[2], grid->counts[2], 1}, from = 0;
    double share[3], value[8];
    for (int d = 0; d < 3; d++) {
        double at = larger((place[d] - grid->low[d]) / grid->cell, 0.0);
        first[d] = whole_within(at, 0, grid->counts[d] - 1);
        step[d] = first[d] + 1 < grid->counts[d];
        share[d] = smaller(at - (double)first[d], 1.0);
        from += first[d] * stride[d];
    }
    for (int k = 0; k < 8; k++) {
        int64_t at[3], place_of = from;
        for (int d = 0; d < 3; d++) {
            int64_t by = (k >> d & 1) * step[d];
            at[d] = first[d] + by;
            place_of += by * stride[d];
        }
        value[k] = grid_value(m, grid, place_of, at);
    }
    for (int d = 2, half = 4; d >= 0; d--, half /= 2)
        for (int k = 0; k < half; k++) value[k] += share[d] * (value[k + half] - value[k]);
    return value[0];
}

/* Gap of a link beyond what is kept, or less; negative where it touches. */
static double link_room(const Motions *m, int64_t link, const double *joint, double from)
{
    double place[3], line[3], size = (1.0 - from) * m->lengths[link], wall = m->wall[link], near = NEAR * m->fine.cell;
    minus(joint + 3, joint, line);
    along(joint, 0.5 * (1.0 + from), line, place);
    double least = grid_distance(m, &m->wide, place) - wall, wide = NEAR * m->wide.cell;
    if (least - 0.5 * size >= wide) return least - 0.5 * size;
    if (least < -wide) return least;
    least = INFINITY;
    int64_t parts = whole_within(ceil(size / m->fine.cell), 1, 1000);
    double step = (1.0 - from) / (double)parts;
    for (int64_t k = 0; k < parts; k++) {
        along(joint, from + ((double)k + 0.5) * step, line, place);
        least = smaller(least, grid_distance(m, &m->fine, place) - wall);
        if (least < -near) return least;
    }
    least -= 0.5 * size / (double)parts;
    if (least >= near || m->surfaces.nodes == NULL) return least;
    Segment segment = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, 0.0};
    along(joint, from, line, segment.start);
    for (int d = 0; d < 3; d++) segment.line[d] = (1.0 - from) * line[d];
    segment.square = dot(segment.line, segment.line);
    nearest_face(&m->surfaces, &segment, wall + near, TOLD * wall, &least);
    return least - wall;
}

/* Rooms of the links of a pose, (links,); returns whether it touches nothing. */
static int pose_room(const Motions *m, const double *q, double *points, double *room)
{
    place_links(m->links, m->lengths, m->turns, m->arcs, &m->carrier, q, points, points + 3 * (m->links + 1));
    /* The tip is what meets walls first. */
    for (int64_t j = m->links - 1; j >= m->first_link; j--) {
        room[j] = link_room(m, j, points + 3 * j, j == m->first_link ? m->mount : 0.0);
        if (room[j] < 0.0) return 0;
    }
    double thickest = 0.0;
    for (int64_t j = 0; j < m->links; j++) thickest = larger(thickest, m->radii[j]);
    for (int64_t i = 0; i < m->links; i++) {
        if (m->radii[i] < 0.0) continue; /* a link without a body */
        double far = m->radii[i] + thickest + m->pair, s, t;
        int64_t j = next_in_reach(points, m->links, m->next_pair, i, 0, far, m->longest);
        for (; j < m->links; j = next_in_reach(points, m->links, m->next_pair, i, j + 1, far, m->longest))
            if (links_apart(points, i, j, &s, &t) < m->radii[i] + m->radii[j] + m->pair) return 0;
    }
    return 1;
}

/* The share of a motion after which a pose has to be looked at again, from its rooms and how fast its links are. */
static double next_step(const Motions *m, const double *q, const double *moved, const double *points, const double *room)
{
    const double *rotations = points + 3 * (m->links + 1);
    double rate[3] = {0.0, 0.0, 0.0}, velocity[3] = {0.0, 0.0, 0.0}, before = 0.0, step = 1.0, swing[3];
    double about_a[3], about_b[3], place[3], base[9], now[6 * MOST_AXES];
    place_base(&m->carrier, q + 2 * m->links, place, base, now);
    for (int64_t k = 0; k < m->carrier.count; k++) {
        const double *ahead = now + 6 * k, by = moved[2 * m->links + k];
        if (m->carrier.axes[AXIS * k] == 0.0) {
            along(velocity, by, ahead, velocity);
            continue;
        }
        double lever[3];
        minus(place, ahead + 3, lever);
        cross(ahead, lever, swing);
        along(velocity, by, swing, velocity);
        along(rate, by, ahead, rate);
    }
    before = sqrt(dot(velocity, velocity));
    for (int64_t j = 0; j < m->links; j++) {
        const double *frame = j ? rotations + 9 * (j - 1) : base, *after = rotations + 9 * j;
        joint_axes(m->arcs, frame, after, q + 2 * j, about_a, about_b);
        for (int d = 0; d < 3; d++) rate[d] += moved[2 * j] * about_a[d] + moved[2 * j + 1] * about_b[d];
        double ahead[3] = {after[0], after[3], after[6]};
        cross(rate, ahead, swing);
        along(velocity, m->lengths[j], swing, velocity);
        double speed = sqrt(dot(velocity, velocity)), turning = sqrt(dot(rate, rate));
        double most = FASTER * larger(speed, before);
        double room_left = j >= m->first_link ? room[j] + STRIDE * m->wall[j] : INFINITY;
        if (most * step > room_left) step = room_left / most;
        if (turning * step > TURN) step = TURN / turning;
        before = speed;
    }
    return step;
}

/* Multiply bends by how much of them there is beyond a guide tube, and their rates, (c,), likewise. */
static void emerge(const Motions *m, double *q, double *moved)
{
    double way = m->whole - m->straight, feed = q[2 * m->links], fed = moved == NULL ? 0.0 : moved[2 * m->links];
    for (int64_t i = 0; m->beyond != NULL && i < 2 * m->links; i++) {
        double x = smaller(larger((feed + m->beyond[i] - m->straight) / way, 0.0), 1.0), part = x * x * (3.0 - 2.0 * x);
        if (moved != NULL) moved[i] = part * moved[i] + 6.0 * x * (1.0 - x) / way * fed * q[i];
        q[i] *= part;
    }
}

static double free_share(const Motions *m, const double *from, const double *to, int end_first)
{
    int64_t n = m->links, c = 2 * n + m->carrier.count;
    double *moved = m->work, *room = moved + c, *q = room + n, *rate = q + c;
    double *points = rate + c; /* and rotations behind them */
    for (int64_t i = 0; i < c; i++) {
        if (to[i] < m->low[i] || to[i] > m->high[i]) return 0.0;
        moved[i] = to[i] - from[i];
        q[i] = to[i];
    }
    emerge(m, q, NULL);
    if (end_first && !pose_room(m, q, points, room)) return 0.0;
    double share = 0.0, reached = 0.0, longest = 1.0;
    if (m->beyond != NULL && moved[2 * n] != 0.0) longest = EMERGING * (m->whole - m->straight) / fabs(moved[2 * n]);
    for (int64_t pose = 0; pose < MOST_POSES; pose++) {
        for (int64_t i = 0; i < c; i++) {
            q[i] = from[i] + share * moved[i];
            rate[i] = moved[i];
        }
        emerge(m, q, rate);
        if (!pose_room(m, q, points, room)) break;
        reached = share;
        if (share >= 1.0) break;
        share = smaller(share + smaller(next_step(m, q, rate, points, room), longest), 1.0);
        if (share >= 1.0 && end_first) return 1.0;
    }
    return reached;
}

PUBLIC void free_shares_in_space(Motions *m)
{
    int64_t c = 2 * m->links + m->carrier.count;
    for (int64_t k = 0; k < m->motions; k++) m->share[k] = free_share(m, m->start + k * c, m->end + k * c, 0);
}

typedef struct {
    Growth growth;
    Motions motions;
    const double *offset, *slopes; /* of the configuration, (c,), and its derivatives by the points, (size, c) */
    double *ends;                  /* configurations, (2, c) */
} Connection;

static double free_share_of_points(void *check, const double *from, const double *to, int end_first)
{
    const Connection *one = check;
    int64_t c = 2 * one->motions.links + one->motions.carrier.count;
    const double *point[2] = {from, to};
    for (int k = 0; k < 2; k++) {
        double *end = one->ends + k * c;
        memcpy(end, one->offset, (size_t)c * sizeof(double));
        for (int64_t d = 0; d < one->growth.size; d++) {
            const double *slope = one->slopes + d * c;
            for (int64_t i = 0; i < c; i++) end[i] += point[k][d] * slope[i];
        }
    }
    return free_share(&one->motions, one->ends, one->ends + c, end_first);
}

/* Ends beyond the limits are not free. */
static double anywhere(const void *check, const double *from, const double *to)
{
    (void)check, (void)from, (void)to;
    return 1.0;
}

PUBLIC void connect_in_space(Connection *one) { grow(&one->growth, one, free_share_of_points, anywhere); }
