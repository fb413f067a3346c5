"""The record of a diagnosis, made by hand: no simulation, no search."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
from reader import Reader

from psafit.diagnose.gain import Gain, GroupGain
from psafit.diagnose.record import CauseResult, Diagnosis, ScreeningResult
from psafit.experiment import Constants, Experiment, Group, fingerprint
from psafit.model_search.ladder import LookedAt
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


def parameters(*names: str, sampled: bool = True) -> dict:
    units = {"k_c": "N/m", "hysteresis_strength": "1", "hysteresis_voltage": "V", "sigma_abs": "um"}
    return {
        n: {"median": 4.1e5, "lower": 3.8e5 if sampled else None, "upper": 4.4e5 if sampled else None,
            "unit": units[n], "description": f"what {n} means", "prior_share": 0.985}
        for n in names
    }  # fmt: skip


def lack_of_fit(p_value: float, character: str, last: int | str) -> dict:
    return {
        "p_value": p_value, "character": character, "odd_groups": [last], "odd_points": [[1, 3]],
        "statistics": [
            {"name": "runs along the sweep", "kind": "mean", "group": last, "value": 7.0, "excess": 2.41,
             "p_value": 0.003, "significant": True},
            {"name": "spread of sizes", "kind": "spread", "group": None, "value": 1.0, "excess": -0.2,
             "p_value": 0.4, "significant": False},
        ],
        "n_simulated": 999, "refit": "exact",
    }  # fmt: skip


def growth(shift: float) -> list[dict]:
    at = np.geomspace(200, 1e4, 8)
    slope = -0.9 + 0.0 * at
    return [
        {"group": 1, "variable": "frequency", "at": at.tolist(), "measured": slope.tolist(),
         "lower": (slope - 0.2).tolist(), "upper": (slope + 0.2).tolist(), "simulated": (slope + shift).tolist()},
        {"group": 2, "variable": "amplitude", "at": [], "measured": [], "lower": [], "upper": [], "simulated": []},
    ]  # fmt: skip


def corners(simulated: float | None) -> list[dict]:
    return [
        {"group": 1, "variable": "frequency", "measured": 1669.74, "lower": 1554.5, "upper": 1751.3,
         "exponents": [0.84, -1.551], "simulated": simulated,
         "simulated_exponents": None if simulated is None else [0.14, -1.55]},
    ]  # fmt: skip


def gain(protocol: str, last: int | str) -> dict:
    rows = [
        GroupGain(g, ["hysteresis"], [1], 0.9, 0.2 + 0.1 * k, -300.0, -120.5, 0.42, 0.91, [-0.8, -0.61], [150.0, 210.0])
        for k, g in enumerate((2, last))
    ]
    ledger = [{"choice": "causes, parameters and scatter", "saw": [1], "scored_on": [2, last],
               "models": {"hysteresis": 0.8, "baseline": 0.2}}]  # fmt: skip
    return asdict(
        Gain(protocol, rows, 0.912, 0.254, [-0.71, -0.52], -600.0, -241.0, [310.0, 402.0], 0.42, 0.91, ledger,
             f"predictions-{protocol}.csv")
    )  # fmt: skip


def make_record(experiment: Experiment, *, title: str = "Made-up rig") -> Diagnosis:
    last = experiment.ids[-1]
    measured = np.concatenate([g.launch_range_um for g in experiment.groups])
    where = [
        {"group": last, "variable": "amplitude", "from": 10.0, "to": 20.0,
         "text": f"group {last}, 10 to 20 V: predictions too small by a factor of 2.50 (8.1 standard deviations)"}
    ]  # fmt: skip
    evidence = {
        "log_evidence": -412.0, "over_baseline": 151.2, "gain": 163.4, "error": 0.04, "effective_draws": 2210.0,
        "pareto_k": 0.31, "method": "adaptive importance sampling", "prior_width": {"half": -0.6, "twice": 0.3},
    }  # fmt: skip
    fitted = parameters("k_c", "hysteresis_strength", "hysteresis_voltage", "sigma_abs")
    laplace = {"log_evidence": -560.0, "over_baseline": 0.0, "gain": 0.0, "method": "Laplace"}
    return Diagnosis(
        schema=1, verdict="ambiguous", named=["hysteresis"], alternatives=[["gap", "slew_limit"], ["preload"]],
        causes=[
            CauseResult(["hysteresis"], 0.61, fitted, evidence, ["hysteresis_voltage"]),
            CauseResult(["gap", "slew_limit"], 0.31, parameters("k_c"), evidence | {"over_baseline": 150.5}, []),
            CauseResult([], 0.0002, parameters("k_c", sampled=False), laplace, []),
        ],
        looked_at=LookedAt(fitted=164, estimated=151, mass_not_looked_at=0.004),
        misfit={
            "p_value": 0.001, "where": where, "baseline": lack_of_fit(0.001, "physics", last),
            "extended": lack_of_fit(0.31, "none", last) | {"where": []},
            "sessions": [{"first": experiment.ids[0], "second": last, "n_conditions": 2, "factor": 1.32, "lower": 1.21,
                          "upper": 1.44}],
            "robustness": {"groups": [[g, 54.5] for g in experiment.ids], "strongest": last, "without": 101.0,
                           "over_smooth": -20.4},
            "leftover": {"log_bayes": -1.2, "amplitude": 0.04, "level": 0.02, "reach": 0.7, "sigma_rel": 0.051,
                         "groups": [{"group": g, "mean": 0.01, "largest": 0.05} for g in experiment.ids],
                         "mean": [0.02] * measured.size, "sd": [None] + [0.03] * (measured.size - 1)},
        },
        numerics={
            "identity": "ab", "engine": "stepper", "tolerance": 1e-5, "n_sets": 1, "n_points": 42,
            "refinement": [{"tolerance": 1e-3, "worst": 2e-4, "median": 1e-6},
                           {"tolerance": 1e-5, "worst": 3.1e-7, "median": 1e-9}],
            "error": 3.1e-7, "required": 1e-5, "converged": True, "fastest_rate": 2.8e6, "stable_step": 9.9e-7,
            "common_step": 1e-6, "common_growth": 1.035,
        },
        gain={"strict": gain("strict", last), "nested": gain("nested", last)},
        next_experiment={
            "about": "tells hysteresis from gap + slew_limit",
            "proposals": [
                {"text": "sine, 20 V", "waveform": "sine", "frequency_hz": [100.0, 2e4], "amplitude_v": [20.0, 20.0],
                 "constants": {"l": 0.075}, "separation": 12.5, "success": 0.93, "error": 0.4},
                {"text": "", "waveform": "square", "frequency_hz": [500.0, 500.0], "amplitude_v": [2.0, 20.0],
                 "constants": {}, "separation": 1.5, "success": float("nan"), "error": 0.1},
            ],
        },
        predictions="predictions-diagnosis.csv",
        sentences=["3 sets of causes explain these readings about equally well."],
        extension={"strict": {"folder": "extension", "terms": ["hysteresis"], "scored_on": [last], "converged": False,
                   "message": "", "holdout_log_rmse": 0.2, "groups": [last]}},
        unnamed=0.03,
        screening=[
            ScreeningResult("hysteresis", "present", 120.0, 163.4, 1.9, 118.0, 0.31, "1", 14.0, 0.64),
            ScreeningResult("gap", "not present", 3.0, 4.4, 1.4, -1.0, 2e-7, "m", 5.0, 0.33, 7e-7),
            ScreeningResult("swing_drag", "could not have been seen", 0.0, 0.01, 0.1, -0.2, 0.1, "1", 0.3, 0.02),
        ],
        show={
            "baseline": {"growth": growth(0.5), "corners": corners(1900.0),
                         "predicted_um": (0.4 * measured + 0.1).tolist(), "parameters": {},
                         "drift": [{"parameter": "k_c", "variable": "amplitude", "gain": 90.2, "factor": 3.3},
                                   {"parameter": "c_s", "variable": "range", "gain": 9.0, "factor": 8103.0}]},
            "extended": {"growth": growth(0.02), "corners": corners(None),
                         "predicted_um": (1.05 * measured).tolist(), "parameters": {},
                         "without_um": {"hysteresis": (1.4 * measured).tolist(), "gap": [None] * measured.size},
                         "drift": [{"parameter": "k_c", "variable": "amplitude", "gain": 0.7, "factor": 1.1}]},
        },
        ledger=[{"choice": "verdict", "saw": list(experiment.ids), "scored_on": []}, *gain("strict", last)["ledger"]],
        title=title, fingerprint=experiment.fingerprint, groups=list(experiment.ids), training=[1], seed=7, quick=False,
        versions={"psafit": "0.1.0", "python": "3.11.7"}, command="psafit diagnose experiments/made-up --group 1",
        seconds={"causes": 12.5},
    )  # fmt: skip


def build(record: Diagnosis, experiment: Experiment, folder: Path) -> Reader:
    return Reader(write_diagnosis(record, experiment, folder).read_text("utf-8"))
