/* A hierarchy of boxes (box_tree.py), and the walk to the items whose boxes meet a given one. */

#ifndef BOX_TREE_H
#define BOX_TREE_H

#include "native.h"

#define DEEPEST 64 /* levels of a tree: more than any number of items needs */

typedef struct {
    int64_t levels;
    const int64_t *items;   /* (n,) */
    const double *boxes;    /* (nodes, 4) */
    const int64_t *offsets; /* (levels + 1,) */
} Tree;

typedef struct {
    const Tree *tree;
    const double *box; /* x low, y low, x high, y high */
    int64_t node[2 * DEEPEST], level[2 * DEEPEST];
    int top;
} Walk;

static inline void begin_walk(Walk *walk, const Tree *tree, const double *box)
{
    walk->tree = tree;
    walk->box = box;
    walk->node[0] = 0;
    walk->level[0] = 0;
    walk->top = tree->levels > 0;
}

/* The next item whose box meets that of the walk, or -1; a box that is not a number meets all. */
static inline int64_t next_item(Walk *walk)
{
    const Tree *tree = walk->tree;
    const double *wanted = walk->box;
    while (walk->top) {
        walk->top--;
        int64_t n = walk->node[walk->top], l = walk->level[walk->top];
        const double *box = tree->boxes + 4 * (tree->offsets[l] + n);
        if (box[0] > wanted[2] || box[1] > wanted[3] || box[2] < wanted[0] || box[3] < wanted[1]) continue;
        if (l == tree->levels - 1) return tree->items[n];
        for (int64_t child = 2 * n + 1; child >= 2 * n; child--)
            if (child < tree->offsets[l + 2] - tree->offsets[l + 1]) {
                walk->node[walk->top] = child;
                walk->level[walk->top++] = l + 1;
            }
    }
    return -1;
}

#endif
