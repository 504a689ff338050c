/* Near pairs of an arm with walls and with itself, and whether a link crosses anything: contacts.py in C.

   Walls are found through bounding-box trees (box_tree.py), pairs of links through boxes about runs of links. The
   order of what is reported is that of contacts.py: links with vertices, joints with edges, links with links. */

#include "native.h"
#include "box_tree.h"

#define RUN 8 /* links that share a box */

typedef struct {
    int64_t links, mount_link;
    const int32_t *next_pair; /* the first link from j on that must not touch i, (links, links + 1) */
    double mount_at, mean_length, longest, thickest, reach, margin;
    const double *lengths, *radii; /* of the links, (links,); the radii of links without a body are negative */
    const double *starts;          /* of links along the arm, in mean lengths, (links,) */
    const double *ends;            /* likewise */
    double pair_share;             /* of the free length between two links that is kept, up to the margin */

    Tree edge_tree, vertex_tree;
    const double *edges; /* (E, 4) */
    const int64_t *edge_wall;
    const double *vertices; /* (V, 2) */
    const int64_t *vertex_wall;
    double clearance, most_rounding;
    const double *rounding; /* distance of a wall's surface from its core, (walls,) */
    int64_t walls;

    int64_t *found;        /* working memory, max(E, V) numbers */
    double *runs;          /* working memory, 4 numbers for RUN links */
    const double *points;  /* joints and tip, (links + 1, 2) */

    int64_t capacity, count, crosses; /* the first is room for results; the count may exceed it, and is then needed */
    int64_t *first, *second, *wall;
    double *first_at, *second_at, *normal, *gap, *pair_margins;
} Query;

static void report(Query *q, int64_t first, double first_at, int64_t second, double second_at, double dx, double dy,
                   double distance, double gap, double margin, int64_t wall)
{
    int64_t k = q->count++;
    if (k >= q->capacity) return;
    double length = distance > 1e-12 ? distance : 1e-12;
    q->first[k] = first;
    q->first_at[k] = first_at;
    q->second[k] = second;
    q->second_at[k] = second_at;
    q->normal[2 * k] = dx / length;
    q->normal[2 * k + 1] = dy / length;
    q->gap[k] = gap;
    q->pair_margins[k] = margin;
    q->wall[k] = wall;
}

