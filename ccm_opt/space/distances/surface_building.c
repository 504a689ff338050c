/* Building the hierarchy of boxes: every box is cut in two where the surface of the halves, weighed with what is in
   them, is least among some cuts across its longest side (I. Wald, On fast construction of SAH-based bounding volume
   hierarchies, 2007). */

#include <stdlib.h>
#include <string.h>

#include "surface_nodes.h"

#define CUTS 16
#define DEEP 60 /* levels after which boxes are cut into halves of equal number */

typedef struct {
    float low[3], high[3]; /* of the triangle with its rounding */
    int64_t number;
} Item;

typedef struct {
    int64_t triangles, leaf;
    const double *given, *given_rounding; /* (m, 3, 3), (m,) */
    Node *nodes;                          /* room for 2 m */
    double *corners, *rounding;           /* in the order of the leaves */
    int64_t *order;                       /* number of the given triangle, likewise */
    int64_t count;                        /* of nodes; none where there is too little memory */
    Item *items;
} Building;

typedef struct {
    float low[3], high[3];
    int64_t count;
} Bin;

static const Bin EMPTY = {{HUGE_VALF, HUGE_VALF, HUGE_VALF}, {-HUGE_VALF, -HUGE_VALF, -HUGE_VALF}, 0};

static inline float centre(const Item *item, int axis) { return 0.5F * item->low[axis] + 0.5F * item->high[axis]; }

static inline void enclose(Bin *bin, const float *low, const float *high, int64_t count)
{
    for (int d = 0; d < 3; d++) {
        bin->low[d] = low[d] < bin->low[d] ? low[d] : bin->low[d];
        bin->high[d] = high[d] > bin->high[d] ? high[d] : bin->high[d];
    }
    bin->count += count;
}

static float surface(const Bin *bin)
{
    if (bin->count == 0) return 0.0F;
    float x = bin->high[0] - bin->low[0], y = bin->high[1] - bin->low[1], z = bin->high[2] - bin->low[2];
    return x * y + y * z + z * x;
}

/* The bin after which a cut costs least; the last where no cut parts anything. */
static int best_cut(const Bin *bins)
{
    float above[CUTS], least = HUGE_VALF;
    Bin sum = EMPTY;
    int best = CUTS - 1;
    for (int k = CUTS - 1; k > 0; k--) {
        enclose(&sum, bins[k].low, bins[k].high, bins[k].count);
        above[k] = sum.count ? surface(&sum) * (float)sum.count : HUGE_VALF;
    }
    sum = EMPTY;
    for (int k = 0; k < CUTS - 1; k++) {
        enclose(&sum, bins[k].low, bins[k].high, bins[k].count);
        float cost = sum.count ? surface(&sum) * (float)sum.count + above[k + 1] : HUGE_VALF;
        if (cost < least) {
            least = cost;
            best = k;
        }
    }
    return best;
}

/* How many of some items belong into the first half; they are moved to the front. */
static int64_t parted(Item *items, int64_t count)
{
    float low[3] = {HUGE_VALF, HUGE_VALF, HUGE_VALF}, high[3] = {-HUGE_VALF, -HUGE_VALF, -HUGE_VALF};
    for (int64_t k = 0; k < count; k++)
        for (int d = 0; d < 3; d++) {
            float at = centre(items + k, d);
            low[d] = at < low[d] ? at : low[d];
            high[d] = at > high[d] ? at : high[d];
        }
    int axis = 0;
    for (int d = 1; d < 3; d++)
        if (high[d] - low[d] > high[axis] - low[axis]) axis = d;
    float scale = (float)CUTS * 0.9999F / (high[axis] - low[axis]);
    if (!(scale < HUGE_VALF)) return count / 2; /* all in one place */

    Bin bins[CUTS];
    for (int k = 0; k < CUTS; k++) bins[k] = EMPTY;
    for (int64_t k = 0; k < count; k++)
        enclose(bins + (int)((centre(items + k, axis) - low[axis]) * scale), items[k].low, items[k].high, 1);
    int cut = best_cut(bins);

    int64_t first = 0, last = count;
    while (first < last) {
        if ((int)((centre(items + first, axis) - low[axis]) * scale) <= cut) {
            first++;
        } else {
            Item other = items[--last];
            items[last] = items[first];
            items[first] = other;
        }
    }
    return first == 0 || first == count ? count / 2 : first;
}

/* Put a triangle into its place with the longest edge first, and enclose it. */
static void place(Building *b, Node *node, int64_t at)
{
    int64_t number = b->items[at].number;
    const double *given = b->given + 9 * number;
    double longest = -1.0;
    int from = 0;
    for (int k = 0; k < 3; k++) {
        double edge[3];
        minus(given + 3 * ((k + 1) % 3), given + 3 * k, edge);
        double square = dot(edge, edge);
        if (square > longest) {
            longest = square;
            from = k;
        }
    }
    for (int k = 0; k < 3; k++) memcpy(b->corners + 9 * at + 3 * k, given + 3 * ((from + k) % 3), 3 * sizeof(double));
    b->rounding[at] = b->given_rounding[number];
    b->order[at] = number;
    node->rounding = fmax(node->rounding, b->rounding[at]);
    for (int k = 0; k < 9; k++) {
        node->low[k % 3] = fmin(node->low[k % 3], given[k]);
        node->high[k % 3] = fmax(node->high[k % 3], given[k]);
    }
}

static void build_node(Building *b, Node *node, int64_t begin, int64_t end, int level)
{
    for (int d = 0; d < 3; d++) {
        node->low[d] = HUGE_VAL;
        node->high[d] = -HUGE_VAL;
    }
    node->rounding = 0.0;
    if (end - begin <= b->leaf) {
        node->first = (int32_t)begin;
        node->count = (int32_t)(end - begin);
        for (int64_t at = begin; at < end; at++) place(b, node, at);
        return;
    }
    int64_t half = level < DEEP ? parted(b->items + begin, end - begin) : (end - begin) / 2;
    node->first = (int32_t)b->count;
    node->count = 0;
    b->count += 2;
    for (int child = 0; child < 2; child++) {
        Node *below = b->nodes + node->first + child;
        build_node(b, below, child ? begin + half : begin, child ? end : begin + half, level + 1);
        node->rounding = fmax(node->rounding, below->rounding);
        for (int d = 0; d < 3; d++) {
            node->low[d] = fmin(node->low[d], below->low[d]);
            node->high[d] = fmax(node->high[d], below->high[d]);
        }
    }
}

PUBLIC void build_surfaces(Building *b)
{
    b->count = 0;
    b->items = malloc((size_t)b->triangles * sizeof(Item));
    if (b->items == NULL) return;
    for (int64_t k = 0; k < b->triangles; k++) {
        const double *corners = b->given + 9 * k;
        for (int d = 0; d < 3; d++) {
            double low = fmin(fmin(corners[d], corners[3 + d]), corners[6 + d]);
            double high = fmax(fmax(corners[d], corners[3 + d]), corners[6 + d]);
            b->items[k].low[d] = (float)(low - b->given_rounding[k]);
            b->items[k].high[d] = (float)(high + b->given_rounding[k]);
        }
        b->items[k].number = k;
    }
    b->count = 1;
    build_node(b, b->nodes, 0, b->triangles, 0);
    free(b->items);
}
