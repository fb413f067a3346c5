r"""Tables of the Radau IIA collocation method on [0, 1].

A polynomial through the values at the nodes :math:`c_i` stands for the rate of each state; its integral,

.. math:: A_{ij} = \int_0^{c_i} \ell_j,

gives the state: velocity from acceleration, and displacement from velocity by the same rule, hence :math:`A^2`.
(Integrating the acceleration's polynomial twice exactly would lose the stability.) The method is of order 2 s - 1,
stable for all decaying modes, and damps the fastest at once (Hairer and Wanner, Solving Ordinary Differential
Equations II, 1996, Section IV.5). Polynomials in Bernstein's form lie between their smallest and largest coefficient,
which is how a step is searched for events without stepping over one.

Values at the nodes fill one register (`compiled`), so matrices that multiply them are kept by columns.
"""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.polynomial import Legendre, Polynomial

from psafit.arrays import FloatArray
from psafit.simulate.compiled import WIDTH, compiled, load

NODES = WIDTH
# Degree of the displacement's polynomial.
DEGREE = NODES
# Ratios of successive steps for which the force is carried on, as powers of two.
RATIOS = range(-8, 5)


def _nodes() -> FloatArray:
    s = NODES
    right_radau = Legendre.basis(s, domain=[0, 1]) - Legendre.basis(s - 1, domain=[0, 1])
    c = np.sort(right_radau.roots().real)
    for _ in range(3):
        c = c - right_radau(c) / right_radau.deriv()(c)
    c[-1] = 1.0
    return c


def _bernstein(p: Polynomial, degree: int) -> FloatArray:
    """Coefficients in Bernstein's basis of a degree."""
    a = p.coef
    return np.array(
        [sum(comb(i, k) / comb(degree, k) * a[k] for k in range(min(i, len(a) - 1) + 1)) for i in range(degree + 1)]
    )


def _by_columns(matrix: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.swapaxes(matrix, -1, -2))


C = _nodes()
_P = np.array([Legendre.basis(k, domain=[0, 1])(C) for k in range(NODES)]).T
TO_LEGENDRE: FloatArray = np.linalg.inv(_P)
"""Legendre coefficients of the values at the nodes, (s, s)."""

_LAGRANGE = [Legendre(TO_LEGENDRE[:, j], domain=[0, 1]) for j in range(NODES)]
_ONCE = [p.integ(lbnd=0) for p in _LAGRANGE]

A: FloatArray = np.ascontiguousarray(np.transpose([p(C) for p in _ONCE]))
A2: FloatArray = A @ A

_POWER = [p.convert(kind=Polynomial, domain=[-1, 1]) for p in _LAGRANGE]
VALUES_TO_BERNSTEIN: FloatArray = np.ascontiguousarray([_bernstein(p, NODES - 1) for p in _POWER])
"""Bernstein coefficients of the polynomial through the values at the nodes; (s, s), by columns."""

ONCE_TO_BERNSTEIN: FloatArray = np.ascontiguousarray([_bernstein(p.integ(), DEGREE)[1:] for p in _POWER])
"""Bernstein coefficients of its integral from 0, without the first, which is zero; (s, s), by columns."""

TWICE_TO_BERNSTEIN: FloatArray = np.ascontiguousarray(A.T @ ONCE_TO_BERNSTEIN)
"""The same of the integral of the polynomial through the integral's values at the nodes: places from accelerations."""

EVENLY: FloatArray = np.arange(1, DEGREE + 1) / DEGREE
"""Bernstein coefficients of theta, without the first, which is zero; (s,)."""

AT_BEGIN: FloatArray = np.ascontiguousarray(VALUES_TO_BERNSTEIN[:, 0])
"""Weights of the values at the nodes in the polynomial's value at 0."""

EXTRAPOLATE: FloatArray = _by_columns(
    np.array([np.transpose([p(1.0 + 2.0**k * C) for p in _LAGRANGE]) for k in RATIOS])
)
"""Values at the nodes of the next step, 2^k times as long, of the same polynomial carried on; (ratios, s, s)."""


@compiled(inside=True)
def basis(theta):  # type: ignore[no-untyped-def]
    """Return the nodes' Lagrange polynomials at theta, and their integrals from 0."""
    x = 2.0 * theta - 1.0
    before, now = 1.0, x
    value, integral = load(TO_LEGENDRE, 0), load(TO_LEGENDRE, 0) * theta
    for k in range(1, NODES):
        after = ((2.0 * k + 1.0) * x * now - k * before) / (k + 1.0)
        row = load(TO_LEGENDRE, k * NODES)
        value = value + row * now
        integral = integral + row * ((after - before) / (2.0 * (2.0 * k + 1.0)))
        before, now = now, after
    return value, integral
