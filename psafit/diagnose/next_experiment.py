r"""Which measurement would tell tied causes apart, or a weakly determined parameter best.

Each proposal is a sweep within the limits of what was measured (or one changed constant of the rig), read with the
fitted scatter. For two models with posterior draws, readings are simulated from one, and the log ratio of both
models' posterior predictive densities of these readings (each a mixture over its draws) is what the readings would
add to the log odds. Its mean over many simulated experiments is the expected separation; the share of them in which
the right model wins by three nats is how often the proposal works: measured data drawn from each tied cause, judged
again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from psafit.inference import noise
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import Weighed
from psafit.inference.problem import MICRO
from psafit.physics.term import Term
from psafit.simulate import Design, simulate

FloatArray = NDArray[np.float64]

_POINTS, _DRAWS, _TRIALS = 16, 150, 200
# Draws for a first glance, and proposals looked at more closely.
_GLANCE, _CLOSER = 40, 12
_WINS = 3.0
_FACTORS = (0.5, 2.0)


@dataclass(frozen=True)
class Proposal:
    """A measurement.

    Parameters
    ----------
    text : str
    waveform : {"sine", "square"}
    frequency_hz, amplitude_v : list of float
    constants : dict
        Changed constants of the rig, SI; empty for none.
    separation : float
        Expected gain of the right model in log odds (nats), the smaller of the two ways round; for one model alone,
        the expected fall of the weakest parameter's log standard deviation.
    success : float
        Share of simulated experiments in which the right model wins by three nats; NaN for one model alone.
    """

    text: str
    waveform: str
    frequency_hz: list[float]
    amplitude_v: list[float]
    constants: dict[str, float]
    separation: float
    success: float


@dataclass(frozen=True, eq=False)
class Possible:
    """A measurement that the rig allows."""

    text: str
    design: Design
    changed: dict[str, float]


def proposals(candidate: Candidate) -> list[Possible]:
    """Measurements that the rig allows: sweeps within the measured limits, and each changed constant."""
    problem = candidate.problem
    every = Design.of(problem.experiment.constants, problem.experiment.groups)
    f = every.frequency[every.frequency > 0]
    low_f, high_f = float(np.quantile(f, 0.02)), float(np.quantile(f, 0.98))
    top = float(every.amplitude.max())
    bottom = float(every.amplitude[every.amplitude > 0].min())
    if top <= 1.5 * bottom:
        bottom = top / 10
    rigs: list[tuple[str, dict[str, float]]] = [("", {})]
    constants = problem.experiment.constants
    rigs += [(f", string {x:g} times as long", {"l": constants.l * x}) for x in _FACTORS]
    rigs += [(f", ball {x:g} times as heavy", {"M": constants.M * x}) for x in _FACTORS]
    found = []
    for words, changed in rigs:
        rig = replace(constants, **changed)
        for waveform in ("sine", "square"):
            for share in (1.0, 0.5, 0.2):
                volts = top * share
                sweep = np.geomspace(low_f, high_f, _POINTS)
                text = f"{waveform}, {volts:.3g} V, {low_f:.3g} to {high_f:.3g} Hz{words}"
                found.append(Possible(text, Design.sweep(rig, waveform, sweep, volts), changed))
            for at in np.geomspace(low_f, high_f, 6)[1:-1]:
                at = float(f"{at:.2g}")
                sweep = np.linspace(bottom, top, _POINTS)
                text = f"{waveform}, {at:g} Hz, {bottom:.3g} to {top:.3g} V{words}"
                found.append(Possible(text, Design.sweep(rig, waveform, at, sweep), changed))
    return found


def propose(leader: Candidate, draws: Weighed, rival: tuple[Candidate, Weighed] | None, *, seed: int) -> list[Proposal]:
    """Measurements by how well they would separate two models, or determine one's weakest parameter; best first."""
    possible = proposals(leader)
    # A glance at all of them, then a closer look at the best.
    for n_draws in (_GLANCE, _DRAWS):
        rng = np.random.default_rng([seed, 17])
        models = [_Model.of(c, d, n_draws, rng) for c, d in ((leader, draws), *((rival,) if rival else ()))]
        judged = sorted(((_judge(p.design, models, rng), p) for p in possible), key=lambda j: -j[0][0])
        # The best that leaves the rig as it is stays, however good the others are: nothing need be built for it.
        best = judged[:_CLOSER]
        if all(p.changed for _, p in best):
            best += [j for j in judged[_CLOSER:] if not j[1].changed][:1]
        possible = [p for _, p in best]
    return [
        Proposal(
            p.text, "square" if p.design.waveform[0] else "sine", p.design.frequency.tolist(),
            p.design.amplitude.tolist(), p.changed, separation, success,
        )
        for (separation, success), p in best
    ]  # fmt: skip


