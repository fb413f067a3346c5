"""Several observables in one experiment: read, written, simulated, fitted and scored."""

from __future__ import annotations

import math
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from folders import write

import psafit
from psafit.errors import InputError
from psafit.experiment import Experiment, Group, describe, fingerprint, read_experiment, read_plan, write_experiment
from psafit.experiment.writer import table_text
from psafit.inference import noise
from psafit.inference.candidate import optimised
from psafit.inference.optimiser import expansion, gradient, slopes
from psafit.inference.problem import Problem
from psafit.observables import CONTACT_TIME, LAUNCH_RANGE, LAUNCH_SPEED, OF_LAUNCHES
from psafit.simulate import Design, simulate
from psafit.validate import columns_of, predictive, score, write_predictions

MIXED = """frequency_hz,amplitude_v,launch_range_um,launch_speed_mm_s,contact_time_us,sigma_us
1000,20,25,,,
1200,20,30,0.3,215,2
1200,20,,0.31,,
2000,20,,,130,3
"""


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    return read_experiment(Path(__file__).resolve().parents[1] / "experiments" / "psa")


def mixed(folder: Path, text: str = MIXED) -> Experiment:
    return read_experiment(write(folder, a=text))


def simulated(experiment: Experiment, kinds: tuple[int, ...] = (0, 1, 2, 3), seed: int = 1) -> Experiment:
    """Its conditions, read in every observable, from the prior's median with one per cent of scatter."""
    groups = []
    for g in experiment.groups:
        n = len(kinds)
        many = np.tile(np.arange(g.n_points), n)
        planned = replace(g.at(many), measured=np.repeat(kinds, g.n_points), row=many, reading=np.ones(many.size))
        groups.append(planned)
    blank = replace(experiment, groups=tuple(groups))
    problem = Problem(blank, blank.ids)
    exact = problem.predict(problem.prior_transform(np.full((1, problem.n_dim), 0.5)))[0]
    drawn = exact * (1 + 0.01 * np.random.default_rng(seed).standard_normal(exact.size))
    return blank.with_readings(np.maximum(drawn, 0.0))


def test_every_cell_is_a_reading_of_its_observable(tmp_path: Path) -> None:
    group = mixed(tmp_path).groups[0]
    assert [
        (o.name, p.reading.tolist(), p.row.tolist()) for o, p in zip(group.observables, group.parts, strict=True)
    ] == [
        ("launch_range", [25, 30], [0, 1]),
        ("launch_speed", [0.3, 0.31], [1, 2]),
        ("contact_time", [215, 130], [1, 3]),
    ]
    assert group.sigma is not None and group.sigma.tolist() == [0, 0, 0, 0, 2, 3]
    assert group.frequency_hz.tolist() == [1000, 1200, 1200, 1200, 1200, 2000]
    assert group.launch_range_um.tolist() == [25, 30] and group.label == "1 (launch speed and contact time)"


def test_a_mixed_table_is_written_as_it_was(tmp_path: Path) -> None:
    experiment = mixed(tmp_path / "old")
    write_experiment(replace(experiment, folder=Path()), tmp_path / "new")
    again = read_experiment(tmp_path / "new")
    assert again.fingerprint == experiment.fingerprint
    assert (tmp_path / "new" / experiment.groups[0].file).read_text().splitlines()[2] == "1200,20,30,0.3,215,2"


