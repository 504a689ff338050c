/* Distances of segments from triangles in space; a triangle may be a segment or a point.

   The nearest pair of a segment and a triangle is a pair of the segment and an edge, or an end of the segment and its
   foot inside the triangle, or their crossing (C. Ericson, Real-Time Collision Detection, 2005, sections 5.1.9 and
   5.1.10). Every pair is of points that lie on both within rounding, so the least is never below the distance.

   The corners come with the longest edge from the first to the second. The frame of the plane is that edge and the
   height on it, so that a sliver has a plane as good as its height is known, and one without height has none. */

#ifndef TRIANGLES_H
#define TRIANGLES_H

#include "vectors.h"

#define SLIVER 1e-12 /* squared sine of the angle at the first corner, below which rounding may turn the plane */
#define BEYOND (1.0 + 1e-9)
#define FLAT 1e-26 /* squared height over squared longest edge, below which a triangle is a segment */

typedef struct {
    double start[3], line[3], square; /* the last is the squared length */
} Segment;

typedef struct {
    double square;   /* squared distance; only nearer pairs are taken */
    double share;    /* where on the segment */
    double point[3]; /* on the triangle */
} Pair;

typedef struct {
    const double *corner;
    double edge[3], height[3], normal[3]; /* at right angles to each other; the normal has the length 1 */
    double edge_square, height_square, foot; /* the last is where the height meets the edge, as a share */
} Plane;

static inline Segment segment_between(const double *ends)
{
    Segment segment = {{ends[0], ends[1], ends[2]}, {0.0, 0.0, 0.0}, 0.0};
    minus(ends + 3, ends, segment.line);
    segment.square = dot(segment.line, segment.line);
    return segment;
}

static inline void offer(Pair *best, const Segment *segment, double share, const double *point)
{
    double at[3], apart[3];
    along(segment->start, share, segment->line, at);
    minus(at, point, apart);
    double square = dot(apart, apart);
    if (square >= best->square) return;
    best->square = square;
    best->share = share;
    for (int d = 0; d < 3; d++) best->point[d] = point[d];
}

static inline void segment_to_edge(const Segment *segment, const double *from, const double *to, Pair *best)
{
    double edge[3], apart[3], point[3];
    minus(to, from, edge);
    minus(segment->start, from, apart);
    double a = segment->square, e = dot(edge, edge), b = dot(segment->line, edge);
    double c = dot(segment->line, apart), f = dot(edge, apart);
    double share = 0.0, at = 0.0;
    if (a > 0.0 && e > 0.0) {
        double denominator = a * e - b * b;
        share = denominator > 0.0 ? clamped((b * f - c * e) / denominator) : 0.0;
        at = (b * share + f) / e;
        if (at < 0.0) share = clamped(-c / a);
        if (at > 1.0) share = clamped((b - c) / a);
        at = clamped(at);
    } else if (a > 0.0) {
        share = clamped(-c / a);
    } else if (e > 0.0) {
        at = clamped(f / e);
    }
    along(from, at, edge, point);
    offer(best, segment, share, point);
}

/* Whether a triangle has a plane, and which. */
static inline int plane_of(const double *corners, Plane *plane)
{
    double side[3];
    plane->corner = corners;
    minus(corners + 3, corners, plane->edge);
    minus(corners + 6, corners, side);
    plane->edge_square = dot(plane->edge, plane->edge);
    if (!(plane->edge_square > 0.0)) return 0;
    plane->foot = dot(side, plane->edge) / plane->edge_square;
    along(side, -plane->foot, plane->edge, plane->height);
    plane->height_square = dot(plane->height, plane->height);
    if (!(plane->height_square > FLAT * plane->edge_square)) return 0;
    cross(plane->edge, plane->height, plane->normal);
    double length = sqrt(dot(plane->normal, plane->normal));
    for (int d = 0; d < 3; d++) plane->normal[d] /= length;
    return 1;
}

