/* The nearest of many triangles behind every pixel of a picture, row by row. */

#include "native.h"

#define LEAST_AREA 1e-6 /* twice the area of the smallest triangle that is drawn [pixel^2] */

typedef struct {
    int64_t count, rows, columns, glass; /* the last: whether what is glass is wanted, or what is solid */
    const double *corners;               /* (count, 3, 2): column and row [pixel] */
    const double *height, *light;        /* (count, 3): position towards the viewer [m], and brightness */
    const int32_t *owner;                /* (count): number of the face or link */
    const uint8_t *kinds;                /* (owners): 0 solid, 1 glass in front of the cut, 2 glass */
    const float *cut, *floor;            /* (rows, columns) [m]; nothing below the floor is seen */
    const double *opacity;               /* (count): logarithm of the share of light that passes */
    float *depth, *brightness;           /* (rows, columns) of the nearest */
    int32_t *nearest;                    /* (rows, columns): its owner */
    double *passed;                      /* (rows, columns): sum of the logarithms */
    int64_t *fragments;                  /* (owners): number of pixels, hidden ones too */
} Raster;

/* A quantity that is linear in the picture. */
typedef struct {
    double start, across, up;
} Plane;

static Plane plane_of(const double *corners, const double *values, double area)
{
    double ux = corners[2] - corners[0], uy = corners[3] - corners[1];
    double vx = corners[4] - corners[0], vy = corners[5] - corners[1];
    double one = (values[1] - values[0]) / area, other = (values[2] - values[0]) / area;
    Plane plane = {0.0, one * vy - other * uy, other * ux - one * vx};
    plane.start = values[0] - plane.across * (corners[0] - 0.5) - plane.up * (corners[1] - 0.5);
    return plane;
}

/* First pixel whose centre lies at a coordinate or beyond. */
static int64_t pixel_from(double x, int64_t most) { return whole_within(ceil(x - 0.5), 0, most); }

/* Pixels of a row whose centres lie in the triangle: between the sides that cross the height of the centres. */
static void within_row(const double *corners, double y, double *begin, double *end)
{
    *begin = INFINITY;
    *end = -INFINITY;
    for (int k = 0; k < 3; k++) {
        const double *low = corners + 2 * k, *high = corners + 2 * ((k + 1) % 3);
        if (low[1] > high[1]) { /* two triangles have the same numbers for their common side */
            const double *swapped = low;
            low = high;
            high = swapped;
        }
        if ((low[1] <= y) == (high[1] <= y)) continue;
        double x = low[0] + (y - low[1]) / (high[1] - low[1]) * (high[0] - low[0]);
        *begin = fmin(*begin, x);
        *end = fmax(*end, x);
    }
}

static void fill_row(const Raster *q, int64_t triangle, int64_t row, int64_t left, int64_t right, const Plane *height,
                     const Plane *light)
{
    int32_t owner = q->owner[triangle];
    int kind = q->kinds[owner];
    double depth_here = height->start + height->up * (double)row, light_here = light->start + light->up * (double)row;
    for (int64_t column = left; column < right; column++) {
        int64_t pixel = row * q->columns + column;
        float depth = (float)(depth_here + height->across * (double)column);
        int glass = kind == 2 || (kind == 1 && depth > q->cut[pixel]);
        if (glass != (int)q->glass || !(depth > q->floor[pixel])) continue;
        q->fragments[owner]++;
        q->passed[pixel] += q->opacity[triangle];
        if (!(depth > q->depth[pixel])) continue;
        q->depth[pixel] = depth;
        q->brightness[pixel] = (float)(light_here + light->across * (double)column);
        q->nearest[pixel] = owner;
    }
}

PUBLIC void rasterise(Raster *q)
{
    for (int64_t t = 0; t < q->count; t++) {
        const double *c = q->corners + 6 * t;
        double area = (c[2] - c[0]) * (c[5] - c[1]) - (c[3] - c[1]) * (c[4] - c[0]), begin, end;
        if (!(fabs(area) > LEAST_AREA && area - area == 0.0)) continue;
        int64_t first = pixel_from(fmin(fmin(c[1], c[3]), c[5]), q->rows);
        int64_t last = pixel_from(fmax(fmax(c[1], c[3]), c[5]), q->rows);
        if (first >= last) continue;
        Plane height = plane_of(c, q->height + 3 * t, area), light = plane_of(c, q->light + 3 * t, area);
        for (int64_t row = first; row < last; row++) {
            within_row(c, (double)row + 0.5, &begin, &end);
            fill_row(q, t, row, pixel_from(begin, q->columns), pixel_from(end, q->columns), &height, &light);
        }
    }
}
