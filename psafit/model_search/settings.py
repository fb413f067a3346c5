"""Options of the search among causes."""

from __future__ import annotations

from dataclasses import dataclass, field

from psafit.inference.evidence import RoundSettings
from psafit.inference.sample import SampleSettings


@dataclass(frozen=True)
class SearchSettings(SampleSettings):
    """How far a search looks, and how much work goes into a model; they belong to the identity of a result.

    What a sample of a model takes is set by the fields of `psafit.inference.sample.SampleSettings`. Models that rest on
    a mode from which a fit has risen by `better` are looked at again.

    Parameters
    ----------
    window : float, nats
        A model that shows is sampled, and its neighbours are fitted, as long as its log posterior probability comes
        this near to that of the best: at less than one in a hundred of the best it is a step towards others at most,
        and the best has steps of its own.
    short_by : float, nats
        What a short fit may be below a model's true evidence: until it was sampled, a model counts as so much better.
    visible : float, nats
        Evidence by which a model must exceed every part of itself for the search to go on from it (20 to 1); one that
        was not sampled may fall short of it by two standard errors.
    detour : int
        Causes that a set may have more than the best, on a way up without one of those that the best has. Such ways are
        gone where the best has more than `from_prior`.
    widened : int
        Models besides the best that get all their neighbours at most, where the tests of misfit fail by the best, and
        that has no more causes than `from_prior`.
    most_causes : int
        Causes of a model.
    short_draws, short_starts : int
        Of a short fit: draws of the prior that are looked at, and starts taken from them.
    short_climbs : tuple of (int, int)
        Of a short fit's optimisations on all readings: iterations, and how many of the highest go on after each.
    carried_trial, carried_climbs : tuple of (int, int)
        The same of optimisations from where others have their optima, on some of the readings and on all.
    short_tolerance : float
        Error of a simulator's step in a short fit; ranges are then good to 1e-5.
    tolerance : float
        Error of a simulator's step in a model that is sampled. Ranges are then good to a millionth (docs/numerics.md).
    doubt : float, nats
        Standard error of the evidence by a short fit.
    effects : RoundSettings
        Of draws of a model's posterior that are asked which of its causes show.
    missed : float
        Chance that a search never fits the set that would lead. It is a part of every probability that is printed. As
        measured for sets of one or two causes (docs/search-yardstick.md): k of n data sets missed by more than a nat
        give (k + 1/2)/(n + 1). With three it was tried on five data sets alone, and none was missed.
    """

    window: float = 5.0
    short_by: float = 6.0
    visible: float = 3.0
    detour: int = 1
    widened: int = 4
    most_causes: int = 6
    short_draws: int = 64
    short_starts: int = 4
    short_climbs: tuple[tuple[int, int], ...] = ((3, 2), (12, 1))
    carried_trial: tuple[tuple[int, int], ...] = ((0, 4), (3, 2), (12, 1))
    carried_climbs: tuple[tuple[int, int], ...] = ((0, 1), (6, 1))
    short_tolerance: float = 1e-3
    tolerance: float = 1e-4
    doubt: float = 1.0
    effects: RoundSettings = field(default_factory=lambda: RoundSettings(draws=32, least=1, effective=8.0, most=4))
    missed: float = 0.03