/* Whether a point's foot on the plane lies in the triangle. */
static inline int over(const Plane *plane, const double *from_corner)
{
    double up = dot(from_corner, plane->height) / plane->height_square;
    double at = dot(from_corner, plane->edge) / plane->edge_square;
    return up >= 0.0 && at >= plane->foot * up && 1.0 - at >= (1.0 - plane->foot) * up;
}

/* Pairs inside the triangle; returns whether the edges may still be nearer. */
static inline int segment_to_inside(const Segment *segment, const Plane *plane, Pair *best)
{
    double from[3], at[3], point[3];
    minus(segment->start, plane->corner, from);
    double begins = dot(from, plane->normal), ends = begins + dot(segment->line, plane->normal);
    double least = smaller(fabs(begins), fabs(ends));
    int parted = begins * ends > 0.0;
    if (parted && least * least >= best->square) return 0;
    if (!parted && begins != ends) {
        double share = begins / (begins - ends);
        along(from, share, segment->line, at);
        if (over(plane, at)) {
            best->square = 0.0;
            best->share = share;
            along(segment->start, share, segment->line, best->point);
            return 0;
        }
    }
    for (int end = 0; end < 2; end++) {
        double height = end ? ends : begins;
        if (height * height >= best->square) continue;
        along(from, end, segment->line, at);
        if (!over(plane, at)) continue;
        along(segment->start, end, segment->line, point);
        along(point, -height, plane->normal, point);
        offer(best, segment, end, point);
    }
    return 1;
}

/* Whether a triangle's plane alone is no nearer than the best, by more than rounding: it takes neither quotient nor
   root, and says so of most triangles of a fine mesh. Nothing is said of slivers. */
static inline int is_plane_beyond(const Segment *segment, const double *corners, double square)
{
    double edge[3], side[3], normal[3], from[3];
    minus(corners + 3, corners, edge);
    minus(corners + 6, corners, side);
    cross(edge, side, normal);
    minus(segment->start, corners, from);
    double begins = dot(from, normal), ends = begins + dot(segment->line, normal), size = dot(normal, normal);
    double least = smaller(fabs(begins), fabs(ends));
    return (size > SLIVER * dot(edge, edge) * dot(side, side)) & (begins * ends > 0.0)
           & (least * least > BEYOND * square * size);
}

/* As segment_to_triangle for a segment that is a point, without roots; only the edges that the point lies beyond are
   looked at. Returns whether the triangle is none of the slivers, of which this says nothing. */
static inline int point_to_triangle(const Segment *segment, const double *corners, Pair *best)
{
    double edge[3], side[3], normal[3], from[3], at[3], out[3], inside = 1.0;
    minus(corners + 3, corners, edge);
    minus(corners + 6, corners, side);
    cross(edge, side, normal);
    minus(segment->start, corners, from);
    double size = dot(normal, normal), height = dot(from, normal);
    if (!(size > SLIVER * dot(edge, edge) * dot(side, side))) return 0;
    if (height * height > BEYOND * best->square * size) return 1;
    for (int k = 0; k < 3; k++) {
        const double *begins = corners + 3 * k, *ends = corners + 3 * ((k + 1) % 3);
        minus(ends, begins, edge);
        minus(segment->start, begins, at);
        cross(normal, edge, out);
        if (dot(out, at) >= 0.0) continue;
        segment_to_edge(segment, begins, ends, best);
        inside = 0.0;
    }
    if (inside != 0.0) {
        along(segment->start, -height / size, normal, at);
        offer(best, segment, 0.0, at);
    }
    return 1;
}

/* The nearest pair, where it is nearer than the best that is known. */
static inline void segment_to_triangle(const Segment *segment, const double *corners, Pair *best)
{
    Plane plane;
    if (segment->square == 0.0 && point_to_triangle(segment, corners, best)) return;
    if (is_plane_beyond(segment, corners, best->square)) return;
    if (plane_of(corners, &plane) && !segment_to_inside(segment, &plane, best)) return;
    segment_to_edge(segment, corners, corners + 3, best);
    segment_to_edge(segment, corners + 3, corners + 6, best);
    segment_to_edge(segment, corners + 6, corners, best);
}

#endif
