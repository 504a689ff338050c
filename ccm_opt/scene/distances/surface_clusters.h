/* Triangles in the order of a Morton curve, and clusters of few that are neighbours on it (J. Pantaleoni and D. Luebke,
   HLBVH: hierarchical LBVH construction for real-time ray tracing of dynamic geometry, 2010): of a million triangles it
   takes a fraction of the time to sort such clusters into boxes. */

#ifndef SURFACE_CLUSTERS_H
#define SURFACE_CLUSTERS_H

#include "native.h"
#include "vectors.h"

#define CODE_BITS 30
#define DIGIT_BITS 10
#define DIGITS (1 << DIGIT_BITS)
#define WHOLE 4       /* clusters' worth of triangles in one cell that are not worth a finer curve */
#define MOST_CURVES 6 /* within each other: each has cells a billionth of the one before */

typedef struct {
    uint32_t code, number; /* of the cell, and of the given triangle */
} Coded;

typedef struct {
    double low[3], scale[3];     /* cells along an axis */
    uint32_t most[3];            /* the last of them */
    uint32_t spread[3][4][256];  /* what the bytes of a cell's number along an axis are in its code */
} Curve;

typedef struct {
    const double *given; /* (m, 3, 3) */
    int64_t leaf;
    Coded *coded, *spare;
    int32_t *begins; /* of the clusters in the order, (m,) */
    int64_t count;
} Clusters;

static inline double middle_of(const double *corners, int axis)
{
    return (corners[axis] + corners[3 + axis] + corners[6 + axis]) * (1.0 / 3.0);
}

/* The curve through the box of the middles of some triangles, whose longest side every further bit halves; returns
   whether it parts anything. */
static int curve_of(const Clusters *c, int64_t begin, int64_t end, Curve *curve)
{
    double high[3], side[3];
    int bits[3] = {0, 0, 0};
    for (int d = 0; d < 3; d++) {
        curve->low[d] = HUGE_VAL;
        high[d] = -HUGE_VAL;
    }
    for (int64_t k = begin; k < end; k++)
        for (int d = 0; d < 3; d++) {
            double at = middle_of(c->given + 9 * (int64_t)c->coded[k].number, d);
            curve->low[d] = smaller(curve->low[d], at);
            high[d] = larger(high[d], at);
        }
    for (int d = 0; d < 3; d++) {
        side[d] = high[d] - curve->low[d];
        for (int byte = 0; byte < 4; byte++)
            for (int value = 0; value < 256; value++) curve->spread[d][byte][value] = 0;
    }
    double left[3] = {side[0], side[1], side[2]};
    int axes[CODE_BITS];
    for (int k = 0; k < CODE_BITS; k++) {
        int longest = left[1] > left[0];
        if (left[2] > left[longest]) longest = 2;
        left[longest] *= 0.5;
        axes[k] = longest;
        bits[longest]++;
    }
    int place[3] = {bits[0], bits[1], bits[2]};
    for (int k = 0; k < CODE_BITS; k++) {
        int d = axes[k], bit = --place[d];
        for (int value = 0; value < 256; value++)
            if (value >> (bit % 8) & 1) curve->spread[d][bit / 8][value] |= UINT32_C(1) << (CODE_BITS - 1 - k);
    }
    int parts = 0;
    for (int d = 0; d < 3; d++) {
        curve->most[d] = (UINT32_C(1) << bits[d]) - 1;
        curve->scale[d] = (double)(UINT32_C(1) << bits[d]) / side[d];
        if (side[d] > 0.0 && curve->scale[d] < HUGE_VAL)
            parts |= bits[d] > 0;
        else
            curve->scale[d] = 0.0;
    }
    return parts;
}

static uint32_t code_of(const Curve *curve, const double *corners)
{
    uint32_t code = 0;
    for (int d = 0; d < 3; d++) {
        double at = (middle_of(corners, d) - curve->low[d]) * curve->scale[d];
        uint32_t cell = at > 0.0 ? at < (double)curve->most[d] ? (uint32_t)at : curve->most[d] : 0;
        code |= curve->spread[d][0][cell & 255] | curve->spread[d][1][cell >> 8 & 255];
        code |= curve->spread[d][2][cell >> 16 & 255] | curve->spread[d][3][cell >> 24];
    }
    return code;
}

/* Sort by the codes, digit by digit from the last. */
static void sort_codes(Coded *coded, Coded *spare, int64_t count)
{
    int64_t places[CODE_BITS / DIGIT_BITS][DIGITS] = {{0}};
    for (int64_t k = 0; k < count; k++)
        for (int digit = 0; digit < CODE_BITS / DIGIT_BITS; digit++)
            places[digit][coded[k].code >> (DIGIT_BITS * digit) & (DIGITS - 1)]++;
    Coded *from = coded, *to = spare;
    for (int digit = 0; digit < CODE_BITS / DIGIT_BITS; digit++) {
        int64_t sum = 0;
        for (int value = 0; value < DIGITS; value++) {
            int64_t here = places[digit][value];
            places[digit][value] = sum;
            sum += here;
        }
        for (int64_t k = 0; k < count; k++)
            to[places[digit][from[k].code >> (DIGIT_BITS * digit) & (DIGITS - 1)]++] = from[k];
        Coded *swapped = from;
        from = to;
        to = swapped;
    }
    if (from != coded)
        for (int64_t k = 0; k < count; k++) coded[k] = from[k];
}

static void order_along_curve(Clusters *c, int64_t begin, int64_t end, int level);

/* Clusters of the triangles whose codes are alike down to a bit. */
static void cluster_cell(Clusters *c, int64_t begin, int64_t end, int bit, int level)
{
    while (end - begin > c->leaf && bit >= 0) {
        uint32_t mask = UINT32_C(1) << bit--;
        int64_t from = begin, to = end; /* where the first with the bit is */
        while (from < to) {
            int64_t half = (from + to) / 2;
            if (c->coded[half].code & mask)
                to = half;
            else
                from = half + 1;
        }
        if (from > begin && from < end) {
            cluster_cell(c, begin, from, bit, level);
            begin = from;
        }
    }
    if (end - begin > WHOLE * c->leaf && level < MOST_CURVES) {
        order_along_curve(c, begin, end, level + 1);
        return;
    }
    for (int64_t at = begin; at < end; at += c->leaf) c->begins[c->count++] = (int32_t)at;
}

/* Order some triangles, and put them into clusters. */
static void order_along_curve(Clusters *c, int64_t begin, int64_t end, int level)
{
    Curve curve;
    int parts = curve_of(c, begin, end, &curve);
    for (int64_t k = begin; parts && k < end; k++)
        c->coded[k].code = code_of(&curve, c->given + 9 * (int64_t)c->coded[k].number);
    if (parts) sort_codes(c->coded + begin, c->spare + begin, end - begin);
    cluster_cell(c, begin, end, parts ? CODE_BITS - 1 : -1, parts ? level : MOST_CURVES);
}

#endif
