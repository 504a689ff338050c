/* A triangle that is near a segment, and where the two are nearest. */

#ifndef FACES_H
#define FACES_H

#include "surface_nodes.h"

typedef struct {
    double gap;
    Pair pair;
    int64_t face;
} Found;

/* Take a triangle where its gap is below the least that is known. */
static inline void look_at(const Surfaces *surfaces, const Segment *segment, int64_t face, Found *found)
{
    double within = found->gap + surfaces->rounding[face];
    if (!(within > 0.0)) return;
    Pair pair = {within * within, 0.0, {0.0, 0.0, 0.0}};
    segment_to_triangle(segment, surfaces->corners + 9 * face, &pair);
    if (pair.square >= within * within) return;
    found->gap = sqrt(pair.square) - surfaces->rounding[face];
    found->pair = pair;
    found->face = face;
}

/* A direction at right angles to a segment. */
static inline void across(const Segment *segment, double *direction)
{
    double axis[3] = {0.0, 0.0, 0.0};
    int least = 0;
    for (int d = 1; d < 3; d++)
        if (fabs(segment->line[d]) < fabs(segment->line[least])) least = d;
    axis[least] = 1.0;
    cross(segment->line, axis, direction);
    double length = sqrt(dot(direction, direction));
    for (int d = 0; d < 3; d++) direction[d] = length > 0.0 ? direction[d] / length : axis[d];
}

/* Unit direction from the surface to the segment; of a triangle that is crossed, its normal on the side of the
   segment's middle. */
static inline void outward(const Surfaces *surfaces, const Segment *segment, const Found *found, double *normal)
{
    const double *corners = surfaces->corners + 9 * found->face;
    double at[3], size = segment->square;
    Plane plane;
    along(segment->start, found->pair.share, segment->line, at);
    minus(at, found->pair.point, normal);
    int flat = plane_of(corners, &plane);
    size = larger(size, plane.edge_square);
    double square = dot(normal, normal);
    if (square > 1e-24 * size) {
        for (int d = 0; d < 3; d++) normal[d] /= sqrt(square);
        return;
    }
    if (!flat) {
        across(segment, normal);
        return;
    }
    along(segment->start, 0.5, segment->line, at);
    minus(at, corners, at);
    double side = dot(at, plane.normal) < 0.0 ? -1.0 : 1.0;
    for (int d = 0; d < 3; d++) normal[d] = side * plane.normal[d];
}

/* The point of the rounded surface, and the direction from it. */
static inline void witness(const Surfaces *surfaces, const Segment *segment, const Found *found, double *point,
                           double *normal)
{
    outward(surfaces, segment, found, normal);
    along(found->pair.point, surfaces->rounding[found->face], normal, point);
}

#endif