def test_what_is_read_enters_the_fingerprint(tmp_path: Path) -> None:
    ranges = mixed(tmp_path / "a", "frequency_hz,amplitude_v,launch_range_um\n1000,20,25\n")
    speeds = mixed(tmp_path / "b", "frequency_hz,amplitude_v,launch_speed_mm_s\n1000,20,25\n")
    one = [fingerprint(e.constants, e.groups[:1]) for e in (ranges, speeds)]
    assert one[0] != one[1]
    assert describe(speeds)["groups"][0]["launch_speed_mm_s"] == [25, 25]


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("frequency_hz,amplitude_v,launch_speed_mm_s\n1,1,\n", 2, "launch_speed_mm_s is empty"),
        ("frequency_hz,amplitude_v,launch_range_um,contact_time_us\n1,1,,\n", 2, "launch_range_um is empty"),
        ("frequency_hz,amplitude_v,contact_time_us\n1,1,0\n", 2, "contact_time_us '0' is not positive"),
        ("frequency_hz,amplitude_v,launch_range_um,sigma_us\n1,1,1,1\n", 1, "sigma_us without contact_time_us"),
        ("frequency_hz,amplitude_v,launch_speed\n1,1,1\n", 1, "did you mean launch_speed_mm_s, in mm/s?"),
        ("frequency_hz,amplitude_v,contact_time_us,sigma_us\n1,1,5,\n", 2, "sigma_us is empty"),
        ("frequency_hz,amplitude_v,launch_speed_mm_s\n1,1,-0.01\n", 2, "by no more than scatter"),
        ("frequency_hz,amplitude_v,launch_speed_mm_s\n1,1,-5\n", 2, "more than scatter (about 0.03 mm/s)"),
    ],
)
def test_faults_name_line_and_column(tmp_path: Path, text: str, line: int, said: str) -> None:
    with pytest.raises(InputError) as caught:
        mixed(tmp_path, text)
    assert said in str(caught.value) and f":{line}" in str(caught.value)


def test_a_speed_given_as_a_range_is_suspected(tmp_path: Path) -> None:
    """Ranges that no ball of the launch speeds swings: a speed, or another unit."""
    text = "frequency_hz,amplitude_v,launch_range_um,launch_speed_mm_s\n"
    wrong = mixed(tmp_path / "a", text + "1000,20,0.3,0.3\n1200,20,0.31,0.31\n")
    assert any("times what a ball of the launch speeds swings" in line for line in wrong.warnings)
    right = mixed(tmp_path / "b", text + "1000,20,28.7,0.3\n1200,20,29.7,0.31\n")
    assert not any("swings" in line for line in right.warnings)


def test_readings_follow_from_one_simulation(experiment: Experiment) -> None:
    """Each in its unit; readings at the same conditions share a simulation."""
    made = simulated(replace(experiment, groups=experiment.groups[:1]))
    problem = Problem(made, made.ids)
    u = problem.prior_transform(np.full((1, problem.n_dim), 0.5))
    assert problem.design.launches is not None
    assert problem.design.launches[0].n_points < problem.design.n_points / 2
    plain = Design.of(made.constants, experiment.groups[:1])
    found = simulate(plain, problem.theta(u, made.ids), forces=True)
    read = np.split(problem.predict(u)[0], 4)
    assert read[0] == pytest.approx(found.launch_range[0] * 1e6, rel=1e-14)
    assert read[1] == pytest.approx(found.separation_speed[0] * 1e3, rel=1e-14)
    assert read[2] == pytest.approx(found.separation_time[0] * 1e6, rel=1e-14)
    assert found.peak_force is not None and read[3] == pytest.approx(found.peak_force[0], rel=1e-14)


def test_one_likelihood_is_the_sum_of_each_observables(experiment: Experiment) -> None:
    """By hand, from the density of each observable with its own scatter."""
    made = simulated(replace(experiment, groups=experiment.groups[2:3]))
    problem = Problem(made, made.ids)
    assert problem.names[-12:] == tuple(p.name for o in OF_LAUNCHES for p in o.scatter)
    u = problem.prior_transform(np.random.default_rng(0).uniform(0.2, 0.8, (3, problem.n_dim)))
    predicted, values = problem.predict(u), problem.to_physical(u)[:, -12:].reshape(3, 4, 3)
    total = np.zeros(3)
    for k in range(4):
        rows = problem.design.measured == k
        total += noise.log_density(problem.observed[rows], predicted[:, rows], values[:, k], None).sum(axis=1)
    assert problem.log_likelihood(u) == pytest.approx(total, rel=1e-12)


def test_gradient_of_a_mixed_likelihood(experiment: Experiment) -> None:
    """The expansion's gradient is that of finite differences, the scatters' parameters included."""
    made = simulated(replace(experiment, groups=experiment.groups[2:3]))
    problem = Problem(made, made.ids)
    u = problem.prior_transform(np.full((1, problem.n_dim), 0.45))
    predicted = problem.predict(u)
    slope = slopes(problem, u, predicted)
    found, curvature = expansion(problem, u, predicted, slope, problem.observed[None])
    direct = gradient(problem.log_posterior, u[0], problem.bounds)
    assert found[0] == pytest.approx(direct, rel=2e-2, abs=0.05)
    assert np.linalg.eigvalsh(curvature[0]).min() > 0


