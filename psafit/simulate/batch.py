"""From parameter sets to launch ranges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from psafit.arrays import FloatArray
from psafit.experiment import Constants
from psafit.observables import LAUNCH_RANGE, OBSERVABLES, Motion, Observable
from psafit.physics import baseline
from psafit.physics.term import Setup, Term
from psafit.simulate import closed_form, flight, stepper
from psafit.simulate.callbacks import address
from psafit.simulate.design import Counts, Design

PATHS = ("closed form", "stepper")
MICRO = 1e6
"""um per m: measurements are in um, physics in m."""
# Which path a model takes does not depend on the rig.
_ANY_RIG = Constants(M=1.0, m=1.0, q=1.0, l=1.0, k_s=1.0, g=1.0)


@dataclass(frozen=True)
class Simulation:
    """What the simulator says of a batch; arrays have shape (n_sets, n_points).

    Parameters
    ----------
    launch_range : array, m
        Zero where the ball is not launched.
    separation_time : array, s
        NaN where the ball does not separate within the horizon.
    separation_speed : array, m/s
    launched : bool array
    separation_place : array, m
        The ball's displacement at the separation; NaN where no cause asks for it.
    peak_force : array, N, optional
        Largest contact force until the separation; NaN without one. None unless it was asked for.
    motion : (n_sets, n_points, n_moments, 3) array, optional
        Ball (m from rest), its speed (m/s) and tip (m from rest) at the design's moments; None where it has none. The
        tip's is NaN after the launch unless the design is `tipped`.
    engine : str
        The path that ran, of `PATHS`; "mixed" where sets of one batch differ (some at a cause's neutral value).
    """

    launch_range: FloatArray
    separation_time: FloatArray
    separation_speed: FloatArray
    launched: NDArray[np.bool_]
    separation_place: FloatArray
    engine: str
    peak_force: FloatArray | None = None
    motion: FloatArray | None = None


def launch_range(speed: ArrayLike, length: float, g: float) -> FloatArray:
    r"""Largest horizontal excursion of the pendulum, Eqs. (16)-(17) of the study.

    .. math:: h = v^2/2g, \qquad L_r = l \sin\theta_m = \sqrt{h (2l - h)},

    which keeps its digits for microscopic swings, where :math:`\cos\theta_m` is one to rounding. A ball that
    rises above the string's suspension has passed the horizontal: :math:`L_r = l`.

    Parameters
    ----------
    speed : array, m/s
    length : float
        String, m.
    g : float
        m/s^2.

    Returns
    -------
    array, m
    """
    height = np.minimum(np.square(np.asarray(speed, dtype=float)) / (2 * g), length)
    return np.sqrt(height * (2 * length - height))


def columns(terms: Sequence[Term], counts: Counts = Counts()) -> list[str]:  # noqa: B008
    """Name the columns of `theta`: the baseline's parameters, then each cause's in the order given.

    A parameter that every session, or reader, has for itself occurs once for each, numbered from 0.
    """
    names = [p.name for p in baseline.PARAMETERS]
    for term in terms:
        names += [p.name for p in term.parameters]
        if term.latent:
            names += [f"{term.latent.name}_{i}" for i in range(counts.latents(term))]
    return names


def own_columns(terms: Sequence[Term], counts: Counts) -> list[slice]:
    """Columns of each cause, as `columns` has them."""
    first = len(baseline.PARAMETERS)
    slices = []
    for term in terms:
        slices.append(slice(first, first + len(term.parameters) + counts.latents(term)))
        first = slices[-1].stop
    return slices


def rig_of(
    constants: Constants,
    theta: FloatArray,
    terms: Sequence[Term] = (),
    counts: Counts = Counts(),  # noqa: B008
    session: int = 0,
) -> Setup:
    """Return the rig's numbers for parameter sets, as the causes leave them in a session."""
    rig = Setup.of(constants, theta[:, : len(baseline.PARAMETERS)])
    for term, own in zip(terms, own_columns(terms, counts), strict=True):
        if term.setup:
            n = len(term.parameters)
            p = theta[:, own]
            rig = term.setup(rig, np.column_stack([p[:, :n], p[:, n + session]]) if term.latent else p)
    return rig


def path_of(terms: Sequence[Term], *, quantile: float = 0.9) -> str:
    """Say which path a model takes at plausible values: at this quantile of each prior."""
    probe = Setup.of(_ANY_RIG, np.ones((1, 3)))
    for term in terms:
        if term.setup:
            values = [float(p.to_physical(p.prior_quantile(np.array(quantile)))) for p in term.parameters]
            probe = term.setup(probe, np.array([[*values, *([0.0] if term.latent else [])]]))
    return "stepper" if any(t.stepped for t in terms) or _needs_steps(probe)[0] else "closed form"


def _needs_steps(rig: Setup) -> NDArray[np.bool_]:
    """Where the motion is not one linear phase from rest to separation."""
    turned = (rig.phase < 0.0) | (rig.phase > 0.5 * np.pi)
    return (
        (rig.inverse_slew > 0.0) | (rig.gap > 0.0) | (rig.pull != 1.0) | (rig.cycles > 0.0) | (rig.grip > 0.0)
        | (rig.wall_mass > 0.0) | turned
    )  # fmt: skip


def _contact(
    design: Design,
    rig: Setup,
    sets: FloatArray,
    terms: Sequence[Term],
    own: Sequence[slice],
    placed: bool,
    forced: bool,
    path: str | None,
    tolerance: float,
) -> tuple[NDArray[Any], ...]:
    """Follow the ball to its separation.

    Returns time, speed, place, status and highest force, each (n_sets, n_points), the motion at the design's moments,
    and the sets stepped.
    """
    # One bit for each cause whose function acts in contact and is not at its neutral value.
    pattern = np.zeros(len(sets), np.int64)
    for k, term in enumerate(terms):
        if term.stepped:
            pattern |= (sets[:, own[k].start] != term.strength.neutral).astype(np.int64) << k

    stepped = (pattern != 0) | _needs_steps(rig)
    if path == "closed form" and stepped.any():
        raise ValueError("these causes have no closed form")
    if path == "stepper" or design.tipped:
        stepped[:] = True
    shape = (len(sets), design.n_points)
    when, speed, place = np.empty(shape), np.empty(shape), np.full(shape, np.nan)
    status, peak = np.empty(shape, np.int8), np.empty(shape)
    motion = np.empty((*shape, design.moments.shape[1], 3))
    watches = motion.shape[2] > 0
    whole: tuple[NDArray[Any], ...] = (when, speed, place, status, peak, motion)

    def step(chosen: NDArray[np.intp], wanted: NDArray[np.bool_]) -> tuple[NDArray[Any], ...]:
        found: tuple[NDArray[Any], ...] = tuple(np.empty((len(chosen), *a.shape[1:]), a.dtype) for a in whole)
        for bits in np.unique(pattern[chosen]):
            some = np.flatnonzero(pattern[chosen] == bits)
            active = [(t, 8 * own[k].start) for k, t in enumerate(terms) if bits >> k & 1]
            calls = stepper.Calls(
                **{
                    kind: tuple((address(kind, getattr(t, kind)), at) for t, at in active if getattr(t, kind))
                    for kind in ("law", "stack_factor", "branch")
                }
            )
            seen = found[-1][some]
            *result, _ = stepper.separation(
                design, rig.take(chosen[some]), sets[chosen[some]], calls, tolerance, wanted[some], forced=forced,
                seen=seen if watches else None, tipped=design.tipped,
            )  # fmt: skip
            for target, values in zip(found, (*result, seen), strict=True):
                target[some] = values
        return found

    exact = np.flatnonzero(~stepped)
    if exact.size:
        seen = motion[exact]
        found = closed_form.separation(design, rig.take(exact), placed, forced, seen if watches else None)
        for target, values in zip(whole, (*found, seen), strict=True):
            target[exact] = values
        # A ball that its pendulum draws after the retreating tip is not launched yet: only steps follow it further.
        # Nor do their places count that it does not leave.
        back = (status == closed_form.DRAWN_BACK) | (placed & (status == closed_form.NO_SEPARATION))
        back[stepped] = False
        rows = np.flatnonzero(back.any(axis=1))
        if rows.size:
            for target, values in zip(whole, step(rows, back[rows]), strict=True):
                chosen = back[rows].reshape(*back[rows].shape, *[1] * (values.ndim - 2))
                target[rows] = np.where(chosen, values, target[rows])
    rest = np.flatnonzero(stepped)
    if rest.size:
        every = np.ones((rest.size, shape[1]), bool)
        for target, values in zip(whole, step(rest, every), strict=True):
            target[rest] = values
    return *whole, stepped


def simulate(
    design: Design,
    theta: ArrayLike,
    terms: Sequence[Term] = (),
    *,
    path: str | None = None,
    tolerance: float = stepper.TOLERANCE,
    forces: bool = False,
    counts: Counts | None = None,
) -> Simulation:
    """Launch the ball once for every parameter set and measurement point.

    Parameters
    ----------
    design : Design
        Measurement conditions, (n_points,).
    theta : (n_sets, n_parameters) array
        k_c (N/m), c_s (N s/m), c_c (N s/m) of each set, then the parameters of the causes as `columns` names them; a
        single set may be (n_parameters,).
    terms : sequence of Term
        Causes that extend the baseline.
    path : {"closed form", "stepper"}, optional
        By default each set takes the closed form wherever it has one; "stepper" makes all of them take the steps.
    tolerance : float
        Of the stepper: error admitted in one step, relative to the ball's speed. A swing with losses is followed in
        fewer steps where more than the usual error is admitted.
    forces : bool
        Whether to find the peak force of each contact.
    counts : Counts, optional
        Sessions and readers that `theta` has columns for; those of the design by default.

    Returns
    -------
    Simulation

    Raises
    ------
    ValueError
        If `theta` has another shape, a stiffness is not positive, or a value is negative or not finite where that makes
        no sense; if `path` is "closed form" and a set has none.
    """
    sets = np.atleast_2d(np.asarray(theta, dtype=float))
    counts = counts or design.counts
    names = columns(terms, counts)
    if sets.ndim != 2 or sets.shape[1] != len(names):
        raise ValueError(f"theta has shape {np.shape(theta)}, expected (n_sets, {len(names)}): {', '.join(names)}")
    if not (np.isfinite(sets).all() and (sets[:, 0] > 0).all() and (sets[:, 1:3] >= 0).all()):
        raise ValueError("theta needs k_c > 0, c_s >= 0 and c_c >= 0, and finite values throughout")
    if path not in (None, *PATHS):
        raise ValueError(f"no path {path!r}; there are {' and '.join(PATHS)}")

    by_session = counts.sessions > 1 and any(t.by_session for t in terms)
    if not (design.others or by_session):  # a search calls this thousands of times
        return _simulate(design, sets, terms, counts, path, tolerance, forces)
    split = design.of_sessions if by_session else design.of_rigs
    parts = [_simulate(part, sets, terms, counts, path, tolerance, forces) for part, _ in split]
    back = np.argsort(np.concatenate([rows for _, rows in split]), kind="stable")
    engines = {p.engine for p in parts}
    absent = {"engine", *([] if forces else ["peak_force"]), *([] if design.moments.size else ["motion"])}
    return Simulation(
        **{
            f.name: np.concatenate([getattr(p, f.name) for p in parts], axis=1)[:, back]
            for f in fields(Simulation)
            if f.name not in absent
        },
        engine=engines.pop() if len(engines) == 1 else "mixed",
    )


def readings(
    design: Design, theta: ArrayLike, terms: Sequence[Term] = (), *, tolerance: float = stepper.TOLERANCE
) -> FloatArray:
    """What would be read without scatter, each point in the unit of its observable; (n_sets, n_points).

    Parameters
    ----------
    design : Design
        `Design.measured` says what is read at each point.
    theta, terms, tolerance
        As of `simulate`.
    """
    if not len(np.atleast_2d(theta)):
        return np.empty((0, design.n_points))
    if not design.traced.any():
        return _of_launches(design, theta, terms, tolerance)
    counts = design.counts
    plain, rows = design.launched_rows
    read = np.empty((len(np.atleast_2d(theta)), design.n_points))
    if rows.size:
        read[:, rows] = _of_launches(plain, theta, terms, tolerance, counts)
    for part in design.motions:
        motion = simulate(part.launches, theta, terms, tolerance=tolerance, counts=counts).motion
        assert motion is not None
        ball, speed, tip = np.moveaxis(motion[:, part.launch, part.moment], 2, 0)
        for k in np.unique(design.measured[part.rows]):
            here = design.measured[part.rows] == k
            rows = part.rows[here]
            seen = OBSERVABLES[k].of(Motion(ball[:, here], speed[:, here], tip[:, here]))
            read[:, rows] = _as_read(OBSERVABLES[k], seen, design, rows, theta, terms, counts)
    return read


def _of_launches(
    design: Design, theta: ArrayLike, terms: Sequence[Term], tolerance: float, counts: Counts | None = None
) -> FloatArray:
    """`readings` of launches as a whole."""
    if design.launches is None:
        found = simulate(design, theta, terms, tolerance=tolerance, counts=counts)
        return LAUNCH_RANGE.of(found) * LAUNCH_RANGE.scale
    (points, back), counts = design.launches, counts or design.counts
    kinds = np.unique(design.measured)
    forces = any(OBSERVABLES[k].force for k in kinds)
    found = simulate(points, theta, terms, tolerance=tolerance, forces=forces, counts=counts)
    read = np.empty((len(found.launch_range), design.n_points))
    for k in kinds:
        here = np.flatnonzero(design.measured == k)
        seen = OBSERVABLES[k].of(found)[:, back[here]]
        read[:, here] = _as_read(OBSERVABLES[k], seen, design, here, theta, terms, counts)
    return read


def _as_read(
    observable: Observable,
    values: FloatArray,
    design: Design,
    rows: NDArray[np.intp],
    theta: ArrayLike,
    terms: Sequence[Term],
    counts: Counts,
) -> FloatArray:
    """What is read of values, SI units, (n_sets, n_rows), at some rows of a design; in the column's unit.

    Launch ranges are simulated as they are read. What a launch that failed does not have is not read, either.
    """
    if observable is not LAUNCH_RANGE and any(observable.name in t.reads for t in terms):
        sets = np.atleast_2d(np.asarray(theta, dtype=float))
        read = _changed(observable, values, design, rows, sets, terms, own_columns(terms, counts))
        values = np.where(values == 0.0, 0.0, read) if observable.blank else read
    return values * observable.scale


def _changed(
    observable: Observable,
    values: FloatArray,
    design: Design,
    rows: NDArray[np.intp] | slice,
    sets: FloatArray,
    terms: Sequence[Term],
    own: Sequence[slice],
) -> FloatArray:
    """Values of an observable, SI units, at some rows of a design, as causes that change its readings leave them."""
    for term, columns_ in zip(terms, own, strict=True):
        if observable.name not in term.reads:
            continue
        if term.reading:
            values = term.reading(values, sets[:, columns_], design.occasion(term.per)[rows])
        if term.condition:
            values = values * term.condition(design.frequency[rows], design.amplitude[rows], sets[:, columns_])
    return values


def _simulate(
    design: Design,
    sets: FloatArray,
    terms: Sequence[Term],
    counts: Counts,
    path: str | None,
    tolerance: float,
    forces: bool,
) -> Simulation:
    """Simulate sets at points of one rig, and of one session where every session has its own."""
    own, session = own_columns(terms, counts), int(design.session[0]) if design.n_points else 0
    # Sets that differ only in what happens after the launch, or in another session, share their contact.
    after = np.zeros(sets.shape[1], bool)
    for term, columns_ in zip(terms, own, strict=True):
        after[columns_] = term.after_launch
        if term.by_session:
            latent = columns_.start + len(term.parameters)
            after[latent : columns_.stop] = np.arange(counts.sessions) != session
    first: NDArray[np.intp] | slice = slice(None)
    back: NDArray[np.intp] | slice = slice(None)
    if after.any():
        _, first, inverse = np.unique(sets[:, ~after], axis=0, return_index=True, return_inverse=True)
        back = inverse.ravel()
    rig = rig_of(design.constants, sets, terms, counts, session)
    weight = np.zeros(len(sets))
    for term, columns_ in zip(terms, own, strict=True):
        if term.swing_offset:
            weight = weight + term.swing_offset(sets[:, columns_])
    placed = bool((rig.lean > 0.0).any() or (weight > 0.0).any() or design.moments.size)
    when, speed, place, status, peak, motion, stepped = (
        a[back] for a in _contact(design, rig.take(first), sets[first], terms, own, placed, forces, path, tolerance)
    )

    losses = [
        (address("deceleration", t.deceleration), 8 * own[k].start) for k, t in enumerate(terms) if t.deceleration
    ]
    loss = np.ascontiguousarray(np.array(losses, np.int64).reshape(-1, 2).T)
    swung = np.empty(speed.shape)
    steps = flight.STEPS if tolerance <= stepper.TOLERANCE else flight.FEW_STEPS
    flight.swing(
        speed,
        place,
        status,
        rig.l,
        rig.g,
        rig.lean,
        rig.rub,
        weight,
        loss[0],
        loss[1],
        np.ascontiguousarray(sets),
        steps,
        swung,
    )
    if motion.size:
        flight.follow(
            when, speed, place, status, rig.l, rig.g, rig.lean, rig.rub, loss[0], loss[1], np.ascontiguousarray(sets),
            design.moments, steps, motion,
        )  # fmt: skip
    swung = _changed(LAUNCH_RANGE, swung, design, slice(None), sets, terms, own)
    engine = PATHS[int(stepped.all())] if stepped.all() or not stepped.any() else "mixed"
    launched = status == closed_form.LAUNCHED
    return Simulation(
        swung, when, speed, launched, place, engine, peak if forces else None, motion if motion.size else None
    )
