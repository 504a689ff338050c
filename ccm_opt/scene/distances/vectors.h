/* Vectors of space. */

#ifndef VECTORS_H
#define VECTORS_H

#include "native.h"

/* Not fmax and fmin, which compilers leave to the library because of what is not a number. */
static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

static inline double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void minus(const double *a, const double *b, double *difference)
{
    for (int d = 0; d < 3; d++) difference[d] = a[d] - b[d];
}

/* a + share b. */
static inline void along(const double *a, double share, const double *b, double *point)
{
    for (int d = 0; d < 3; d++) point[d] = a[d] + share * b[d];
}

static inline void cross(const double *a, const double *b, double *product)
{
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

static inline double clamped(double share) { return share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share; }

#endif
