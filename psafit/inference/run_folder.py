"""What a run folder holds, whose it is, and the finished run read back from it.

The folder holds `experiment/` (a copy of the data the run saw), `fit.json` once the search is done, `importance/`
(draws by importance sampling), `chain.h5` (the sampler's checkpoint), and at the end `posterior.nc` and
`posterior.json`. The records carry checksums: what somebody has changed is not taken for a result.
"""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import psafit
from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.files import digest, in_use, refuse_foreign, remove_temporaries, sha256, write_atomically
from psafit.inference import noise, store
from psafit.inference.candidate import Candidate, candidate_at
from psafit.inference.problem import Problem
from psafit.inference.samplers import USUAL, sampler
from psafit.physics import plugin_versions, recorded, signatures
from psafit.prior_check import read
from psafit.records import Brief, Fit, PosteriorSummary, read_json

# In a folder whose search is not done yet, with the run's identity.
MARKER = ".psafit-run"

# What posterior.json vouches for.
SIGNED = ("fit.json", "posterior.nc")

_ANEW = "run psafit fit again with another --out"

LIBRARIES = ("numpy", "scipy", "numba", "lmfit", "arviz", "h5py", "pandas")


@dataclass(frozen=True, repr=False)
class Run(Brief):
    """A finished run, as its folder holds it."""

    _in_repr = ("folder", "fit", "summary")

    folder: Path
    problem: Problem
    fit: Fit
    summary: PosteriorSummary
    draws: store.Draws

    @property
    def best(self) -> FloatArray:
        """Parameters of the best minimum, in their units, (n_dim,)."""
        return np.array([self.fit.minima[0].values[name] for name in self.problem.names])

    @property
    def not_determined(self) -> list[str]:
        """Parameters of the scatter and of sessions that the readings do not determine."""
        return [p.name for p in self.summary.parameters[self.fit.n_physical :] if p.verdict == "not determined"]


def determinants_of(
    problem: Problem,
    seed: int,
    n_starts: int,
    sampled_by: str,
    settings: Mapping[str, float],
    known: list[dict[str, float]],
    version: str = psafit.__version__,
) -> dict[str, Any]:
    """Everything that determines a run's result, each under the word a user knows it by."""
    return {
        "data": problem.experiment.fingerprint,
        "groups": [str(g) for g in problem.group_ids],
        "terms": [t.signature for t in problem.terms],
        "priors": [p.signature for p in problem.parameters],
        "seed": seed,
        "starts": n_starts,
        "sampler": sampled_by,
        "sampler settings": dict(settings),
        "version": version,
        "known places": known,
    }


def _recorded(record: Fit) -> dict[str, Any]:
    """Everything that determines the result of a run on record; see `determinants_of`."""
    return {
        "data": record.fingerprint,
        "groups": [str(g) for g in record.groups],
        "terms": signatures(record.terms, record.versions),
        "priors": [[e.name, e.prior, e.lower, e.upper] for e in record.parameters],
        "seed": record.seed,
        "starts": record.n_starts,
        "sampler": record.sampled_by,
        "sampler settings": record.sampler,
        "version": record.versions.get("psafit"),
        "known places": record.known,
    }


def _differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    return ", ".join(word for word in one if one[word] != other[word])


def identity_of(determinants: Mapping[str, Any]) -> str:
    """A run's identity, by which it knows its files."""
    # Runs without starting points keep the identity that they had in earlier versions.
    return digest({word: value for word, value in determinants.items() if word != "known places" or value})


def versions(sampled_by: str = USUAL) -> dict[str, str]:
    """Versions of psafit, Python, the libraries (of a sampler, too) and the plugins that shape a result."""
    found = {"psafit": psafit.__version__, "python": platform.python_version()}
    return (
        found
        | {name: importlib.metadata.version(name) for name in (*LIBRARIES, *sampler(sampled_by).libraries)}
        | plugin_versions()
    )


