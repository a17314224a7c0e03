/* Dual numbers: the value, with the bits of the plain code, and its derivative. A value
   decides all that is compared; of two that are equal, `min`, `max` and `fabs` give the
   derivative towards growing parameters. What does not depend has derivative 0, also
   where the slope is infinite. */

CC_INLINE CcReal dual(double v) { return (CcReal){v, 0.0}; }
CC_INLINE double dual_part(double by, double d) { return d == 0.0 ? 0.0 : by * d; }
CC_INLINE CcReal dual_slope(CcReal a) { return dual(a.d); }
CC_INLINE CcReal dual_with_slope(CcReal a, CcReal d) { return (CcReal){a.v, d.v}; }
CC_INLINE CcReal dual_neg(CcReal a) { return (CcReal){-a.v, -a.d}; }
CC_INLINE CcReal dual_add(CcReal a, CcReal b) { return (CcReal){a.v + b.v, a.d + b.d}; }
CC_INLINE CcReal dual_sub(CcReal a, CcReal b) { return (CcReal){a.v - b.v, a.d - b.d}; }

CC_INLINE CcReal dual_mul(CcReal a, CcReal b)
{
    return (CcReal){a.v * b.v, dual_part(b.v, a.d) + dual_part(a.v, b.d)};
}

CC_INLINE CcReal dual_div(CcReal a, CcReal b)
{
    const double q = a.v / b.v, change = a.d - dual_part(q, b.d);
    return (CcReal){q, change == 0.0 ? 0.0 : change / b.v};
}

CC_INLINE CcReal dual_min(CcReal a, CcReal b)
{
    const bool second = b.v < a.v || (b.v <= a.v && b.d < a.d);
    return (CcReal){min_real(a.v, b.v), second ? b.d : a.d};
}

CC_INLINE CcReal dual_max(CcReal a, CcReal b)
{
    const bool second = b.v > a.v || (b.v >= a.v && b.d > a.d);
    return (CcReal){max_real(a.v, b.v), second ? b.d : a.d};
}

CC_INLINE CcReal dual_fabs(CcReal a)
{
    const bool falls = a.v < 0.0 || (a.v <= 0.0 && a.d < 0.0);
    return (CcReal){fabs(a.v), falls ? -a.d : a.d};
}

CC_INLINE CcReal dual_pow(CcReal a, CcReal b)
{
    const double v = pow(a.v, b.v);
    const double base = a.d == 0.0 ? 0.0 : b.v * pow(a.v, b.v - 1.0) * a.d;
    return (CcReal){v, base + (b.d == 0.0 || v == 0.0 ? 0.0 : v * log(a.v) * b.d)};
}

/* A function of `x`, whose value is `y`, and its derivative. */
#define CC_CHAIN(name, slope)                                                 \
    CC_INLINE CcReal dual_##name(CcReal a)                                        \
    {                                                                         \
        const double x = a.v, y = name(x);                                    \
        (void)x;                                                              \
        return (CcReal){y, a.d == 0.0 ? 0.0 : (slope) * a.d};                   \
    }
CC_CHAIN(exp, y)
CC_CHAIN(expm1, y + 1.0)
CC_CHAIN(log, 1.0 / x)
CC_CHAIN(log1p, 1.0 / (1.0 + x))
CC_CHAIN(sqrt, 0.5 / y)
CC_CHAIN(sin, cos(x))
CC_CHAIN(cos, -sin(x))
CC_CHAIN(cc_sign, 0.0)
#undef CC_CHAIN

#define exp dual_exp
#define expm1 dual_expm1
#define log dual_log
#define log1p dual_log1p
#define sqrt dual_sqrt
#define sin dual_sin
#define cos dual_cos
#define pow dual_pow
#define fabs dual_fabs
#define cc_sign dual_cc_sign
#define min_real dual_min
#define max_real dual_max
#define cc_square(a) dual_mul(a, a)
#define floor_int(a) floor_int((a).v)
#define is_finite(a) is_finite((a).v)
#define is_nan(a) is_nan((a).v)
#define is_inf(a) is_inf((a).v)
