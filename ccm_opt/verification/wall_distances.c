/* Bounds on the distances of segments from bounding boxes and from triangles, for the verifier alone. */

#include "native.h"

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static void minus(const double *a, const double *b, double *out)
{
    for (int k = 0; k < 3; k++) out[k] = a[k] - b[k];
}

static double clipped(double share)
{
    return share > 0.0 ? share < 1.0 ? share : 1.0 : 0.0;
}

typedef struct {
    int64_t count, dimension;
    const int64_t *node;             /* (P,) box of each segment */
    const double *start, *end;       /* (P, d) */
    const double *low, *high;        /* (nodes, d) corners of all boxes */
    double *least, *most;            /* (P,) bounds on the distance from whatever is in the box */
} BoxBounds;

/* A segment, its corners that are least and greatest in each coordinate, and its squared length. */
typedef struct {
    double start[3], line[3], low[3], high[3], square;
} Segment;

static Segment segment_between(int64_t d, const double *start, const double *end)
{
    Segment s = {.square = 0.0};
    for (int64_t k = 0; k < d; k++) {
        s.start[k] = start[k];
        s.line[k] = end[k] - start[k];
        s.low[k] = fmin(start[k], end[k]);
        s.high[k] = fmax(start[k], end[k]);
        s.square += s.line[k] * s.line[k];
    }
    if (!(s.square > 0.0)) s.square = 1.0;
    return s;
}

/* The parts in a box are no nearer than the box is to the segment's own box, or than the ball around the box. */
static ALWAYS_INLINE void box_bound(int64_t d, const Segment *s, const double *low, const double *high, double *least,
                                    double *most)
{
    double apart = 0.0, along = 0.0, diagonal = 0.0, away = 0.0;
    for (int64_t k = 0; k < d; k++) {
        double beyond = low[k] - s->high[k] > s->low[k] - high[k] ? low[k] - s->high[k] : s->low[k] - high[k];
        beyond = beyond > 0.0 ? beyond : 0.0;
        apart += beyond * beyond;
        along += (0.5 * (low[k] + high[k]) - s->start[k]) * s->line[k];
        diagonal += (high[k] - low[k]) * (high[k] - low[k]);
    }
    double share = clipped(along / s->square), half = 0.5 * sqrt(diagonal);
    for (int64_t k = 0; k < d; k++) {
        double off = s->start[k] + share * s->line[k] - 0.5 * (low[k] + high[k]);
        away += off * off;
    }
    double near = sqrt(apart), ball = sqrt(away);
    *least = near > ball - half ? near : ball - half;
    *most = ball + half;
}

PUBLIC void box_bounds(BoxBounds *q)
{
    int64_t d = q->dimension;
    for (int64_t p = 0; p < q->count; p++) {
        const double *low = q->low + d * q->node[p], *high = q->high + d * q->node[p];
        Segment segment = segment_between(d, q->start + d * p, q->end + d * p);
        box_bound(d, &segment, low, high, q->least + p, q->most + p);
    }
}

typedef struct {
    int64_t count, dimension, joints, single; /* joints and tip of the arm; the first box of a single part */
    const int64_t *interval, *link, *node;    /* (P,) of each pair of a link and a box */
    const double *poses, *travels;            /* (S, joints, d), (S, joints) */
    const double *exposed, *radii;            /* (links,) share of each link that is the mount's */
    const double *low, *high, *rounding;      /* (nodes, d), (nodes,) of all boxes */
    double loss;                              /* of distance by rounding */
    const double *deviation, *cutoff;         /* (P,) */
    double *least, *most, *travel;            /* (P,) */
    uint8_t *near;                            /* (P,) whether the box holds a single part that may be within the cutoff */
} LinkBoxes;

/* Bounds on the gaps of links from the parts in boxes. */
static ALWAYS_INLINE void bound_gaps(LinkBoxes *q, int64_t d)
{
    Segment segment = {.square = 1.0};
    double travel = 0.0;
    for (int64_t p = 0; p < q->count; p++) {
        int64_t link = q->link[p], joint = q->joints * q->interval[p] + link, node = q->node[p];
        double low, high, radius = q->radii[link];
        /* Boxes of one parent follow on each other, with the same link. */
        if (p == 0 || q->interval[p] != q->interval[p - 1] || link != q->link[p - 1]) {
            const double *from = q->poses + d * joint, *end = from + d;
            double start[3], first = q->travels[joint], second = q->travels[joint + 1];
            for (int64_t k = 0; k < d; k++) start[k] = from[k] + q->exposed[link] * (end[k] - from[k]);
            segment = segment_between(d, start, end);
            travel = first > second || first != first ? first : second; /* what is not a number stays so */
        }
        box_bound(d, &segment, q->low + d * node, q->high + d * node, &low, &high);
        double gap = low - (radius + q->rounding[node] + q->loss + q->deviation[p]);
        q->travel[p] = travel;
        q->least[p] = gap - travel;
        /* A box may hold parts with a smaller radius than the largest, which are farther away. */
        q->most[p] = high - radius;
        q->near[p] = node >= q->single && q->least[p] < q->cutoff[p];
    }
}

PUBLIC void link_boxes(LinkBoxes *q)
{
    if (q->dimension == 3) bound_gaps(q, 3);
    else bound_gaps(q, 2);
}

