/* Half-spaces that hold a segment and are free of the surfaces near it, nearest first.

   Boxes and triangles are taken in the order of their gaps from the segment (G. R. Hjaltason and H. Samet, Distance
   browsing in spatial databases, 1999). A triangle's plane at its nearest point is kept; all that lies behind a plane
   that is kept is dropped.

   Along a wall that is meshed finely there are thousands of triangles at nearly the same distance. So a triangle is kept
   as soon as nothing is nearer by more than the slack, boxes are gone down into at once as long as what is below is no
   farther by more than that, and of a box of small triangles that a plane parts only what is before the plane counts. */

#include "native.h"
#include "surface_walk.h"

#define FLATTEST 1e-6 /* squared sine of the angle between planes that meet anywhere */

typedef struct {
    double key;   /* the gap, changed by the slack at most */
    double gap;   /* of a triangle; of a box the least that what is in it may have */
    int32_t what; /* a node, or −1 − a triangle */
    int32_t seen; /* rows there were when it was put into the heap, behind none of which it lies */
} Entry;

typedef struct {
    Surfaces surfaces;
    int64_t count;
    const double *segments; /* (k, 2, 3) */
    double reach, behind, slack; /* the last is by which a triangle that is kept may be farther than the nearest */
    int64_t most, rows;      /* planes a segment; rows in all, −1 where there is too little memory */
    int64_t *segment, *face; /* (k most,), likewise below */
    double *share, *normal, *point, *gap;
    int64_t row;   /* of a moving chain so many segments are a row; 0 where each is for itself */
    double *known; /* (k,) of a moving chain; the reach where nothing is as near */

    Entry *waiting; /* a heap, the least gap on top */
    int64_t size, room;
} PlaneQuery;

void gaps_of_rows(const Surfaces *surfaces, const double *segments, int64_t count, int64_t row, double reach,
                  double slack, double *gap);

static inline int before(const Entry *one, const Entry *other)
{
    return one->key < other->key || (one->key == other->key && one->what < other->what);
}

/* Returns whether there was memory for it. */
static int push(PlaneQuery *q, double key, double gap, int64_t what, int64_t seen)
{
    if (q->size == q->room) {
        int64_t room = q->room ? 2 * q->room : 256;
        Entry *waiting = realloc(q->waiting, (size_t)room * sizeof(Entry));
        if (waiting == NULL) return 0;
        q->waiting = waiting;
        q->room = room;
    }
    Entry entry = {key, gap, (int32_t)what, (int32_t)seen};
    int64_t at = q->size++;
    for (; at && before(&entry, q->waiting + (at - 1) / 2); at = (at - 1) / 2)
        q->waiting[at] = q->waiting[(at - 1) / 2];
    q->waiting[at] = entry;
    return 1;
}

static Entry pop(PlaneQuery *q)
{
    Entry top = q->waiting[0], last = q->waiting[--q->size];
    int64_t at = 0;
    for (int64_t child = 1; child < q->size; child = 2 * at + 1) {
        if (child + 1 < q->size && before(q->waiting + child + 1, q->waiting + child)) child++;
        if (!before(q->waiting + child, &last)) break;
        q->waiting[at] = q->waiting[child];
        at = child;
    }
    q->waiting[at] = last;
    return top;
}

/* Whether all points at a rounding about the corners of a triangle lie behind one of the planes from the first on. */
static int is_behind(const PlaneQuery *q, int64_t first, int64_t face)
{
    const double *corners = q->surfaces.corners + 9 * face;
    for (int64_t row = first; row < q->rows; row++) {
        const double *normal = q->normal + 3 * row;
        double farthest = larger(larger(dot(normal, corners), dot(normal, corners + 3)), dot(normal, corners + 6));
        if (farthest + q->surfaces.rounding[face] <= dot(normal, q->point + 3 * row) + q->behind) return 1;
    }
    return 0;
}