def keep_posterior(path: Path, problem: Problem, draws: store.Draws, stored: int, seed: int) -> None:
    """Write `posterior.nc`: with readings and their log likelihood from some of the draws, and as many prior draws."""
    rng = np.random.default_rng([seed, 37])
    n_chains, n_kept = draws.values.shape[:2]
    flat = problem.to_sampling(draws.flat)
    every = math.ceil(len(flat) * problem.observed.size / stored)
    rows = flat.reshape(n_chains, n_kept, -1)[:, ::every].reshape(-1, problem.n_dim)
    likelihood, readings = [], []
    for part in np.array_split(rows, math.ceil(len(rows) / 2048)):
        ranges, scatter, known = problem.predict(part), problem.noise_values(part), problem.known_sigma
        likelihood.append(noise.log_density(problem.observed, ranges, scatter, known).astype(np.float32))
        # An instrument does not show ranges below zero.
        readings.append(np.maximum(noise.draw(ranges, scatter, known, rng), problem.floor).astype(np.float32))
    shape = n_chains, -1, problem.observed.size
    density = np.stack([p.log_prior(flat[:, i]) for i, p in enumerate(problem.parameters)], axis=-1)
    design = problem.design
    store.write(
        path,
        draws,
        np.concatenate(likelihood).reshape(shape),
        np.concatenate(readings).reshape(shape),
        problem.to_physical(problem.prior_transform(rng.random((n_kept, problem.n_dim)))),
        density.reshape(draws.values.shape),
        problem.observed,
        {o.column: rows for o, rows in zip(problem.observables, problem.rows_of_scatter, strict=True)},
        {"frequency_hz": design.frequency, "amplitude_v": design.amplitude, "waveform": design.waveform}
        | ({"time_us": design.time * 1e6} if design.traced.any() else {}),
    )


def load(folder: Path) -> Run:
    """Read a finished run; `InputError` where the folder is none, foreign, damaged or interrupted."""
    if not folder.is_dir():
        raise InputError("is not a run folder", "give a folder that psafit fit has written", file=folder)
    if not (folder / "fit.json").exists() and (folder / "diagnosis.json").exists():
        within = min((file.parent.name for file in folder.glob("*/fit.json")), default=None)
        other = f"the fit within it, {within}" if within else "a folder that psafit fit has written"
        remedy = f"read it with psafit.load_diagnosis, or give {other}"
        raise InputError("holds a diagnosis, not a fit", remedy, file=folder)
    record = read_json(folder / "fit.json", Fit, sealed=True)
    if not (folder / "posterior.json").exists():
        if in_use(folder):
            raise InputError("holds a run under way", "psafit watch shows how far it is; wait for its end", file=folder)
        raise InputError(
            "holds an interrupted run", "repeat the command that began it: it goes on where it stopped", file=folder
        )
    summary = read_json(folder / "posterior.json", PosteriorSummary, sealed=True, remedy=store.REBUILD)
    if summary.identity != record.identity:
        raise InputError("belongs to another run than fit.json", store.REBUILD, file=folder / "posterior.json")
    for name in SIGNED:
        if not (folder / name).exists():
            raise InputError("is missing", store.REBUILD, file=folder / name)
        if sha256(folder / name) != summary.files.get(name):
            if name == "posterior.nc":  # who holds it open for writing has marked it so: then that is said
                store.read(folder / name, tuple(p.name for p in record.parameters))
            raise InputError("was changed after the fit", store.REBUILD, file=folder / name)
    experiment = read(folder / "experiment")
    chosen = recorded(record.terms, record.versions, folder / "fit.json")
    problem = Problem(experiment, tuple(record.groups), chosen)
    found = _recorded(record)
    expected = determinants_of(
        problem, record.seed, record.n_starts, record.sampled_by, record.sampler, record.known, found["version"]
    )
    if differing := _differing(expected, found):
        if "data" in differing:
            kept = "put the files back that were fitted, or give another --out"
            raise InputError("was changed after the fit", kept, file=folder / "experiment")
        raise InputError(f"is of another version of psafit ({differing} differ)", _ANEW, file=folder / "fit.json")
    if identity_of(found) != record.identity or [p.name for p in summary.parameters] != list(problem.names):
        raise InputError("contradicts itself", _ANEW, file=folder / "fit.json")
    return Run(folder, problem, record, summary, store.read(folder / "posterior.nc", problem.names))


def claim(folder: Path, determinants: Mapping[str, Any]) -> Fit | None:
    """The folder's fit if it is of this very run, None if it is free and now ours; anything else is refused."""
    identity, marker = identity_of(determinants), folder / MARKER
    another = "choose another --out, or move the folder elsewhere to start over"
    record = None
    if (folder / "fit.json").exists():
        record = read_json(folder / "fit.json", Fit, sealed=True)
        if record.identity != identity:
            differing = _differing(determinants, _recorded(record)) or "something"
            raise InputError(f"holds another run (what differs: {differing})", another, file=folder)
    elif marker.exists():
        if marker.read_bytes() != identity.encode():
            raise InputError("holds another run, interrupted in its search", another, file=folder)
    else:
        refuse_foreign(folder)
        write_atomically(marker, identity.encode())
    for part in (folder, folder / "experiment"):
        if part.is_dir():
            remove_temporaries(part)
    return record


def modes_of(problem: Problem, record: Fit) -> Candidate:
    """The modes as a record keeps them."""
    values = np.array([[m.values[name] for name in problem.names] for m in record.minima])
    return candidate_at(problem, problem.to_sampling(values), np.array([m.starts for m in record.minima]))