typedef struct {
    int64_t count;
    const double *start, *end; /* (P, 3) */
    const double *triangles;   /* (P, 3, 3) corners */
    double *normal;            /* (P, 3) unit vector from the triangle to the segment; zero where they touch */
    double *upper, *lower;     /* (P,) distance of a pair of points; bound that the unit vector proves */
} SegmentTriangles;

typedef struct {
    double square, apart[3];
} Nearest;

static void offer(Nearest *best, const double *apart)
{
    double square = dot(apart, apart);
    if (square < best->square) {
        best->square = square;
        memcpy(best->apart, apart, sizeof best->apart);
    }
}

/* From a point of a segment that starts at the origin, as near as it comes to a point, to that point. */
static void from_segment(const double *point, const double *line, double *out)
{
    double square = dot(line, line), share = clipped(dot(point, line) / (square > 0.0 ? square : 1.0));
    for (int k = 0; k < 3; k++) out[k] = point[k] - share * line[k];
}

/* Between the lines of an edge from the origin and of the segment from `offset`, where both ends are within them. */
static void between_lines(Nearest *best, const double *offset, const double *line, const double *edge)
{
    double normal[3], turned[3], apart[3];
    cross(line, edge, normal);
    double square = dot(normal, normal);
    if (!(square > 0.0)) return;
    cross(offset, edge, turned);
    double share = -dot(turned, normal) / square;
    cross(offset, line, turned);
    double at = -dot(turned, normal) / square;
    if (!(share >= 0.0 && share <= 1.0 && at >= 0.0 && at <= 1.0)) return;
    for (int k = 0; k < 3; k++) apart[k] = offset[k] + share * line[k] - at * edge[k];
    offer(best, apart);
}

typedef struct {
    const double *one, *other; /* edges from the first corner */
    double normal[3], square;
} Face;

/* Whether the foot of a point, relative to the first corner, is within the triangle. */
static int inside(const Face *face, const double *point)
{
    double turned[3];
    cross(point, face->other, turned);
    double first = dot(turned, face->normal);
    cross(face->one, point, turned);
    double second = dot(turned, face->normal);
    return first >= 0.0 && second >= 0.0 && first + second <= face->square;
}

/* From the inside of the triangle: to both ends of the segment, and to where it crosses. */
static void through_face(Nearest *best, const Face *face, const double *begin, const double *finish, const double *line)
{
    double apart[3], at[3];
    if (!(face->square > 0.0)) return;
    double begins = dot(begin, face->normal), rises = dot(line, face->normal), heights[2] = {begins, begins + rises};
    const double *ends[2] = {begin, finish};
    for (int side = 0; side < 2; side++) {
        if (!inside(face, ends[side])) continue;
        for (int k = 0; k < 3; k++) apart[k] = heights[side] / face->square * face->normal[k];
        offer(best, apart);
    }
    /* Compared before dividing, for a rise that is tiny. */
    if (rises == 0.0 || fabs(begins) > fabs(rises)) return;
    double share = -begins / rises;
    if (!(share >= 0.0 && share <= 1.0)) return;
    for (int k = 0; k < 3; k++) at[k] = begin[k] + share * line[k];
    if (inside(face, at)) offer(best, (const double[3]){0.0, 0.0, 0.0});
}

PUBLIC void segment_triangles(SegmentTriangles *q)
{
    for (int64_t p = 0; p < q->count; p++) {
        const double *start = q->start + 3 * p, *end = q->end + 3 * p, *corners = q->triangles + 9 * p;
        double line[3], begins[3][3], finishes[3][3], edges[3][3], apart[3];
        Nearest best = {INFINITY, {0.0, 0.0, 0.0}};
        minus(end, start, line);
        for (int k = 0; k < 3; k++) {
            const double *corner = corners + 3 * k;
            minus(corners + 3 * ((k + 1) % 3), corner, edges[k]);
            minus(start, corner, begins[k]);
            minus(end, corner, finishes[k]);
            double to_corner[3] = {-begins[k][0], -begins[k][1], -begins[k][2]};
            from_segment(to_corner, line, apart);
            for (int axis = 0; axis < 3; axis++) apart[axis] = -apart[axis];
            offer(&best, apart);
            from_segment(begins[k], edges[k], apart);
            offer(&best, apart);
            from_segment(finishes[k], edges[k], apart);
            offer(&best, apart);
            between_lines(&best, begins[k], line, edges[k]);
        }
        double other[3];
        minus(corners + 6, corners, other);
        Face face = {edges[0], other, {0.0, 0.0, 0.0}, 0.0};
        cross(face.one, face.other, face.normal);
        face.square = dot(face.normal, face.normal);
        through_face(&best, &face, begins[0], finishes[0], line);
        double upper = sqrt(best.square), *normal = q->normal + 3 * p;
        for (int k = 0; k < 3; k++) normal[k] = best.apart[k] / (upper > 0.0 ? upper : 1.0);
        /* Projections are relative to a corner, so that points far from the origin lose no digits. */
        double lowest = fmin(dot(begins[0], normal), dot(finishes[0], normal));
        double highest = fmax(fmax(0.0, dot(edges[0], normal)), dot(other, normal));
        q->upper[p] = upper;
        q->lower[p] = fmax(lowest - highest, 0.0);
    }
}