static int is_box_behind(const PlaneQuery *q, int64_t first, const Node *node)
{
    for (int64_t row = first; row < q->rows; row++) {
        const double *normal = q->normal + 3 * row;
        double farthest[3];
        for (int d = 0; d < 3; d++) farthest[d] = normal[d] > 0.0 ? node->high[d] : node->low[d];
        if (dot(normal, farthest) + node->rounding <= dot(normal, q->point + 3 * row) + q->behind) return 1;
    }
    return 0;
}

static Found found_at(const PlaneQuery *q, const Segment *segment, int64_t face)
{
    Found found = {q->reach, {0.0, 0.0, {0.0, 0.0, 0.0}}, -1};
    look_at(&q->surfaces, segment, face, &found);
    return found;
}

/* The least gap of what lies before a plane and, as all triangles of a box do, beneath another one: the distance from
   the line where they meet, where that is what is nearest to every place of the segment; else nothing is known. */
static double wedge_gap(const Probe *probe, const double *lid, double above, const double *normal, double before)
{
    double mixed = dot(lid, normal), rest = dot(lid, lid) * dot(normal, normal) - mixed * mixed;
    double height = above - dot(lid, probe->middle), rise = -dot(lid, probe->half);
    double depth = before - dot(normal, probe->middle), fall = -dot(normal, probe->half);
    if (!(rest > FLATTEST)) return 0.0;
    for (int end = -1; end < 2; end += 2) {
        double to_lid = height + end * rise, to_plane = depth + end * fall;
        /* The way to the wedge must lead against the lid and along the plane's normal, neither of them alone enough. */
        if (to_lid * dot(normal, normal) > mixed * to_plane || to_plane * dot(lid, lid) < mixed * to_lid) return 0.0;
    }
    /* The squared distance from the line, times the rest, at a share of the half. */
    double n = dot(normal, normal), l = dot(lid, lid);
    double steep = n * rise * rise - 2.0 * mixed * rise * fall + l * fall * fall;
    double slope = n * height * rise - mixed * (height * fall + depth * rise) + l * depth * fall;
    double level = n * height * height - 2.0 * mixed * height * depth + l * depth * depth;
    double share = steep > 0.0 ? smaller(larger(-slope / steep, -1.0), 1.0) : 0.0;
    return sqrt(larger(level + 2.0 * share * slope + share * share * steep, 0.0) / rest);
}

/* The least gap that what is in a box, and not behind the planes from the first on, may have. */
static double gap_before(const PlaneQuery *q, const Probe *probe, const Node *node, int64_t first, double gap)
{
    /* Large triangles count with all of them, and may reach behind a plane by their longest edge. */
    double lid[3], above = node->above, part_behind = node->edge > q->behind ? node->edge : 0.0;
    for (int d = 0; d < 3; d++) lid[d] = node->normal[d];
    if (dot(lid, probe->middle) < node->beneath) {
        for (int d = 0; d < 3; d++) lid[d] = -lid[d];
        above = -node->beneath;
    }
    for (int64_t row = first; row < q->rows && gap < q->reach; row++) {
        const double *normal = q->normal + 3 * row;
        double before = dot(normal, q->point + 3 * row) + q->behind - node->rounding - part_behind;
        gap = larger(gap, wedge_gap(probe, lid, above, normal, before) - node->rounding);
    }
    return gap;
}

/* How far a place is from the middle of the segment along it, as a share of its length, at most 1. */
static double off_middle(const Probe *probe, const double *place)
{
    double away[3];
    minus(place, probe->middle, away);
    return probe->square > 0.0 ? smaller(0.5 * fabs(dot(away, probe->half)) / probe->square, 1.0) : 0.0;
}

/* Put the triangles of a leaf into the heap; returns whether there was memory for it. */
static int open_leaf(PlaneQuery *q, const Segment *segment, const Probe *probe, const Node *node, int64_t first)
{
    for (int64_t face = node->first; face < node->first + node->count; face++) {
        if (is_behind(q, first, face)) continue;
        Found found = found_at(q, segment, face);
        /* Triangles come before boxes in which nothing is nearer by more than the slack. */
        double key = found.gap - q->slack * (1.0 - off_middle(probe, found.pair.point));
        if (found.face >= 0 && !push(q, key, found.gap, -1 - face, q->rows - first)) return 0;
    }
    return 1;
}

