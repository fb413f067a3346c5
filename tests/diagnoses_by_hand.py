"""The record of a diagnosis, made by hand: no simulation, no search."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from reader import Reader

from psafit.diagnose.gain import Choice, Gain, GroupGain
from psafit.diagnose.misfit import Character, Statistic
from psafit.diagnose.next_experiment import NextExperiment, Proposal, Purpose
from psafit.diagnose.record import Diagnosis
from psafit.diagnose.record.misfit import DiscrepancyResult, GroupDiscrepancy, MisfitResult, Reading, Tests, Where
from psafit.diagnose.record.models import (
    Apart,
    CauseResult,
    Evidence,
    ExtensionRun,
    Look,
    ModelShown,
    ParameterResult,
    ScreeningResult,
)
from psafit.diagnose.robustness import Robustness
from psafit.diagnose.show import Corner, Drift, Growth, Offset
from psafit.experiment import Constants, Experiment, Group, fingerprint
from psafit.model_search.model_set import LookedAt
from psafit.records import Numerics, Refinement
from psafit.report.diagnosis import write_diagnosis

CONSTANTS = Constants(M=0.0272, m=0.107, q=0.25e-6, l=0.15, k_s=25e6, g=9.8)


def make_experiment(last: int | str = 3) -> Experiment:
    f, v = np.geomspace(100, 2e4, 24), np.linspace(2.0, 20.0, 14)
    groups = (
        Group(1, "sine", "1.csv", f, np.full(24, 20.0), 300 * (f / 100) ** -0.9),
        Group(2, "square", "2.csv", np.full(14, 1200.0), v, np.maximum(0.05 * (v - 3.0) ** 2 * (v > 3), 0.0)),
        Group(last, "sine", "3.csv", [500, 500, 900, 900], [10, 20, 10, 20], [3.0, 6.0, 4.0, 9.0]),
    )
    return Experiment("Made-up rig", "nowhere", CONSTANTS, groups, Path("x"), fingerprint(CONSTANTS, groups))


def parameters(*names: str, sampled: bool = True) -> dict[str, ParameterResult]:
    units = {"k_c": "N/m", "hysteresis_strength": "1", "hysteresis_voltage": "V", "sigma_abs": "um"}
    return {
        n: ParameterResult(
            4.1e5,
            3.8e5 if sampled else None,
            4.4e5 if sampled else None,
            units[n],
            f"what {n} means",
            0.985,
            prior_lower=1e4,
            prior_upper=2e5,
        )
        for n in names
    }


def lack_of_fit(p_value: float, character: Character, last: int | str, where: list[Where] | None = None) -> Tests:
    return Tests(
        p_value=p_value, character=character, odd_groups=[last], odd_points=[(1, 3)], coincidences=[],
        furthest=[Reading(1, 3, 200.0, 20.0, 100.0, 140.0, -4.2)],
        statistics=[
            Statistic("runs along the sweep", "mean", last, 7.0, 2.41, 0.003, True),
            Statistic("spread of sizes", "spread", None, 1.0, -0.2, 0.4, False),
        ],
        n_simulated=999, refit="exact", where=where,
    )  # fmt: skip


def growth(shift: float) -> list[Growth]:
    at = np.geomspace(200, 1e4, 8)
    slope = -0.9 + 0.0 * at
    return [
        Growth(
            1, "frequency", at.tolist(), slope.tolist(), (slope - 0.2).tolist(), (slope + 0.2).tolist(),
            (slope + shift).tolist(),
        ),
        Growth(2, "amplitude", [], [], [], [], []),
    ]  # fmt: skip


def corners(simulated: float | None) -> list[Corner]:
    exponents = None if simulated is None else (0.14, -1.55)
    return [Corner(1, "frequency", 1669.74, 1554.5, 1751.3, (0.84, -1.551), simulated, exponents)]


def shown(model: np.ndarray, *drift: Drift, bend: float, corner: float | None = None, **without) -> ModelShown:
    return ModelShown(growth(bend), corners(corner), list(drift), [], model.tolist(), without, {})


def gain(protocol: str, last: int | str) -> Gain:
    rows = [
        GroupGain(g, ["hysteresis"], [1], 0.9, 0.2 + 0.1 * k, -300.0, -120.5, 0.42, 0.91, [-0.8, -0.61], [150.0, 210.0])
        for k, g in enumerate((2, last))
    ]
    ledger = [Choice("causes, parameters and scatter", [1], [2, last], {"hysteresis": 0.8, "baseline": 0.2})]
    return Gain(
        protocol, rows, 0.912, 0.254, [-0.71, -0.52], -600.0, -241.0, [310.0, 402.0], 0.42, 0.91, ledger,
        f"predictions-{protocol}.csv",
    )  # fmt: skip


def make_record(experiment: Experiment, *, title: str = "Made-up rig") -> Diagnosis:
    last = experiment.ids[-1]
    measured = np.concatenate([g.reading for g in experiment.groups])
    text = f"group {last}, 10 to 20 V: predictions too small by a factor of 2.50 (8.1 standard deviations)"
    where = [Where(last, "amplitude", 10.0, 20.0, text, -np.log(2.5), 8.1, [])]
    evidence = Evidence(
        -412.0, 151.2, 163.4, 0.62, "adaptive importance sampling", 0.04, 2210.0, 0.31, {"half": -0.6, "twice": 0.3},
        prior_odds=-3.2,
    )  # fmt: skip
    fitted = parameters("k_c", "hysteresis_strength", "hysteresis_voltage", "sigma_abs")
    laplace = Evidence(-560.0, 0.0, 0.0, 0.0002, "Laplace")
    return Diagnosis(
        schema=1, verdict="ambiguous", named=["hysteresis"], alternatives=[["gap", "slew_limit"], ["preload"]],
        causes=[
            CauseResult(["hysteresis"], 0.61, fitted, evidence, ["hysteresis_voltage"]),
            CauseResult(["gap", "slew_limit"], 0.31, parameters("k_c"), replace(evidence, over_baseline=150.5), []),
            CauseResult([], 0.0002, parameters("k_c", sampled=False), laplace, []),
        ],
        looked_at=LookedAt(fitted=164, estimated=151, mass_not_looked_at=0.004, neighbours=True),
        misfit=MisfitResult(
            p_value=0.001, where=where, baseline=lack_of_fit(0.001, "physics", last),
            extended=lack_of_fit(0.31, "none", last, []),
            sessions=[Offset(experiment.ids[0], last, 2, 1.32, 1.21, 1.44)],
            robustness=Robustness([(g, 54.5) for g in experiment.ids], last, 101.0, -20.4),
            leftover=DiscrepancyResult(
                -1.2, 0.04, 0.02, 0.7, 0.051, [GroupDiscrepancy(g, 0.01, 0.05) for g in experiment.ids],
                [0.02] * measured.size, [None] + [0.03] * (measured.size - 1),
            ),
        ),
        numerics=Numerics(
            identity="ab", engine="stepper", tolerance=1e-5, n_sets=1, n_points=42,
            refinement=[Refinement(1e-3, 2e-4, 1e-6), Refinement(1e-5, 3.1e-7, 1e-9)],
            error=3.1e-7, required=1e-5, converged=True, fastest_rate=2.8e6, stable_step=9.9e-7,
            common_step=1e-6, common_growth=1.035,
        ),
        gain={"strict": gain("strict", last), "nested": gain("nested", last)},
        next_experiment=NextExperiment.of(
            [
                Proposal("sine, 20 V", "sine", [100.0, 2e4], [20.0, 20.0], {"l": 0.075}, 12.5, 0.93, 0.4),
                Proposal("", "square", [500.0, 500.0], [2.0, 20.0], {}, 1.5, None, 0.1),
            ],
            Purpose("separate", [["hysteresis"], ["gap", "slew_limit"]]),
        ),
        predictions="predictions-diagnosis.csv",
        sentences=["3 sets of causes explain these readings about equally well."],
        extension={
            "strict": ExtensionRun(
                "extension", [last], ["hysteresis"], [last], False, "", Apart("k_c", 0.1, 0.1, 900.0), 0.2
            )
        },
        unnamed=0.03,
        looks=[Look("hysteresis", "what the stack does", 0.62, True, parameters("hysteresis_strength"))],
        screening=[
            ScreeningResult("hysteresis", "present", 120.0, 163.4, 1.9, 118.0, 0.31, "1", 14.0, 0.64),
            ScreeningResult("gap", "not present", 3.0, 4.4, 1.4, -1.0, 2e-7, "m", 5.0, 0.33, 7e-7),
            ScreeningResult("swing_drag", "could not have been seen", 0.0, 0.01, 0.1, -0.2, 0.1, "1", 0.3, 0.02),
        ],
        show={
            "baseline": shown(
                0.4 * measured + 0.1, Drift("k_c", "amplitude", 90.2, 3.3), Drift("c_s", "range", 9.0, 8103.0),
                bend=0.5, corner=1900.0,
            ),
            "extended": shown(
                1.05 * measured, Drift("k_c", "amplitude", 0.7, 1.1), bend=0.02,
                hysteresis=(1.4 * measured).tolist(), gap=[math.nan] * measured.size,
            ),
        },
        ledger=[Choice("verdict", list(experiment.ids), []), *gain("strict", last).ledger],
        title=title, fingerprint=experiment.fingerprint, groups=list(experiment.ids), training=[1], seed=7, quick=False,
        versions={"psafit": "0.1.0", "python": "3.11.7"}, command="psafit diagnose experiments/made-up --group 1",
        seconds={"causes": 12.5},
    )  # fmt: skip


def build(record: Diagnosis, experiment: Experiment, folder: Path) -> Reader:
    return Reader(write_diagnosis(record, experiment, folder).read_text("utf-8"))
