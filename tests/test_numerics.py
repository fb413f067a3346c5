"""The audit of a fit's numerics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs import rig

from psafit.inference.problem import Problem
from psafit.numerics import refine
from psafit.physics import terms


def test_an_audit_is_of_the_steps_that_were_taken() -> None:
    """At the problem's own tolerance, and not converged where its error is more than would do."""
    model = Problem(rig(["hertz_exponent"], [1.5], seed=1), (1,), terms(["hertz_exponent"]), tolerance=1e-3)
    u = model.prior_transform(np.full((1, model.n_dim), 0.5))
    reported = refine(model, u, "me")
    exact = replace(model, tolerance=1e-10).predict(u, model.experiment.ids)
    error = np.abs(model.predict(u, model.experiment.ids) / exact - 1).max()
    assert reported.engine == "stepper" and reported.tolerance == 1e-3 and reported.converged
    assert reported.error == pytest.approx(error, rel=0.05) and reported.error > 1e-9
    assert not refine(model, u, "me", required=0.5 * error, of_scatter=0.0).converged
