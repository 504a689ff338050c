/* What every C file of the package includes first: functions marked PUBLIC are called from Python with the address of
   one struct (native.py). hatch_build.py reads both from the source: fields are int64_t, double, float, int32_t, arrays
   of these, other such structs, or pointers, which without const are written to. */
#ifndef NATIVE_H
#define NATIVE_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

#define ALWAYS_INLINE inline __attribute__((always_inline))

/* A number as a whole one from low to high: what is none, or beyond, has no whole number that C could tell. */
static inline int64_t whole_within(double x, int64_t low, int64_t high)
{
    return x > (double)low ? x < (double)high ? (int64_t)x : high : low;
}

/* Machine code for wide vectors too, taken where the processor has them: for functions in which that halves the time. */
#if defined(WIDE) /* none, where the compiler checks what it compiles */
#elif defined(__x86_64__) && defined(__GLIBC__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

#endif