/* Open a box, and the nearer of its halves as long as that is nearly as near; the rest goes into the heap. Returns
   whether there was memory for it. */
static int open_node(PlaneQuery *q, const Segment *segment, const Probe *probe, int64_t number, int64_t first,
                     double enough)
{
    for (;;) {
        const Node *node = q->surfaces.nodes + number;
        if (node->count) return open_leaf(q, segment, probe, node, first);
        double gap[2], key[2];
        for (int child = 0; child < 2; child++) {
            const Node *half = q->surfaces.nodes + node->first + child;
            gap[child] = is_box_behind(q, first, half) ? q->reach : least_gap(probe, half, q->reach);
            if (gap[child] < q->reach) gap[child] = gap_before(q, probe, half, first, gap[child]);
            double centre[3];
            for (int d = 0; d < 3; d++) centre[d] = 0.5 * ((double)half->low[d] + half->high[d]);
            key[child] = gap[child] + q->slack * off_middle(probe, centre);
        }
        int nearer = key[1] < key[0];
        int64_t seen = q->rows - first, other = 1 - nearer;
        if (gap[other] < q->reach && !push(q, key[other], gap[other], node->first + other, seen)) return 0;
        if (gap[nearer] > enough || gap[nearer] >= q->reach)
            return gap[nearer] >= q->reach || push(q, key[nearer], gap[nearer], node->first + nearer, seen);
        number = node->first + nearer;
    }
}

static void keep(PlaneQuery *q, int64_t number, const Segment *segment, const Found *found)
{
    int64_t row = q->rows++;
    q->segment[row] = number;
    q->face[row] = found->face;
    q->share[row] = found->pair.share;
    q->gap[row] = found->gap;
    witness(&q->surfaces, segment, found, q->point + 3 * row, q->normal + 3 * row);
}

/* The planes of one segment; returns whether there was memory for it. */
static int planes_about(PlaneQuery *q, int64_t number)
{
    Segment segment = segment_between(q->segments + 6 * number);
    Probe probe = probe_of(&segment);
    int64_t first = q->rows;
    if (!isfinite(segment.square + dot(segment.start, segment.start))) return 1; /* nothing is near what is none */
    q->size = 0;
    double whole = least_gap(&probe, q->surfaces.nodes, q->reach);
    if (!push(q, whole, whole, 0, 0)) return 0;
    while (q->size && q->rows < first + q->most) {
        Entry next = pop(q);
        int64_t unseen = first + next.seen;
        if (next.what < 0) {
            if (is_behind(q, unseen, -1 - (int64_t)next.what)) continue;
            Found found = found_at(q, &segment, -1 - (int64_t)next.what);
            keep(q, number, &segment, &found);
            continue;
        }
        const Node *node = q->surfaces.nodes + next.what;
        if (is_box_behind(q, unseen, node)) continue;
        /* Planes that were kept since it was put there may leave less of it. */
        double gap = gap_before(q, &probe, node, unseen, next.gap);
        if (gap >= q->reach) continue;
        double key = next.key + gap - next.gap;
        int is_next = q->size == 0 || key <= q->waiting[0].key;
        if (!(is_next ? open_node(q, &segment, &probe, next.what, first, gap + q->slack) : push(q, key, gap, next.what, q->rows - first)))
            return 0;
    }
    return 1;
}

PUBLIC void free_planes(PlaneQuery *q)
{
    q->rows = 0;
    q->waiting = NULL;
    q->room = 0;
    if (q->row) gaps_of_rows(&q->surfaces, q->segments, q->count, q->row, q->reach, q->reach, q->known);
    for (int64_t k = 0; k < q->count; k++) {
        if (q->row && q->known[k] >= q->reach) continue;
        if (!planes_about(q, k)) {
            q->rows = -1;
            break;
        }
    }
    free(q->waiting);
}
