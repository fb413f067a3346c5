"""Causes of one's own: the tutorial's, and one with a compiled law."""

from __future__ import annotations

from pathlib import Path

from scripts import loaded

ROOT = Path(__file__).parents[1]


TUTORIAL = loaded(ROOT / "docs" / "make_tutorial.py")
SENSOR: str = TUTORIAL.example()
# A law, compiled: a contact that hardens with the square of the indentation.
CUBIC = (
    SENSOR.split("def reading")[0]
    + """
def law(d, rate, p, out):
    size = d / 1e-6
    factor = 1.0 + p[0] * size * size
    out[1] = out[1] * factor + out[0] * 2.0 * p[0] * size / 1e-6
    out[0] *= factor
    out[2] *= factor


def literal(rig, p):
    elastic, strength = rig.elastic, p[0]
    rig.elastic = lambda d, rate: elastic(d, rate) * (1 + strength * (d / 1e-6) ** 2)


def _force(d, strength):
    out = [1e6 * d, 1e6, 0.0, 0.0, 0.0, 0.0]
    law(d, 0.0, [strength], out)
    return out[0]


TERM = Term(
    id="cubic", slot="contact", title="hardening contact", equation=r"F = k_c d (1 + b d^2)", description=__doc__,
    parameters=(
        Parameter("cubic_b", "b", "1", Bounds(0.0, 5.0), Normal(0.0, 0.5), "hardening", "made up", neutral=0.0),
    ),
    symptom=Symptom("deeper is harder", sign=0, frequency="mixed", amplitude="mixed"), reference="made up",
    checks=(Check("1 N/um at 2 um, b = 0.5: 2 N x 3 = 6 N", lambda: _force(2e-6, 0.5), 6.0),),
    literal=literal, law=law,
)
"""
)
