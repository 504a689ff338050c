/* A walk through the boxes about the triangles of a scene, the nearest first. */

#ifndef SURFACE_WALK_H
#define SURFACE_WALK_H

#include "faces.h"

/* Nodes that a walk has still to see, the nearest on top. */
typedef struct {
    int64_t waiting[DEEPEST], node; /* the latter is where the walk is */
    double bounds[DEEPEST];
    double least; /* bound below which nothing has been passed by */
    int top;
} Walk;

static inline void step_to(Walk *walk, int64_t node, double bound)
{
    walk->bounds[walk->top] = bound;
    walk->waiting[walk->top++] = node;
}

/* Go on to the next node that may hold something nearer than the limit; returns whether there is one. */
static inline int next_node(Walk *walk, double limit)
{
    while (walk->top) {
        walk->top--;
        walk->node = walk->waiting[walk->top];
        if (walk->bounds[walk->top] < limit) return 1;
        walk->least = smaller(walk->least, walk->bounds[walk->top]);
    }
    return 0;
}

/* Put the children of a node on top, the nearer one last. */
static inline void step_down(Walk *walk, const Surfaces *surfaces, const Probe *probe, const Node *node, double limit)
{
    double bounds[2];
    for (int child = 0; child < 2; child++) {
        bounds[child] = least_gap(probe, surfaces->nodes + node->first + child, limit);
        if (bounds[child] >= limit) walk->least = smaller(walk->least, bounds[child]);
    }
    int nearer = bounds[1] < bounds[0];
    for (int k = 0; k < 2; k++) {
        int child = k == 0 ? 1 - nearer : nearer;
        if (bounds[child] < limit) step_to(walk, node->first + child, bounds[child]);
    }
}

/* Look at what is below a node and may be nearer than what was found, or than the reach where nothing was; the least
   is lowered to the bounds of what is passed by. */
static inline void look_below(const Surfaces *surfaces, const Segment *segment, const Probe *probe, int64_t below,
                              double reach, double slack, Found *found, double *least)
{
    double limit = found->face >= 0 ? found->gap - slack : reach;
    Walk walk;
    walk.top = 0;
    walk.least = *least;
    step_to(&walk, below, least_gap(probe, surfaces->nodes + below, limit));
    while (next_node(&walk, limit)) {
        const Node *node = surfaces->nodes + walk.node;
        for (int64_t face = node->first; face < node->first + node->count; face++)
            look_at(surfaces, segment, face, found);
        if (found->face >= 0) limit = found->gap - slack;
        if (node->count == 0) step_down(&walk, surfaces, probe, node, limit);
    }
    *least = walk.least;
}

/* The nearest triangle; no triangle is nearer than the least, which is below its gap by the slack at most. */
static inline Found nearest_face(const Surfaces *surfaces, const Segment *segment, double reach, double slack,
                                 double *least)
{
    Found found = {reach, {0.0, 0.0, {0.0, 0.0, 0.0}}, -1};
    Probe probe = probe_of(segment);
    *least = reach;
    look_below(surfaces, segment, &probe, 0, reach, slack, &found, least);
    *least = smaller(*least, found.gap);
    return found;
}

/* By how much the gap of a segment may differ from that of another one: no more than the ends are apart; of what is no
   segment nothing is known. */
static inline double moved(const double *now, const double *before)
{
    double square[2];
    for (int end = 0; end < 2; end++) {
        double way[3];
        minus(now + 3 * end, before + 3 * end, way);
        square[end] = dot(way, way);
    }
    return isfinite(square[0] + square[1]) ? (1.0 + 1e-9) * sqrt(larger(square[0], square[1])) : INFINITY;
}

#endif
