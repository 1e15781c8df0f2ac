"""Functions on SIMD vectors that Taichi 1.7 lacks: absolute value, exponential decay and index bounds.

Taichi also lacks the unary minus of these vectors: write `0.0 - a`.
"""

# No `from __future__ import annotations` here: Taichi reads the annotations of functions.

import taichi as ti


@ti.func
def within(index):
    """Return a nonnegative array index, marked as such for the compiler.

    The mask tells the compiler that index + 1 does not overflow, so that the sum becomes part of an address.
    """
    return index & 0x0FFFFFFF


@ti.func
def magnitude(a):
    """Return the absolute value."""
    return ti.max(a, 0.0 - a)


@ti.func
def decay(a):
    """Return exp(-a) for a >= 0, as the fourth power of exp(-a/4) = (12 - 6z + z^2) / (12 + 6z + z^2), z = a/4.

    The error is below 3e-6 up to a = 1 and below 2e-4 anywhere: the second diagonal Pade approximant.
    Source: G. A. Baker, P. Graves-Morris, "Pade Approximants" (1996), section 1.2.
    """
    z = 0.25 * ti.min(a, 12.0)
    quarter = (12.0 - 6.0 * z + z * z) / (12.0 + 6.0 * z + z * z)
    square = quarter * quarter
    return square * square
