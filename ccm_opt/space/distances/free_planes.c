/* Half-spaces that hold a segment and are free of the surfaces near it, nearest first.

   Boxes and triangles are taken in the order of their gaps from the segment (G. R. Hjaltason and H. Samet, Distance
   browsing in spatial databases, 1999). A triangle's plane at its nearest point is kept; all that lies behind a plane
   that is kept is dropped. The nearest triangle of all is found first by a walk: along a wall at the same distance there
   may be thousands of boxes that are hardly nearer, and lie behind its plane. */

#include <stdlib.h>

#include "surface_walk.h"

typedef struct {
    double gap;   /* of a triangle; of a box the least that what is in it may have */
    int64_t what; /* a node, or −1 − a triangle */
} Entry;

typedef struct {
    Surfaces surfaces;
    int64_t count;
    const double *segments; /* (k, 2, 3) */
    double reach, behind;
    int64_t most, rows;      /* planes a segment; rows in all, −1 where there is too little memory */
    int64_t *segment, *face; /* (k most,), likewise below */
    double *share, *normal, *point, *gap;

    Entry *waiting; /* a heap, the least gap on top */
    int64_t size, room;
} PlaneQuery;

static inline int before(const Entry *one, const Entry *other)
{
    return one->gap < other->gap || (one->gap == other->gap && one->what < other->what);
}

/* Returns whether there was memory for it. */
static int push(PlaneQuery *q, double gap, int64_t what)
{
    if (q->size == q->room) {
        int64_t room = q->room ? 2 * q->room : 256;
        Entry *waiting = realloc(q->waiting, (size_t)room * sizeof(Entry));
        if (waiting == NULL) return 0;
        q->waiting = waiting;
        q->room = room;
    }
    Entry entry = {gap, what};
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

/* Whether all points at a rounding about the corners of a triangle lie behind one of a segment's planes. */
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

/* Put what is in a box into the heap; returns whether there was memory for it. */
static int open_node(PlaneQuery *q, const Segment *segment, const Probe *probe, const Node *node, int64_t first)
{
    const Surfaces *surfaces = &q->surfaces;
    for (int64_t face = node->first; face < node->first + node->count; face++) {
        if (is_behind(q, first, face)) continue;
        Found found = found_at(q, segment, face);
        if (found.face >= 0 && !push(q, found.gap, -1 - face)) return 0;
    }
    if (node->count) return 1;
    for (int64_t child = node->first; child < node->first + 2; child++) {
        if (is_box_behind(q, first, surfaces->nodes + child)) continue;
        double gap = least_gap(probe, surfaces->nodes + child, q->reach);
        if (gap < q->reach && !push(q, gap, child)) return 0;
    }
    return 1;
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
    double least;
    Found found = nearest_face(&q->surfaces, &segment, q->reach, 0.0, -1, &least);
    if (found.face < 0 || q->most < 1) return 1;
    keep(q, number, &segment, &found);
    q->size = 0;
    if (!push(q, found.gap, 0)) return 0;
    while (q->size && q->rows < first + q->most) {
        Entry next = pop(q);
        int64_t face = -1 - next.what;
        if (next.what >= 0) {
            const Node *node = q->surfaces.nodes + next.what;
            if (!is_box_behind(q, first, node) && !open_node(q, &segment, &probe, node, first)) return 0;
        } else if (!is_behind(q, first, face)) {
            found = found_at(q, &segment, face);
            keep(q, number, &segment, &found);
        }
    }
    return 1;
}

PUBLIC void free_planes(PlaneQuery *q)
{
    q->rows = 0;
    q->waiting = NULL;
    q->room = 0;
    for (int64_t k = 0; k < q->count; k++)
        if (!planes_about(q, k)) {
            q->rows = -1;
            break;
        }
    free(q->waiting);
}
