"""The rig on which the causes' checks are worked out by hand."""

from __future__ import annotations

import numpy as np

from psafit.physics.term import Setup

# Table 3 of the study; the other numbers at values where they do nothing.
_TABLE_3 = {
    "k_c": 1.425e5, "c_s": 13991.0, "c_c": 68.0, "m": 0.005, "M": 0.027, "k_s": 4.89e7, "q": 1.2e-7, "l": 0.09,
    "g": 9.81,
}  # fmt: skip
_NEUTRAL = {
    "phase": 0.0, "lag": 0.0, "inverse_slew": 0.0, "gap": 0.0, "lean": 0.0, "bond": 0.0, "pull": 1.0, "cycles": 0.0,
    "grip": 0.0, "rub": 0.0, "scale": 1.0, "idle": 0.0, "wall_mass": 0.0,
    "wall_stiffness": 0.0, "wall_damping": 0.0,
}  # fmt: skip


def plain_rig(**changes: float) -> Setup:
    """Return the study's rig as a batch of one, with some numbers replaced."""
    return Setup(**{name: np.array([number]) for name, number in {**_TABLE_3, **_NEUTRAL, **changes}.items()})