def test_groups_without_an_observable_are_fitted_without_it(experiment: Experiment) -> None:
    """Contact times that the other group alone was read in leave their scatter to its prior."""
    made = simulated(replace(experiment, groups=experiment.groups[2:4]))
    first, second = made.groups
    some = first.at(np.flatnonzero(first.measured < 2))
    one = Problem(replace(made, groups=(some, second)), (some.id,))
    u = one.prior_transform(np.full((1, one.n_dim), 0.45))
    predicted = one.predict(u)
    found, curvature = expansion(one, u, predicted, slopes(one, u, predicted), one.observed[None])
    assert found[0] == pytest.approx(gradient(one.log_posterior, u[0], one.bounds), rel=2e-2, abs=0.05)
    assert np.linalg.eigvalsh(curvature[0]).min() > 0
    assert np.isfinite(optimised(one, u).log_posterior)


def test_each_observable_is_scored_in_its_own_unit(experiment: Experiment, tmp_path: Path) -> None:
    made = simulated(replace(experiment, groups=experiment.groups[2:4]))
    problem = Problem(made, made.ids[:1])
    draws = problem.prior_transform(np.random.default_rng(0).uniform(0.45, 0.55, (40, problem.n_dim)))
    found = predictive(problem, draws, 1)
    assert [p.group.observable for p in found] == [*OF_LAUNCHES, *OF_LAUNCHES]
    times = score(found[2])
    assert times.observable == "contact_time"
    y = found[2].group.reading
    assert times.log_rmse == pytest.approx(math.sqrt(np.mean(np.log((found[2].median + 1) / (y + 1)) ** 2)))
    assert score(found[0]).observable is None
    write_predictions(tmp_path / "predictions.csv", found)
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "predictions-contact_time.csv", "predictions-launch_speed.csv", "predictions-peak_force.csv", "predictions.csv",
    ]  # fmt: skip
    lines = (tmp_path / "predictions-launch_speed.csv").read_text().splitlines()
    assert lines[0] == (
        "group,waveform,frequency_hz,amplitude_v,launch_speed_mm_s,predicted_mm_s,lower_mm_s,upper_mm_s,role"
    )
    assert len(lines) == 1 + sum(g.n_points for g in made.groups) // 4


def test_columns_of_each_table() -> None:
    assert columns_of(LAUNCH_RANGE)[4:8] == ("launch_range_um", "predicted_um", "lower_um", "upper_um")
    assert columns_of(CONTACT_TIME)[4:8] == ("contact_time_us", "predicted_us", "lower_us", "upper_us")
    assert LAUNCH_SPEED.sigma_column == "sigma_mm_s" and CONTACT_TIME.sigma_column == "sigma_us"


def test_a_ball_that_is_not_launched_reads_zero(experiment: Experiment) -> None:
    still = Design.sweep(experiment.constants, "sine", 1000.0, 0.0)
    found = simulate(still, [1e7, 10.0, 10.0], forces=True)
    assert [float(o.of(found)[0, 0]) for o in OF_LAUNCHES] == [0.0, 0.0, 0.0, 0.0]


def test_sweeps_keep_observables_apart() -> None:
    f = np.array([3.0, 1.0, 2.0, 1.0, 3.0])
    group = Group(1, "sine", "", f, np.ones(5), np.ones(5), measured=np.array([0, 0, 1, 1, 0], np.int8))
    assert group.in_sweep.tolist() == [1, 0, 4, 3, 2]


def test_an_empty_column_says_what_a_plan_will_read(tmp_path: Path) -> None:
    """... and is written back; a column that is empty here and there is a fault, as it always was."""
    text = "frequency_hz,amplitude_v,contact_time_us,sigma_us\n1000,20,,2\n1200,20,,3\n"
    plan = read_plan(write(tmp_path / "a", a=text))
    group = plan.groups[0]
    assert not isinstance(group, Group) and group.observables == (CONTACT_TIME,)
    assert group.sigma is not None and group.sigma.tolist() == [2, 3]
    assert table_text(group) == text
    with pytest.raises(InputError, match="contact_time_us is empty"):
        read_experiment(write(tmp_path / "b", a=text))
    with pytest.raises(InputError, match=r":3.*contact_time_us is empty"):
        read_plan(write(tmp_path / "c", a=text.replace("1000,20,,", "1000,20,5,")))
    launch = read_plan(write(tmp_path / "d", a="frequency_hz,amplitude_v\n1,1\n")).groups[0]
    assert launch.observables == (LAUNCH_RANGE,) and table_text(launch) == "frequency_hz,amplitude_v\n1,1\n"


