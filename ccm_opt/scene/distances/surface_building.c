/* Building the hierarchy of boxes: every box is cut in two where the surface of the halves, weighed with what is in
   them, is least among some cuts across its longest side (I. Wald, On fast construction of SAH-based bounding volume
   hierarchies, 2007). */

#include "native.h"
#include "surface_nodes.h"

#define CUTS 16
#define DEEP 60 /* levels after which boxes are cut into halves of equal number */
#define MOST_IN_SLICE 4096 /* triangles: more are hardly ever flat */
#define SHORTENED (1.0 - 1e-6)

typedef struct {
    float low[3], high[3]; /* of the triangles with their rounding */
    int32_t number;        /* of the given triangle */
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

typedef struct {
    double low[3], high[3], rounding, edge, area[3]; /* the last is twice the sum of the areas as vectors */
    int64_t count;                                   /* of triangles */
} Box;

static const Box NOTHING = {{HUGE_VAL, HUGE_VAL, HUGE_VAL}, {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}, 0.0, 0.0, {0.0, 0.0, 0.0}, 0};

static const Bin EMPTY = {{HUGE_VALF, HUGE_VALF, HUGE_VALF}, {-HUGE_VALF, -HUGE_VALF, -HUGE_VALF}, 0};

static inline float centre(const Item *item, int axis) { return 0.5F * item->low[axis] + 0.5F * item->high[axis]; }

static inline float smaller_float(float a, float b) { return a < b ? a : b; }
static inline float larger_float(float a, float b) { return a > b ? a : b; }

static inline void enclose(Bin *bin, const float *low, const float *high, int64_t count)
{
    for (int d = 0; d < 3; d++) {
        bin->low[d] = smaller_float(low[d], bin->low[d]);
        bin->high[d] = larger_float(high[d], bin->high[d]);
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

static inline int bin_of(const Item *item, int axis, float low, float scale)
{
    float place = (centre(item, axis) - low) * scale;
    return place < (float)CUTS ? (place > 0.0F ? (int)place : 0) : CUTS - 1;
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
        enclose(bins + bin_of(items + k, axis, low[axis], scale), items[k].low, items[k].high, 1);
    int cut = best_cut(bins);

    /* Every item changes places, so that nothing hangs on which half it belongs to before that is known. */
    int64_t first = 0;
    for (int64_t k = 0; k < count; k++) {
        Item item = items[k];
        int64_t below = bin_of(&item, axis, low[axis], scale) <= cut;
        items[k] = items[first];
        items[first] = item;
        first += below;
    }
    return first == 0 || first == count ? count / 2 : first;
}

/* Areas count without their sides: which side of a triangle is outside is not known. */
static void add_area(double *sum, const double *area)
{
    double sign = dot(sum, area) < 0.0 ? -1.0 : 1.0;
    for (int d = 0; d < 3; d++) sum[d] += sign * area[d];
}

/* Put a triangle into its place with the longest edge first. */
static void place(Building *b, int64_t number, int64_t at)
{
    const double *given = b->given + 9 * number;
    double square[3];
    for (int k = 0; k < 3; k++) {
        double edge[3];
        minus(given + 3 * ((k + 1) % 3), given + 3 * k, edge);
        square[k] = dot(edge, edge);
    }
    /* Which it is cannot be foreseen, so that nothing branches on it. */
    int from = square[1] > square[0];
    from = square[2] > larger(square[0], square[1]) ? 2 : from;
    double *corners = b->corners + 9 * at;
    const double *first = given + 3 * from, *second = given + 3 * (from == 2 ? 0 : from + 1);
    const double *third = given + 3 * (from == 0 ? 2 : from - 1);
    for (int d = 0; d < 3; d++) {
        corners[d] = first[d];
        corners[3 + d] = second[d];
        corners[6 + d] = third[d];
    }
    b->rounding[at] = b->given_rounding[number];
    b->order[at] = number;
}

/* Enclose a triangle that is in its place. */
static void enclose_placed(const Building *b, Box *box, int64_t at)
{
    const double *corners = b->corners + 9 * at;
    double one[3], other[3], area[3];
    minus(corners + 3, corners, one);
    minus(corners + 6, corners, other);
    cross(one, other, area);
    add_area(box->area, area);
    box->rounding = larger(box->rounding, b->rounding[at]);
    box->edge = larger(box->edge, sqrt(dot(one, one)));
    for (int k = 0; k < 9; k++) {
        box->low[k % 3] = smaller(box->low[k % 3], corners[k]);
        box->high[k % 3] = larger(box->high[k % 3], corners[k]);
    }
    box->count++;
}

static float rounded_down(double number)
{
    float near = (float)number;
    return near > number ? nextafterf(near, -HUGE_VALF) : near;
}

static float rounded_up(double number) { return -rounded_down(-number); }

/* The two planes across the mean normal between which the triangles of some items lie. */
static void slice(const Building *b, Node *node, const Box *box, int64_t begin, int64_t end)
{
    const double *area = box->area;
    double length = sqrt(dot(area, area)), normal[3], beneath = HUGE_VAL, above = -HUGE_VAL;
    int known = box->count <= MOST_IN_SLICE && length > 0.0 && length < HUGE_VAL;
    for (int d = 0; d < 3; d++) {
        /* Shorter than a unit vector by more than single precision rounds, so that heights are not above distances.
           Volatile, since GCC 12 takes the number before it was rounded where it makes one vector of the three. */
        volatile float rounded = known ? (float)(SHORTENED * area[d] / length) : 0.0F;
        node->normal[d] = rounded;
        normal[d] = rounded;
    }
    for (int64_t corner = 3 * begin; known && corner < 3 * end; corner++) {
        double height = dot(normal, b->corners + 3 * corner);
        beneath = smaller(beneath, height);
        above = larger(above, height);
    }
    node->beneath = known ? rounded_down(beneath) : 0.0F;
    node->above = known ? rounded_up(above) : 0.0F;
}

/* A leaf, and the place of its triangles. */
static Box fill_leaf(Building *b, Node *node, int64_t begin, int64_t end)
{
    Box box = NOTHING;
    node->first = (int32_t)begin;
    node->count = (int32_t)(end - begin);
    for (int64_t at = begin; at < end; at++) {
        place(b, b->items[at].number, at);
        enclose_placed(b, &box, at);
    }
    return box;
}

/* The node about some items. */
static Box build_node(Building *b, int64_t number, int64_t begin, int64_t end, int level)
{
    Box box = NOTHING;
    Node *node = b->nodes + number;
    if (end - begin <= b->leaf) {
        box = fill_leaf(b, node, begin, end);
    } else {
        int64_t half = level < DEEP ? parted(b->items + begin, end - begin) : (end - begin) / 2;
        node->first = (int32_t)b->count;
        node->count = 0;
        b->count += 2;
        for (int child = 0; child < 2; child++) {
            int64_t from = child ? begin + half : begin, to = child ? end : begin + half;
            Box below = build_node(b, node->first + child, from, to, level + 1);
            box.rounding = larger(box.rounding, below.rounding);
            box.edge = larger(box.edge, below.edge);
            for (int d = 0; d < 3; d++) {
                box.low[d] = smaller(box.low[d], below.low[d]);
                box.high[d] = larger(box.high[d], below.high[d]);
            }
            add_area(box.area, below.area);
            box.count += below.count;
        }
    }
    for (int d = 0; d < 3; d++) {
        node->low[d] = rounded_down(box.low[d]);
        node->high[d] = rounded_up(box.high[d]);
    }
    node->rounding = rounded_up(box.rounding);
    node->edge = rounded_up(box.edge);
    slice(b, node, &box, begin, end);
    return box;
}

static void take(Building *b, int64_t number)
{
    const double *corners = b->given + 9 * number;
    double rounding = b->given_rounding[number];
    Item *item = b->items + number;
    item->number = (int32_t)number;
    for (int d = 0; d < 3; d++) {
        item->low[d] = (float)(smaller(smaller(corners[d], corners[3 + d]), corners[6 + d]) - rounding);
        item->high[d] = (float)(larger(larger(corners[d], corners[3 + d]), corners[6 + d]) + rounding);
    }
}

PUBLIC void build_surfaces(Building *b)
{
    b->items = malloc((size_t)b->triangles * sizeof(Item));
    b->count = b->items != NULL;
    if (!b->items) return;
    for (int64_t k = 0; k < b->triangles; k++) take(b, k);
    build_node(b, 0, 0, b->triangles, 0);
    free(b->items);
}
