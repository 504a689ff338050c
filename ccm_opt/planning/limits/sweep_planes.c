/* Half-planes round the sweep of every link in every interval: sweep_regions.py in C.

   Walls come through a bounding-box tree (box_tree.py), nearest first; a wall behind a half-plane that has been chosen
   is skipped. */

#include "native.h"
#include "box_tree.h"
#include "segments.h"

#define CORNERS 6 /* of a sweep: both ends of a link at three times */

typedef struct {
    double gap, normal[2], bound;
    int64_t wall;
} Plane;

typedef struct {
    int64_t sweeps;
    const double *corners;  /* (sweeps, 6, 2) */
    const double *halfway;  /* the link half-way through the interval, (sweeps, 2, 2) */
    Tree tree;
    const double *ends;     /* of the segments of walls, (E, 2, 2) */
    const double *rounding; /* (E,) */
    double far;             /* cores farther away are left out */
    double shortest;        /* shorter lines have no direction */
    double behind;          /* by which a wall may stand out of a half-plane that it counts as behind */
    Plane *planes;          /* working memory, (E,) */

    int64_t capacity, count; /* the count may exceed the capacity, and is then needed */
    int64_t *sweep;
    double *normal, *bound;
} Query;

/* What is no number comes last: without one order for all, sorting may leave its array. */
static int compared(double a, double b) { return isnan(a) || isnan(b) ? isnan(a) - isnan(b) : (a > b) - (a < b); }

static int by_place(const void *one, const void *two)
{
    const double *a = one, *b = two;
    int first = compared(a[0], b[0]);
    return first ? first : compared(a[1], b[1]);
}

/* The convex hull, counter-clockwise (Andrew's monotone chain); returns the number of its corners. */
static int hull_of(const double *corners, double *hull)
{
    double sorted[2 * CORNERS];
    int size = 0;
    for (int k = 0; k < 2 * CORNERS; k++) sorted[k] = corners[k];
    qsort(sorted, CORNERS, 2 * sizeof(double), by_place);
    for (int side = 0; side < 2; side++) {
        int first = size;
        for (int k = 0; k < CORNERS; k++) {
            const double *p = sorted + 2 * (side ? CORNERS - 1 - k : k);
            while (size >= first + 2 && cross(hull + 2 * (size - 2), hull + 2 * (size - 1), p) <= 0.0) size--;
            hull[2 * size] = p[0];
            hull[2 * size + 1] = p[1];
            size++;
        }
        size--; /* where a chain ends the other begins */
    }
    return size > 0 ? size : 1;
}

static int inside(const double *hull, int size, const double *p)
{
    if (size < 3) return 0;
    for (int k = 0; k < size; k++)
        if (cross(hull + 2 * k, hull + 2 * ((k + 1) % size), p) < 0.0) return 0;
    return 1;
}

/* The shortest vector from a hull to a segment; returns its length. */
static double from_hull(const double *hull, int size, const double *wall, double *line)
{
    double best = INFINITY, other[2];
    line[0] = line[1] = 0.0;
    if (inside(hull, size, wall)) return 0.0;
    for (int k = 0; k < size; k++) {
        double square = between(hull + 2 * k, hull + 2 * ((k + 1) % size), wall, wall + 2, other);
        if (square >= best) continue;
        best = square;
        line[0] = other[0];
        line[1] = other[1];
    }
    return sqrt(best);
}

static void plane_of(const Query *q, int64_t sweep, const double *line, double length, double rounding, Plane *plane)
{
    const double *wall = q->ends + 4 * plane->wall;
    double direction[2] = {line[0], line[1]};
    plane->gap = length - rounding;
    if (length < q->shortest) {
        /* The hull of three poses may touch a wall that the link clears: the link half-way has a direction. */
        const double *link = q->halfway + 4 * sweep;
        length = sqrt(between(link, link + 2, wall, wall + 2, direction));
        plane->gap = -rounding;
    }
    length = fmax(length, 1e-12);
    plane->normal[0] = direction[0] / length;
    plane->normal[1] = direction[1] / length;
    plane->bound = fmin(dot(plane->normal, wall), dot(plane->normal, wall + 2)) - rounding;
}

/* Half-planes of all walls near a sweep; returns how many. */
static int64_t near_walls(const Query *q, int64_t sweep, Plane *planes)
{
    const double *corners = q->corners + 2 * CORNERS * sweep;
    double hull[4 * CORNERS], box[4];
    int size = hull_of(corners, hull);
    for (int d = 0; d < 2; d++) {
        box[d] = box[2 + d] = corners[d];
        for (int k = 1; k < CORNERS; k++) {
            box[d] = fmin(box[d], corners[2 * k + d]);
            box[2 + d] = fmax(box[2 + d], corners[2 * k + d]);
        }
        box[d] -= q->far;
        box[2 + d] += q->far;
    }

    int64_t count = 0;
    Walk walk;
    begin_walk(&walk, &q->tree, box);
    for (int64_t wall = next_item(&walk); wall >= 0; wall = next_item(&walk)) {
        double line[2];
        double length = from_hull(hull, size, q->ends + 4 * wall, line);
        if (length > q->far) continue;
        planes[count].wall = wall;
        plane_of(q, sweep, line, length, q->rounding[wall], planes + count);
        count++;
    }
    return count;
}

static int by_gap(const void *one, const void *two)
{
    const Plane *a = one, *b = two;
    int first = compared(a->gap, b->gap);
    return first ? first : (a->wall > b->wall) - (a->wall < b->wall);
}

PUBLIC void sweep_planes(Query *q)
{
    Plane *planes = q->planes;
    q->count = 0;
    for (int64_t sweep = 0; sweep < q->sweeps; sweep++) {
        int64_t waiting = near_walls(q, sweep, planes);
        qsort(planes, (size_t)waiting, sizeof(Plane), by_gap);
        while (waiting) {
            Plane chosen = planes[0];
            int64_t k = q->count++, left = 0;
            if (k < q->capacity) {
                q->sweep[k] = sweep;
                q->normal[2 * k] = chosen.normal[0];
                q->normal[2 * k + 1] = chosen.normal[1];
                q->bound[k] = chosen.bound;
            }
            for (int64_t j = 1; j < waiting; j++) {
                const double *wall = q->ends + 4 * planes[j].wall;
                double least = fmin(dot(chosen.normal, wall), dot(chosen.normal, wall + 2));
                if (least - q->rounding[planes[j].wall] < chosen.bound - q->behind) planes[left++] = planes[j];
            }
            waiting = left;
        }
    }
}