def _judge(design: Design, models: Sequence[_Model], rng: np.random.Generator) -> tuple[float, float]:
    """Separation and success of one measurement; see `Proposal`."""
    forecasts = [m.forecast(design) for m in models]
    if len(forecasts) == 1:
        return _informs(forecasts[0]), float("nan")
    first, second = forecasts
    ways = [_trial(first, second, rng), _trial(second, first, rng)]
    return min(w[0] for w in ways), min(w[1] for w in ways)


def weakest(leader: Candidate, draws: Weighed) -> int:
    """Index of the physical parameter that the readings narrow least, against its prior; spreads of sessions aside."""
    u = draws.resampled(_DRAWS)[:, : leader.problem.n_physical]
    q = leader.problem.prior_transform(np.array([[0.16] * leader.problem.n_dim, [0.84] * leader.problem.n_dim]))
    prior = 0.5 * (q[1] - q[0])[: leader.problem.n_physical]
    hyper = {t.strength.name for t in leader.terms if t.latent}  # more sessions tell of it, not more readings
    ratio = np.where([name in hyper for name in leader.problem.names[: u.shape[1]]], 0.0, u.std(axis=0) / prior)
    return int(np.argmax(ratio))


@dataclass(frozen=True, eq=False)
class _Model:
    """Posterior draws of a model in the columns that the simulator takes for a session to come."""

    terms: tuple[Term, ...]
    theta: FloatArray  # (n_draws, n_columns)
    scatter: FloatArray  # (n_draws, 3)
    weak: FloatArray  # sampling coordinate of the weakest parameter, (n_draws,)

    @classmethod
    def of(cls, candidate: Candidate, draws: Weighed, n_draws: int, rng: np.random.Generator) -> _Model:
        problem, u = candidate.problem, draws.resampled(n_draws)
        # What belongs to sessions is drawn from its prior, not taken over.
        theta = problem.theta(u, ["a session to come"], rng)
        return cls(problem.terms, theta, problem.noise_values(u), u[:, weakest(candidate, draws)])

    def forecast(self, design: Design) -> _Forecast:
        """What it says of a measurement."""
        return _Forecast(simulate(design, self.theta, self.terms).launch_range * MICRO, self.scatter, self.weak)


@dataclass(frozen=True, eq=False)
class _Forecast:
    ranges: FloatArray  # um, (n_draws, n_points)
    scatter: FloatArray
    weak: FloatArray


def _trial(truth: _Forecast, other: _Forecast, rng: np.random.Generator) -> tuple[float, float]:
    """Mean log ratio of predictive densities when `truth` makes the readings, and how often it wins clearly."""
    chosen = rng.integers(0, len(truth.ranges), _TRIALS)
    readings = np.maximum(noise.draw(truth.ranges[chosen], truth.scatter[chosen], None, rng), 0.0)
    ratio = np.empty(_TRIALS)
    for k, y in enumerate(readings):
        own = noise.log_density(y, truth.ranges, truth.scatter, None).sum(axis=1)
        own[chosen[k]] = -np.inf  # the draw that made them is not among those that judge them
        others = noise.log_density(y, other.ranges, other.scatter, None).sum(axis=1)
        ratio[k] = logsumexp(own) - logsumexp(others)
    return float(np.mean(np.clip(ratio, -50, 50))), float(np.mean(ratio > _WINS))


def _informs(forecast: _Forecast) -> float:
    """Expected fall of the log standard deviation of the weakest parameter: linear regression on the readings."""
    s = noise.scale(forecast.ranges, forecast.scatter, None)
    x = (forecast.ranges - forecast.ranges.mean(axis=0)) / s.mean(axis=0)
    y = forecast.weak - forecast.weak.mean()
    gram = x.T @ x / len(x) + np.eye(x.shape[1])  # the scatter of the readings has unit variance here
    cross = x.T @ y / len(x)
    explained = float(cross @ np.linalg.solve(gram, cross)) / max(float(y.var()), 1e-300)
    return -0.5 * float(np.log(max(1 - explained, 1e-3)))


def as_dict(found: Iterable[Proposal], about: str) -> dict[str, object]:
    """For the result file."""
    best = list(found)
    return {"about": about, "proposals": [asdict(p) for p in best[:5]]}
