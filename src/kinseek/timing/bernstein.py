"""Polynomials on an interval in Bernstein form: sums of coefficients times ``C(p, k) (1-s)^(p-k) s^k``, 0 <= s <= 1.

A polynomial stays between its smallest and its largest coefficient, and its first and last coefficient are its values at the
ends (*Farouki 2012*). The last axis of an array holds the coefficients, in order of k.
"""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def value(coefficients: Array, s: Array) -> Array:
    """Return polynomials, (..., p + 1), at s, (...): de Casteljau's algorithm."""
    while coefficients.shape[-1] > 1:
        coefficients = coefficients[..., :-1] + s[..., None] * np.diff(coefficients)
    return np.asarray(coefficients[..., 0])


def derivative(coefficients: Array) -> Array:
    """Return the derivatives with respect to s, (..., p), of polynomials, (..., p + 1)."""
    return np.asarray((coefficients.shape[-1] - 1) * np.diff(coefficients))


def product(a: Array, b: Array) -> Array:
    """Return products of polynomials, (..., p + 1) and (..., r + 1), of degree p + r."""
    p, r = a.shape[-1] - 1, b.shape[-1] - 1
    result = np.zeros((*np.broadcast_shapes(a.shape[:-1], b.shape[:-1]), p + r + 1))
    for i in range(p + 1):
        for j in range(r + 1):
            share = comb(p, i) * comb(r, j) / comb(p + r, i + j)
            result[..., i + j] += share * a[..., i] * b[..., j]
    return result


def subdivided(coefficients: Array, parts: int) -> Array:
    """Return polynomials, (m, ..., p + 1), on equal parts of the interval, (m parts, ..., p + 1), part by part."""
    ends = np.arange(parts + 1) / parts
    begin, width = ends[:-1].reshape(-1, *[1] * (coefficients.ndim - 2)), 1.0 / parts
    part = np.repeat(coefficients[:, None], parts, axis=1)
    # The blossom: coefficient k of a part is its value at p - k times the begin and k times the end.
    degree = coefficients.shape[-1] - 1
    rows = []
    for k in range(degree + 1):
        at = part
        for step in range(degree):
            s = begin + width if step < k else begin
            at = at[..., :-1] + s[..., None] * np.diff(at)
        rows.append(at[..., 0])
    return np.stack(rows, axis=-1).reshape(-1, *coefficients.shape[1:])