static int by_number(const void *a, const void *b)
{
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

static void sort(int64_t *numbers, int64_t count)
{
    if (count > 32) {
        qsort(numbers, (size_t)count, sizeof(int64_t), by_number);
        return;
    }
    for (int64_t k = 1; k < count; k++) {
        int64_t number = numbers[k], at = k;
        for (; at && numbers[at - 1] > number; at--) numbers[at] = numbers[at - 1];
        numbers[at] = number;
    }
}

/* Items of a tree whose boxes meet a box, in increasing order; returns how many. */
static int64_t meeting(const Tree *tree, const double *box, int64_t *found)
{
    int64_t count = 0;
    Walk walk;
    begin_walk(&walk, tree, box);
    for (int64_t item = next_item(&walk); item >= 0; item = next_item(&walk)) found[count++] = item;
    sort(found, count);
    return count;
}

/* Radius of the arm at the beginning of a link: of the thicker of the two that meet there. */
static double joint_radius(const Query *q, int64_t link)
{
    return link > q->mount_link ? fmax(q->radii[link - 1], q->radii[link]) : q->radii[link];
}

/* Distance from the axis to a core in contact. */
static double wall_gap(const Query *q, double radius, double rounding) { return radius + q->clearance + rounding; }

/* The box about a link grown by what a wall may be apart from its axis. */
static void box_about(const Query *q, int64_t link, double *box)
{
    const double *p = q->points + 2 * link;
    double grow = q->reach + wall_gap(q, joint_radius(q, link), q->most_rounding);
    for (int d = 0; d < 2; d++) {
        box[d] = fmin(p[d], p[2 + d]) - grow;
        box[2 + d] = fmax(p[d], p[2 + d]) + grow;
    }
}

static void links_with_vertices(Query *q)
{
    for (int64_t link = q->mount_link; link < q->links; link++) {
        const double *p = q->points + 2 * link;
        double dx = p[2] - p[0], dy = p[3] - p[1], square = q->lengths[link] * q->lengths[link];
        double least = link == q->mount_link ? q->mount_at : 0.0;
        double box[4];
        box_about(q, link, box);
        int64_t near = meeting(&q->vertex_tree, box, q->found);
        for (int64_t k = 0; k < near; k++) {
            int64_t vertex = q->found[k];
            const double *v = q->vertices + 2 * vertex;
            double along = ((v[0] - p[0]) * dx + (v[1] - p[1]) * dy) / square;
            /* Beyond its end the next link reports the joint that they share, if it is as thick. */
            if (along >= 1.0 && link != q->links - 1 && q->radii[link] <= q->radii[link + 1]) continue;
            double at = fmin(fmax(along, least), 1.0);
            double x = p[0] + at * dx - v[0], y = p[1] + at * dy - v[1];
            double distance = hypot(x, y);
            int64_t wall = q->vertex_wall[vertex];
            double gap = distance - wall_gap(q, q->radii[link], q->rounding[wall]);
            if (gap < q->reach) report(q, link, at, -1, 0.0, x, y, distance, gap, q->margin, wall);
        }
    }
}

/* Twice the signed area of a triangle: positive where r lies to the left of pq. */
static inline double side(const double *p, const double *q, const double *r)
{
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
}

/* Whether segments properly cross; the boxes of collinear ones, whose sides are rounding, are apart. */
static int cut(const double *p, const double *q, const double *r, const double *s)
{
    if (!(side(p, q, r) * side(p, q, s) < 0.0 && side(r, s, p) * side(r, s, q) < 0.0)) return 0;
    for (int d = 0; d < 2; d++)
        if (fmax(fmin(p[d], q[d]), fmin(r[d], s[d])) > fmin(fmax(p[d], q[d]), fmax(r[d], s[d]))) return 0;
    return 1;
}

static void joint_with_edge(Query *q, int64_t joint, const double *place, int64_t edge)
{
    const double *a = q->edges + 4 * edge;
    double ex = a[2] - a[0], ey = a[3] - a[1];
    double along = ((place[0] - a[0]) * ex + (place[1] - a[1]) * ey) / fmax(ex * ex + ey * ey, 1e-30);
    /* Where the foot lies beyond the edge, its vertex is nearer, and is reported with its link. */
    if (!(along > 0.0 && along < 1.0)) return;
    double x = place[0] - (a[0] + along * ex), y = place[1] - (a[1] + along * ey);
    double distance = hypot(x, y);
    int64_t link = joint < q->links ? joint : q->links - 1;
    int64_t wall = q->edge_wall[edge];
    double radius = joint == q->links ? q->radii[link] : joint_radius(q, link);
    double gap = distance - wall_gap(q, radius, q->rounding[wall]);
    if (gap >= q->reach) return;
    double at = joint == q->links ? 1.0 : joint == q->mount_link ? q->mount_at : 0.0;
    report(q, link, at, -1, 0.0, x, y, distance, gap, q->margin, wall);
}

/* Every joint beyond the mount is the near end of its link; the tip is the far end of the last. */
static void joints_with_edges(Query *q)
{
    for (int64_t link = q->mount_link; link < q->links; link++) {
        const double *p = q->points + 2 * link;
        double start[2] = {p[0], p[1]};
        if (link == q->mount_link) {
            start[0] += q->mount_at * (p[2] - p[0]);
            start[1] += q->mount_at * (p[3] - p[1]);
        }
        double box[4];
        box_about(q, link, box);
        int64_t near = meeting(&q->edge_tree, box, q->found);
        for (int64_t k = 0; k < near; k++) {
            const double *a = q->edges + 4 * q->found[k];
            if (!q->crosses && q->radii[link] >= 0.0 && cut(start, p + 2, a, a + 2)) q->crosses = 1;
            joint_with_edge(q, link, start, q->found[k]);
        }
        if (link == q->links - 1)
            for (int64_t k = 0; k < near; k++) joint_with_edge(q, q->links, p + 2, q->found[k]);
    }
}

static inline double clipped(double share) { return fmin(fmax(share, 0.0), 1.0); }

/* The closest points of two links that do not cross: the least of four distances from an end to the other link. */
static void link_with_link(Query *q, int64_t i, int64_t j)
{
    if (q->radii[i] < 0.0 || q->radii[j] < 0.0) return;
    const double *p = q->points + 2 * i, *r = q->points + 2 * j;
    double dx = p[2] - p[0], dy = p[3] - p[1], ex = r[2] - r[0], ey = r[3] - r[1];
    double wx = p[0] - r[0], wy = p[1] - r[1];
    double dd = fmax(dx * dx + dy * dy, 1e-30), ee = fmax(ex * ex + ey * ey, 1e-30);
    double dw = dx * wx + dy * wy, ew = ex * wx + ey * wy, de = dx * ex + dy * ey;
    double on_first[4] = {clipped(-dw / dd), clipped((de - dw) / dd), 0.0, 1.0};
    double on_second[4] = {0.0, 1.0, clipped(ew / ee), clipped((ew + de) / ee)};
    int best = 0;
    double least = INFINITY, x = 0.0, y = 0.0;
    for (int k = 0; k < 4; k++) {
        double ax = wx + on_first[k] * dx - on_second[k] * ex, ay = wy + on_first[k] * dy - on_second[k] * ey;
        double square = ax * ax + ay * ay;
        if (square < least) {
            best = k;
            least = square;
            x = ax;
            y = ay;
        }
    }
    if (!q->crosses && cut(p, p + 2, r, r + 2)) q->crosses = 1;
    double distance = hypot(x, y);
    double both = q->radii[i] + q->radii[j], gap = distance - both;
    if (gap >= q->reach) return;
    double margin = q->pair_share * (q->mean_length * (q->starts[j] - q->ends[i]) - both);
    report(q, i, on_first[best], j, on_second[best], x, y, distance, gap, fmin(fmax(margin, 0.0), q->margin), q->walls);
}

static void links_with_links(Query *q)
{
    int64_t n = q->links;
    int64_t runs = (n + RUN - 1) / RUN;
    for (int64_t k = 0; k < runs; k++) {
        double *box = q->runs + 4 * k;
        int64_t last = RUN * (k + 1) < n ? RUN * (k + 1) : n;
        memcpy(box, q->points + 2 * RUN * k, 2 * sizeof(double));
        memcpy(box + 2, box, 2 * sizeof(double));
        for (int64_t joint = RUN * k + 1; joint <= last; joint++)
            for (int d = 0; d < 2; d++) {
                double x = q->points[2 * joint + d];
                if (x < box[d]) box[d] = x;
                if (x > box[2 + d]) box[2 + d] = x;
            }
    }
    for (int64_t i = 0; i < n; i++) {
        const int32_t *next = q->next_pair + i * (n + 1);
        if (next[0] == n) continue;
        const double *p = q->points + 2 * i;
        double mx = 0.5 * (p[0] + p[2]), my = 0.5 * (p[1] + p[3]);
        for (int64_t k = next[0] / RUN; k < runs; k++) {
            const double *box = q->runs + 4 * k;
            double apart = q->radii[i] + q->thickest + q->reach;
            double far = apart + 0.5 * q->lengths[i];
            if (mx < box[0] - far || my < box[1] - far || mx > box[2] + far || my > box[3] + far) continue;
            double middles = far + 0.5 * q->longest;
            int64_t end = RUN * (k + 1) < n ? RUN * (k + 1) : n;
            for (int64_t j = next[RUN * k]; j < end; j = next[j + 1]) {
                const double *r = q->points + 2 * j;
                double x = 0.5 * (r[0] + r[2]) - mx, y = 0.5 * (r[1] + r[3]) - my;
                if (x * x + y * y < middles * middles) link_with_link(q, i, j);
            }
        }
    }
}

PUBLIC void near_pairs(Query *q)
{
    q->count = 0;
    q->crosses = 0;
    links_with_vertices(q);
    joints_with_edges(q);
    links_with_links(q);
}
