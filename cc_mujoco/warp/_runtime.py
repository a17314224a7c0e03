"""Warp functions for what Python has and Warp has not."""

from __future__ import annotations

PRELUDE = '''
@wp.func_native("""
wp::array_t<ELEMENT> part = whole;
part.data = (ELEMENT*)((char*)whole.data + wp::int64(start) * whole.strides[0]);
part.shape[0] = stop - start;
return part;
""")
def cut(
    whole: wp.array(dtype=Real), start: wp.int32, stop: wp.int32
) -> wp.array(dtype=Real):
    ...


@wp.func
def variable(x: Real):
    return x


@wp.func
def fill(row: wp.array(dtype=Real), value: Real):
    for i in range(row.shape[0]):
        row[i] = value


@wp.func
def fill(row: wp.array(dtype=Real), source: wp.array(dtype=Real)):
    for i in range(row.shape[0]):
        row[i] = source[i]


@wp.func
def square(x: Real):
    return x * x


@wp.func
def sign_of(x: Real):
    if x > Real(0.0):
        return Real(1.0)
    if x < Real(0.0):
        return Real(-1.0)
    return x


@wp.func
def expm1(x: Real):
    grown = wp.exp(x)
    if grown == Real(1.0):
        return x
    if grown - Real(1.0) == Real(-1.0):
        return Real(-1.0)
    return (grown - Real(1.0)) * (x / wp.log(grown))


@wp.func
def log1p(x: Real):
    grown = Real(1.0) + x
    if grown == Real(1.0):
        return x
    return wp.log(grown) * (x / (grown - Real(1.0)))
'''
"""Source of these functions for an element type `Real`.

`variable` makes a variable of a constant: Warp 1.19 gives both one place in memory,
and what changes the variable would change the constant. `cut` returns a view of part
of an array whose elements may lie apart. Warp's library for processors lacks `expm1`
and `log1p`; these are Kahan's forms.
"""
