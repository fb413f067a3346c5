r"""Which measurement would tell tied causes apart, or a weakly determined parameter best.

Each proposal is a sweep within the limits of what was measured (or one changed constant of the rig), read with the
fitted scatter. For two models with posterior draws, readings are simulated from one, and the log ratio of both
models' posterior predictive densities of these readings (each a mixture over its draws) is what the readings would
add to the log odds. Its mean over many simulated experiments is the expected separation; the share of them in which
the right model wins by three nats is how often the proposal works: measured data drawn from each tied cause, judged
again.
"""

from __future__ import annotations

import math
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
# A posterior that keeps this share of its prior's width tells little.
_WEAK = 0.5
WORTHWHILE = 0.1
"""Separation from which on a proposal is worth a sentence: an odds ratio, or a standard deviation, a tenth better."""


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
        the expected fall of a weakly determined parameter's log standard deviation.
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

    def judged(self, separation: float, success: float = math.nan) -> Proposal:
        """It with what it would do."""
        d = self.design
        waveform = "square" if d.waveform[0] else "sine"
        return Proposal(
            self.text, waveform, d.frequency.tolist(), d.amplitude.tolist(), self.changed, float(separation), success
        )


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
                text = f"{waveform}, {_say(volts)} V, {_say(low_f)} to {_say(high_f)} Hz{words}"
                found.append(Possible(text, Design.sweep(rig, waveform, sweep, volts), changed))
            for at in np.geomspace(low_f, high_f, 6)[1:-1]:
                at = float(f"{at:.2g}")
                sweep = np.linspace(bottom, top, _POINTS)
                text = f"{waveform}, {_say(at)} Hz, {_say(bottom)} to {_say(top)} V{words}"
                found.append(Possible(text, Design.sweep(rig, waveform, at, sweep), changed))
    return found


def _say(value: float) -> str:
    return f"{float(f'{value:.3g}'):.6g}"


def tell_apart(first: tuple[Candidate, Weighed], second: tuple[Candidate, Weighed], *, seed: int) -> list[Proposal]:
    """Measurements by how well they would separate two models; best first."""
    rng = np.random.default_rng([seed, 17])
    possible = proposals(first[0])
    best: list[Proposal] = []
    # A glance at all of them, then a closer look at the best.
    for n_draws in (_GLANCE, _DRAWS):
        one, other = (_Model.of(*m, n_draws, rng) for m in (first, second))
        best = []
        for p in possible:
            a, b = one.forecast(p.design), other.forecast(p.design)
            ways = _trial(a, b, rng), _trial(b, a, rng)
            best.append(p.judged(min(w[0] for w in ways), min(w[1] for w in ways)))
        possible, best = _best(possible, best)
    return best


def determine(leader: Candidate, draws: Weighed, *, seed: int) -> tuple[str, list[Proposal]]:
    """Measurements by how much they would narrow a weakly determined parameter, and which one that is; best first.

    It is the one of which a measurement can tell most.
    """
    rng = np.random.default_rng([seed, 17])
    possible, weak = proposals(leader), weakly_determined(leader, draws)
    model = _Model.of(leader, draws, _GLANCE, rng)
    falls = np.array([_narrowing(model.forecast(p.design), model.u[:, weak]) for p in possible])
    which = int(np.argmax(falls.max(axis=0)))
    possible, _ = _best(possible, [p.judged(fall) for p, fall in zip(possible, falls[:, which], strict=True)])
    model = _Model.of(leader, draws, _DRAWS, rng)
    seen = model.u[:, [weak[which]]]
    _, best = _best(possible, [p.judged(_narrowing(model.forecast(p.design), seen)[0]) for p in possible])
    return leader.problem.names[weak[which]], best


def _best(possible: Sequence[Possible], judged: Sequence[Proposal]) -> tuple[list[Possible], list[Proposal]]:
    """The best; one that leaves the rig as it is stays, since nothing need be built for it."""
    order = sorted(range(len(judged)), key=lambda k: -judged[k].separation)
    best = order[:_CLOSER]
    if all(possible[k].changed for k in best):
        best += [k for k in order[_CLOSER:] if not possible[k].changed][:1]
    return [possible[k] for k in best], [judged[k] for k in best]


def weakly_determined(leader: Candidate, draws: Weighed) -> list[int]:
    """Indices of the physical parameters that the readings leave half as wide as the prior, or wider.

    If there is none, of the widest. Spreads of sessions are left aside: more sessions tell of those, not more readings.
    """
    problem = leader.problem
    u = draws.resampled(_DRAWS)[:, : problem.n_physical]
    q = problem.prior_transform(np.array([[0.16] * problem.n_dim, [0.84] * problem.n_dim]))
    prior = 0.5 * (q[1] - q[0])[: problem.n_physical]
    hyper = {t.strength.name for t in leader.terms if t.latent}
    ratio = np.where([name in hyper for name in problem.names[: problem.n_physical]], 0.0, u.std(axis=0) / prior)
    return np.flatnonzero(ratio >= min(_WEAK, ratio.max())).tolist()


@dataclass(frozen=True, eq=False)
class _Model:
    """Posterior draws of a model in the columns that the simulator takes for a session to come."""

    terms: tuple[Term, ...]
    theta: FloatArray  # (n_draws, n_columns)
    scatter: FloatArray  # (n_draws, 3)
    u: FloatArray  # the draws themselves, (n_draws, n_dim)

    @classmethod
    def of(cls, candidate: Candidate, draws: Weighed, n_draws: int, rng: np.random.Generator) -> _Model:
        problem, u = candidate.problem, draws.resampled(n_draws)
        # What belongs to sessions is drawn from its prior, not taken over.
        return cls(problem.terms, problem.theta(u, ["a session to come"], rng), problem.noise_values(u), u)

    def forecast(self, design: Design) -> _Forecast:
        """What it says of a measurement."""
        return _Forecast(simulate(design, self.theta, self.terms).launch_range * MICRO, self.scatter)


@dataclass(frozen=True, eq=False)
class _Forecast:
    ranges: FloatArray  # um, (n_draws, n_points)
    scatter: FloatArray


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


def _narrowing(forecast: _Forecast, u: FloatArray) -> FloatArray:
    """Expected fall of the log standard deviation of each parameter `u` (n_draws, n), by regression on the readings.

    Judged by draws that the regression has not seen, since sixteen readings explain anything of forty draws.
    """
    s = noise.scale(forecast.ranges, forecast.scatter, None)
    x = (forecast.ranges - forecast.ranges.mean(axis=0)) / s.mean(axis=0)
    y = u - u.mean(axis=0)
    n = len(x)
    # The scatter of a reading has unit variance here, which is what a ridge of n stands for.
    solved = np.linalg.solve(x.T @ x + n * np.eye(x.shape[1]), x.T)
    beta, leverage = solved @ y, np.einsum("ij,ji->i", x, solved)
    missed = (y - x @ beta) / (1 - leverage)[:, None]
    left = (np.mean(missed**2, axis=0) + np.sum(beta**2, axis=0)) / np.maximum(y.var(axis=0), 1e-300)
    return -0.5 * np.log(np.clip(left, 1e-3, 1.0))


def as_dict(found: Iterable[Proposal], about: str) -> dict[str, object]:
    """For the result file."""
    best = list(found)
    return {"about": about, "proposals": [asdict(p) for p in best[:5]]}
