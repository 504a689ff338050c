/* A hierarchy of boxes about the triangles of a scene, and how near a segment may come to what is in a box. */

#ifndef SURFACE_NODES_H
#define SURFACE_NODES_H

#include "native.h"
#include "triangles.h"

#define DEEPEST 128 /* levels of a tree: building stops long before */

typedef struct {
    float low[3], high[3];            /* rounded outwards, as is the rest */
    float rounding;                   /* the largest in it */
    float edge;                       /* the longest of its triangles */
    float normal[3], beneath, above;  /* its triangles lie between two planes; none where the normal is zero */
    int32_t first, count;             /* of its triangles; without any, the first of its two children */
} Node;

typedef struct {
    const Node *nodes;
    const double *corners;  /* (m, 3, 3), in the order of the leaves */
    const double *rounding; /* (m,) likewise */
} Surfaces;

/* A segment as boxes are asked about it. */
typedef struct {
    double middle[3], half[3], reach[3]; /* the last is the absolute value of the half */
    double square;                       /* squared length of the half */
} Probe;

static inline Probe probe_of(const Segment *segment)
{
    Probe probe;
    for (int d = 0; d < 3; d++) {
        probe.half[d] = 0.5 * segment->line[d];
        probe.middle[d] = segment->start[d] + probe.half[d];
        probe.reach[d] = fabs(probe.half[d]);
    }
    probe.square = 0.25 * segment->square;
    return probe;
}

/* What the tangent of the squared distance from a box at a place of the segment says of all its places: the squared
   distance is convex along the segment, so that none is less than the tangent's least. */
static inline double tangent_bound(const Probe *probe, const double *centre, const double *size, double at,
                                   double *slope, double *curvature)
{
    double value = 0.0;
    *slope = *curvature = 0.0;
    for (int d = 0; d < 3; d++) {
        double offset = probe->middle[d] + at * probe->half[d] - centre[d];
        double beyond = larger(fabs(offset) - size[d], 0.0);
        value += beyond * beyond;
        *slope += 2.0 * beyond * (offset < 0.0 ? -probe->half[d] : probe->half[d]);
        *curvature += beyond > 0.0 ? 2.0 * probe->half[d] * probe->half[d] : 0.0;
    }
    double fall = *slope > 0.0 ? *slope * (at + 1.0) : -*slope * (1.0 - at);
    return value - fall;
}

/* Squared distance that a segment has from a box, or less; a first look is enough where that is beyond the limit. */
static inline double squared_bound(const Probe *probe, const Node *node, double limit)
{
    double centre[3], size[3], apart = 0.0, at = 0.0, slope, curvature;
    for (int d = 0; d < 3; d++) {
        centre[d] = 0.5 * ((double)node->low[d] + node->high[d]);
        size[d] = 0.5 * ((double)node->high[d] - node->low[d]);
        double offset = centre[d] - probe->middle[d];
        double gap = larger(fabs(offset) - size[d] - probe->reach[d], 0.0);
        apart += gap * gap;
        at += offset * probe->half[d];
    }
    /* Of a point the first look is the last. */
    if (apart >= limit || probe->square == 0.0) return apart;
    at = probe->square > 0.0 ? smaller(larger(at / probe->square, -1.0), 1.0) : 0.0;
    double bound = larger(apart, tangent_bound(probe, centre, size, at, &slope, &curvature));
    /* A step of Newton's: the squared distance is quadratic but for few kinks. */
    if (curvature > 0.0 && bound < limit) {
        at = smaller(larger(at - slope / curvature, -1.0), 1.0);
        bound = larger(bound, tangent_bound(probe, centre, size, at, &slope, &curvature));
    }
    return bound;
}

/* Distance that a segment has from the planes between which the triangles lie, or less. A wall that is meshed finely
   lies in thin slices, but in thick boxes where it is oblique. */
static inline double slice_bound(const Probe *probe, const Node *node)
{
    double height = 0.0, reach = 0.0;
    for (int d = 0; d < 3; d++) {
        height += node->normal[d] * probe->middle[d];
        reach += node->normal[d] * probe->half[d];
    }
    reach = fabs(reach);
    return larger(node->beneath - height - reach, height - reach - node->above);
}

/* The least gap that a segment may have from what is in a box; the limit is a gap that is of no interest any more. */
static inline double least_gap(const Probe *probe, const Node *node, double limit)
{
    double far = limit + node->rounding;
    if (far <= 0.0) return limit;
    double slice = slice_bound(probe, node);
    if (slice >= far) return limit;
    double bound = squared_bound(probe, node, far * far);
    return larger(slice, sqrt(bound)) - node->rounding;
}

#endif
