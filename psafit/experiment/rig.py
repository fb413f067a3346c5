"""What a rig is made of, and the priors that follow from it.

Ball radius and materials give the stiffness of Hertz' contact, source resistance and capacity the lag, rated voltage
and layers the law of the stroke, the string how far a ball leans. A fact that is not given says nothing: the usual,
wide priors hold.

Elastic moduli and densities are the middles of handbook ranges (R. C. Hibbeler, Mechanics of Materials, tables of
average properties, and the tables of ecoursesbook.com, both read for metals, glass and nylon; PZT: 1/s33 of the
constants of PZT-5H; alumina, silicon nitride and zirconia: tables of Lily Bearing and Kientec, read, but for zirconia's
Poisson's ratio; tungsten carbide: makers' usual figures, not verified). Chrome steel is a steel: 100Cr6 has 190-210
GPa, 0.27-0.30 and 7.83 g/cm^3 (data sheets, read). Sapphire and ruby are one crystal, of 330-450 GPa by direction and
0.28 (makeitfrom.com and a maker's table, read).
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from psafit.parameters import Belief, Bounds, LogNormal, Normal, Tailed

if TYPE_CHECKING:
    from psafit.experiment.records import Constants


@dataclass(frozen=True)
class Material:
    """An elastic solid.

    Parameters
    ----------
    modulus : float, Pa
        Young's.
    poisson : float
        Poisson's ratio.
    density : float, kg/m^3
    """

    modulus: float
    poisson: float
    density: float

    @property
    def plane_modulus(self) -> float:
        """``E/(1 - nu^2)``, Pa."""
        return self.modulus / (1 - self.poisson**2)


MATERIALS = {
    "steel": Material(205e9, 0.29, 7850),
    "stainless steel": Material(193e9, 0.30, 7900),
    "aluminium": Material(70e9, 0.33, 2700),
    "brass": Material(103e9, 0.34, 8500),
    "copper": Material(115e9, 0.34, 8900),
    "titanium": Material(114e9, 0.33, 4450),
    "glass": Material(65e9, 0.22, 2500),
    "nylon": Material(2.8e9, 0.40, 1140),
    "pzt": Material(48e9, 0.34, 7500),
    "alumina": Material(370e9, 0.22, 3900),
    "silicon nitride": Material(310e9, 0.27, 3200),
    "tungsten carbide": Material(600e9, 0.22, 15000),
    "zirconia": Material(205e9, 0.30, 6050),
    "sapphire": Material(400e9, 0.28, 3990),
}
"""Materials of balls and faces."""
ALIASES = {
    "aluminum": "aluminium",
    "bearing steel": "steel",
    "chrome steel": "steel",
    "100cr6": "steel",
    "ruby": "sapphire",
}
"""Other names of the same materials."""

SEVERAL = {
    "ball_material": "silicon nitride, zirconia or alumina",
    "face_material": "pzt, the bare stack, or alumina, an end plate, on which the contact is three times as stiff",
}
"""What a ceramic may be, of each fact."""
NEEDED = {
    "k_c": ("ball_material", "face_material"),
    "amplifier_lag_tau": ("source_resistance", "capacity"),
    "anchored_voltage": ("rated_stroke", "rated_voltage"),
}
"""The facts, beyond constants, from which priors follow together."""


def material_named(text: str) -> str | None:
    """The name, among `MATERIALS`, of what somebody calls `Stainless_Steel` or `aluminum`; None if it is none."""
    name = " ".join(text.casefold().replace("_", " ").replace("-", " ").split())
    name = ALIASES.get(name, name)
    return name if name in MATERIALS else None


@dataclass(frozen=True)
class Rig:
    """Facts of a rig, the table ``[rig]`` of `experiment.toml`; each may be missing.

    Parameters
    ----------
    ball_material, face_material : str, optional
        Of `MATERIALS`.
    ball_radius : float, m, optional
    source_resistance : float, ohm, optional
        Output resistance of what drives the stack.
    capacity : float, F, optional
        Of the stack.
    rated_voltage : float, V, optional
        At which the data sheet states the stroke.
    rated_stroke : float, m, optional
    layer_thickness : float, m, optional
        Of one layer of the stack.
    """

    ball_material: str | None = None
    face_material: str | None = None
    ball_radius: float | None = None
    source_resistance: float | None = None
    capacity: float | None = None
    rated_voltage: float | None = None
    rated_stroke: float | None = None
    layer_thickness: float | None = None

    @property
    def given(self) -> dict[str, Any]:
        """The facts there are, by name."""
        return {f.name: value for f in fields(self) if (value := getattr(self, f.name)) is not None}


def hertz_stiffness(rig: Rig) -> float | None:
    """Secant stiffness of the contact at an indentation of 1 um, N/m; None where a fact is missing.

    Hertz' ``4/3 E* sqrt(R d)``, ``1/E* = 1/E*_1 + 1/E*_2`` (K. L. Johnson, Contact Mechanics, 1985, eq. 4.23-4.24).
    """
    if rig.ball_radius is None or rig.ball_material is None or rig.face_material is None:
        return None
    ball, face = MATERIALS[rig.ball_material], MATERIALS[rig.face_material]
    together = 1 / (1 / ball.plane_modulus + 1 / face.plane_modulus)
    return 4 / 3 * together * math.sqrt(rig.ball_radius * 1e-6)


def with_radius(rig: Rig, constants: Constants) -> Rig:
    """The rig with the radius of a solid ball of its mass and material, where no radius is given."""
    if rig.ball_radius is not None or rig.ball_material is None:
        return rig
    volume = constants.M / MATERIALS[rig.ball_material].density
    return replace(rig, ball_radius=(3 * volume / (4 * math.pi)) ** (1 / 3))


def lacking(rig: Rig | None, known: Container[str]) -> dict[str, tuple[str, ...]]:
    """The facts that are missing of each prior that nearly follows, and is not `known`."""
    given = rig.given if rig else {}
    missing = {
        name: tuple(fact for fact in facts if fact not in given)
        for name, facts in NEEDED.items()
        if name not in known and not given.keys().isdisjoint(facts)
    }
    return {name: facts for name, facts in missing.items() if facts}


def is_rated_stroke(rig: Rig, constants: Constants, factor: float = 1.33) -> bool:
    """Whether the constant `q` is the data sheet's stroke at full voltage over that voltage.

    Then the stroke per volt is less at small fields, as of all soft PZT; stacks of hard PZT and of single crystals are
    the rare others.

    Parameters
    ----------
    rig : Rig
    constants : Constants
    factor : float
        They are the same to within this factor: strokes of one type differ by 12-17 %, and are rounded.
    """
    if rig.rated_stroke is None or rig.rated_voltage is None:
        return False
    return 1 / factor <= rig.rated_stroke / rig.rated_voltage / constants.q <= factor


@dataclass(frozen=True)
class Followed(Belief):
    """What follows of a parameter from facts or constants.

    Parameters
    ----------
    facts : tuple of (str, float)
        Keys of ``[rig]`` or ``[constants]`` and their values, SI.
    """

    facts: tuple[tuple[str, float], ...] = ()
    derived: bool = True


def beliefs(
    rig: Rig,
    constants: Constants,
    *,
    own_lag: float = 2e-6,
    lags: float = 0.95,
    anchored: float = 0.7,
    stroke_tolerance: float = 1.17,
) -> tuple[Followed, ...]:
    """Priors that follow from what a rig is made of.

    All have heavy tails: a handbook knows neither the glue nor the film on a face, and a fact may be mistaken.

    Parameters
    ----------
    rig : Rig
    constants : Constants
        Those of the rig.
    own_lag : float, s
        What an amplifier lags behind without any load, and what no resistance says: 2 us are those of 80 kHz. Fast ones
        have 0.3 us (PiezoDrive PD200X4, manual read: 470 kHz without load), bench-top controllers 10 us and more.
    lags : float
        Probability that a stated resistance and capacity that give a lag do so: one such statement in twenty may not
        be of what drives the stack (an estimate).
    anchored : float
        Probability that the stroke is anchored at the rated voltage, where the rig's stroke per volt is the data
        sheet's: soft PZT does that, and of stacks sold one in three may be another material, or driven so near to its
        rated voltage that nothing of it shows (an estimate).
    stroke_tolerance : float
        Factor by which a stack's stroke exceeds the data sheet's at most: strokes of one type differ by 12-17 %.

    Returns
    -------
    tuple of Followed
    """
    follows = partial(_followed, rig, constants)
    found = [*_of_ball(rig, constants)]
    if rig.source_resistance is not None and rig.capacity is not None:
        lag = rig.source_resistance * rig.capacity
        why = (
            f"{rig.source_resistance:g} ohm into {rig.capacity:g} F: {lag:.3g} s; a quarter either way, since a stack's"
            f" capacity has a tolerance of 20 % and grows with the field, and {own_lag:g} s of an amplifier's own"
        )
        known = Tailed(Normal(lag, math.hypot(0.25 * lag, own_lag)))
        at_work = lags if lag > own_lag else None  # a lag that no reading shows is no more likely to be named
        found.append(follows("amplifier_lag_tau", known, why, "source_resistance", "capacity", probability=at_work))
    if rig.rated_voltage is not None:
        most = rig.rated_voltage
        why = f"rated voltage of {most:g} V, at which the data sheet states the stroke"
        at_work = anchored if is_rated_stroke(rig, constants) else None
        found.append(
            follows("anchored_voltage", Tailed(LogNormal(most, 1.1)), why, "rated_voltage", probability=at_work)
        )
        why = f"offsets of 0.5 V and less; no drive rests beyond the rated voltage of {most:g} V"
        bounds = Bounds(-most, most)
        found.append(follows("idle_u0", Tailed(Normal(0.0, 0.5)), why, "rated_voltage", bounds=bounds))
        stroke, key = rig.rated_stroke or most * constants.q, "rated_stroke" if rig.rated_stroke else "q"
        why = f"touch is judged to a micrometre; a tip that overshoots reaches twice the full stroke of {stroke:.3g} m"
        bounds = Bounds(0.0, 2 * stroke_tolerance * stroke)
        found.append(follows("gap_width", Tailed(Normal(0.0, 1e-6)), why, key, "rated_voltage", bounds=bounds))
    if rig.layer_thickness is not None:
        # Domain walls answer the field, not the voltage: what is usual of layers of 0.11 mm, by their thickness.
        per_volt = 1.1e-4 / rig.layer_thickness
        why = f"0.006 1/V of layers of 0.11 mm, in the field of layers of {1e3 * rig.layer_thickness:.3g} mm"
        known = Tailed(Normal(6e-3 * per_volt, 4e-3 * per_volt))
        found += [follows(name, known, why, "layer_thickness") for name in ("anchored_alpha", "field_d33_alpha")]
    return tuple(found)


def _followed(
    rig: Rig, constants: Constants, name: str, prior: Tailed, source: str, *keys: str, **rest: Any
) -> Followed:
    """What follows from the facts or constants of these keys."""
    facts = tuple((key, getattr(constants if hasattr(constants, key) else rig, key)) for key in keys)
    return Followed(name, prior, source, facts=facts, **rest)


def _of_ball(rig: Rig, constants: Constants) -> Iterator[Followed]:
    """What follows from the ball and its string."""
    follows, ball = partial(_followed, rig, constants), with_radius(rig, constants)
    key = "ball_radius" if rig.ball_radius else "M"
    if (stiffness := hertz_stiffness(ball)) is not None:
        weighed = "" if rig.ball_radius else ", the radius of a solid one of mass M,"
        why = (
            f"Hertz' contact of a {rig.ball_material} ball of {1e3 * (ball.ball_radius or 0):.3g} mm{weighed} on"
            f" {rig.face_material}: {stiffness:.3g} N/m at 1 um; half of it, since rough or glued faces have a third,"
            " and a linear contact stands for depths of 0.1 to 1 um"
        )
        yield follows("k_c", Tailed(LogNormal(0.5 * stiffness, 2.5)), why, key)
    if ball.ball_radius is not None:
        weight = constants.M * constants.g
        why = (
            f"5 mN of a radius of 9.4 mm, in proportion to one of {1e3 * ball.ball_radius:.3g} mm; a bond of"
            f" four times the weight, {4 * weight:.2g} N, would be seen when the ball is hung"
        )
        known = Tailed(Normal(0.0, 5e-3 * ball.ball_radius / 9.4e-3))
        yield follows("adhesion_force", known, why, key, bounds=Bounds(0.0, 4 * weight))
    length = f"{1e3 * constants.l:.3g} mm"
    why = f"2.5 degrees of a string of {length}: a ball is hung to lean on the tip, so that it touches at every launch"
    known = Tailed(Normal(0.0, math.radians(2.5) * constants.l))
    for name in ("preload_offset", "session_lean_offset"):
        yield follows(name, known, why, "l", bounds=Bounds(0.0, 0.5 * constants.l))
