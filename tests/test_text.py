"""Numbers as text."""

from __future__ import annotations

import math

import pytest

from psafit.text import fixed, significant


@pytest.mark.parametrize("p", [0.925, 0.285, 0.115, 0.005, 0.995, 1 / 3, 0.045])
def test_a_fraction_and_its_per_cent_are_the_same_number(p: float) -> None:
    assert float(fixed(p, 2)) * 100 == pytest.approx(float(fixed(p, per_cent=True)), abs=1e-9)
    assert float(significant(p, 2)) * 100 == pytest.approx(float(significant(p, 2, per_cent=True)), abs=1e-9)


def test_zero_has_no_sign() -> None:
    for value in (-0.0, -1e-9, -0.004, 0.004):
        for sign in (False, True):
            assert fixed(value, 2, sign=sign) == "0.00" and fixed(value, sign=sign, per_cent=True) == "0"
    assert significant(-0.0) == "0"


def test_what_is_no_zero_keeps_its_sign() -> None:
    assert (fixed(2.5, sign=True), fixed(-2.5), fixed(-0.0051, 2)) == ("+3", "-3", "-0.01")
    assert (significant(-1234.0), significant(999.6), significant(1e-320, 1)) == ("-1230", "1000", "1e-320")
    assert fixed(1.7e308).startswith("17") and "nan" in fixed(math.nan, 2) and significant(math.inf) == "inf"