RISE = """
from psafit.observables.observable import Observable, scatter
from psafit.parameters import Bounds, LogNormal

LAUNCH_RISE = Observable(
    name="launch_rise", column="launch_rise_um", unit="um", scale=1e6, title="launch rise",
    called=("rise", "steighöhe"), of=lambda launches: launches.separation_speed**2 / (2.0 * 9.81),
    scatter=scatter("launch_rise", "um", LogNormal(0.05, 2.5), LogNormal(0.01, 3.0), Bounds(1e-4, 10.0), ("a", "b")),
    offset=0.01, limits=(0.0, 1e9), still=0.0, usual=(1e-3, 1e6), mistaken=(("mm",), ("nm",)),
)
"""
USE_RISE = r"""
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import numpy as np
import psafit.observables
assert psafit.observables.__file__.startswith(sys.argv[1]), psafit.observables.__file__
from psafit.experiment import Constants, read_experiment
from psafit.experiment.importing import Options, read_files
from psafit.inference.problem import Problem
from psafit.physics import terms
from psafit.simulate import Design, readings

e = read_experiment(Path(sys.argv[1], "rig"))
assert [psafit.observables.OBSERVABLES[k].name for k in e.groups[0].measured] == ["launch_rise"] * 3
rise = readings(Design.of(e.constants, e.groups), [4e5, 9e3, 60.0])[0, :3]
speeds = read_experiment(Path(sys.argv[1], "speeds"))
speed = readings(Design.of(speeds.constants, speeds.groups), [4e5, 9e3, 60.0])[0, :3]
assert np.allclose(rise, 1e6 * (speed / 1e3) ** 2 / (2 * 9.81)), (rise, speed)
problem = Problem(e, e.ids)
assert "sigma_rel_launch_rise" in problem.names and np.isfinite(problem.log_posterior(problem.medians[None])).all()
file = Path(sys.argv[1], "sweep.csv")
file.write_text("Frequency (Hz);Amplitude (V);Steigh\u00f6he (mm)\n800;20;0.003\n900;20;0.002\n", "utf-8")
(table,) = read_files([file], Options(waveforms=("sine",), volts="peak"))
assert table.groups[0].reading.tolist() == [3.0, 2.0], table.groups[0].reading

from psafit.challenge.conditions import ConditionSettings, drawn

also = ConditionSettings(reads=((("launch_rise",), 1.0),), other_reads=1.0, traced=0.0)
for seed in range(3):
    read = {psafit.observables.OBSERVABLES[k].name for g in drawn(seed, settings=also).groups for k in g.measured}
    assert "launch_rise" in read, read
"""


def test_an_observable_is_one_file_and_one_line(tmp_path: Path) -> None:
    """In a copy of the package: read, imported, simulated, fitted, drawn; behind traces, which no launch is."""
    shutil.copytree(Path(psafit.__file__).parent, tmp_path / "psafit")
    folder = tmp_path / "psafit" / "observables"
    (folder / "launch_rise.py").write_text(RISE, "utf-8")
    text = (folder / "__init__.py").read_text("utf-8")
    imported = "from psafit.observables.launch_range import LAUNCH_RANGE\n"
    text = text.replace(imported, f"{imported}from psafit.observables.launch_rise import LAUNCH_RISE\n")
    text = text.replace(", TIP_DISPLACEMENT\n)", ", TIP_DISPLACEMENT, LAUNCH_RISE\n)")
    (folder / "__init__.py").write_text(text, "utf-8")
    for name, column in (("rig", "launch_rise_um"), ("speeds", "launch_speed_mm_s")):
        (tmp_path / name).mkdir()
        write(tmp_path / name, a=f"frequency_hz,amplitude_v,{column}\n800,20,3\n900,20,2.5\n1000,20,2\n")
    run = subprocess.run([sys.executable, "-c", USE_RISE, str(tmp_path)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
