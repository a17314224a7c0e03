/* What functions translated from Python use. Arrays are views: their memory belongs to
   the caller. */
#ifndef CC_MUJOCO_NATIVE_H
#define CC_MUJOCO_NATIVE_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define CC_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define CC_EXPORT __attribute__((visibility("default")))
#else
#define CC_EXPORT
#endif
#if defined(__GNUC__)
#define CC_INLINE __attribute__((unused)) static inline
#define CC_ALWAYS_INLINE __attribute__((always_inline)) static inline
#else
#define CC_INLINE static inline
#define CC_ALWAYS_INLINE static inline
#endif

#if defined(CC_DUAL) /* a number and its derivative, see `dual.h` */
typedef struct { double v; double d; } CcReal;
#else
typedef double CcReal;
#endif
typedef struct { CcReal *p; int64_t n; } Reals;
typedef struct { CcReal *p; int64_t n; int64_t columns; } RealMatrix;
typedef struct { CcReal *p; int64_t n; int64_t columns; int64_t layers; } RealCube;
typedef struct { int64_t *p; int64_t n; } Ints;
typedef struct { int64_t *p; int64_t n; int64_t columns; } IntMatrix;
typedef struct { uint8_t *p; int64_t n; } Bytes;
typedef struct { uint64_t *p; int64_t n; } Words;
typedef struct { int8_t *p; int64_t n; } Int8s;
typedef struct { int8_t *p; int64_t n; int64_t columns; } Int8Matrix;
typedef struct { bool *p; int64_t n; } Bools;

CC_INLINE double min_real(double a, double b) { return b < a ? b : a; }
CC_INLINE double max_real(double a, double b) { return b > a ? b : a; }
CC_INLINE int64_t min_int(int64_t a, int64_t b) { return b < a ? b : a; }
CC_INLINE int64_t max_int(int64_t a, int64_t b) { return b > a ? b : a; }
CC_INLINE int64_t abs_int(int64_t a) { return a < 0 ? -a : a; }
CC_INLINE double cc_sign(double x) { return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x; }
CC_INLINE double cc_square(double x) { return x * x; }
CC_INLINE int64_t cc_square_int(int64_t x) { return x * x; }
CC_INLINE double cc_single(double x) { return (double)(float)x; }
CC_INLINE double cc_ldexp(double x, int64_t n) { return ldexp(x, (int)n); }
CC_INLINE int64_t floor_int(double x) { return (int64_t)floor(x); }
CC_INLINE int64_t ceil_int(double x) { return (int64_t)ceil(x); }
CC_INLINE int64_t round_int(double x) { return (int64_t)rint(x); }
CC_INLINE bool is_finite(double x) { return isfinite(x) != 0; }
CC_INLINE bool is_nan(double x) { return isnan(x) != 0; }
CC_INLINE bool is_inf(double x) { return isinf(x) != 0; }

/* Quotient rounded down and remainder of the divisor's sign, as in Python. */
CC_INLINE int64_t floor_div(int64_t a, int64_t b)
{
    const int64_t q = a / b;
    return q - ((a % b != 0 && (a < 0) != (b < 0)) ? 1 : 0);
}

CC_INLINE int64_t floor_mod(int64_t a, int64_t b)
{
    const int64_t r = a % b;
    return r + ((r != 0 && (r < 0) != (b < 0)) ? b : 0);
}

CC_INLINE double floor_mod_real(double a, double b)
{
    const double r = fmod(a, b);
    return (r < 0.0) != (b < 0.0) && (r < 0.0 || r > 0.0) ? r + b : r;
}

#define CC_FILL(Name, Element, size)                                      \
    CC_INLINE void fill_##Name(Name a, Element value)                     \
    {                                                                     \
        for (int64_t i = 0; i < size; i++) {                              \
            a.p[i] = value;                                               \
        }                                                                 \
    }                                                                     \
    CC_INLINE void copy_##Name(Name a, Name source)                       \
    {                                                                     \
        memmove(a.p, source.p, (size_t)(size) * sizeof(Element));         \
    }
CC_FILL(Reals, CcReal, a.n)
CC_FILL(RealMatrix, CcReal, a.n * a.columns)
CC_FILL(Ints, int64_t, a.n)
CC_FILL(Bytes, uint8_t, a.n)
CC_FILL(Words, uint64_t, a.n)
#undef CC_FILL

#if !defined(CC_DUAL)
CC_INLINE int64_t cc_argmin(Reals a)
{
    int64_t best = 0;
    for (int64_t i = 1; i < a.n; i++) {
        best = a.p[i] < a.p[best] ? i : best;
    }
    return best;
}
#endif

CC_INLINE void copy_bytes(int64_t source, int64_t target, int64_t size)
{
    memmove((void *)(intptr_t)target, (const void *)(intptr_t)source, (size_t)size);
}

CC_INLINE void clear_bytes(int64_t address, int64_t size)
{
    memset((void *)(intptr_t)address, 0, (size_t)size);
}

CC_INLINE bool same_bytes(int64_t a, int64_t b, int64_t size)
{
    return memcmp((void *)(intptr_t)a, (void *)(intptr_t)b, (size_t)size) == 0;
}

#endif
