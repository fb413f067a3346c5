"""Options of the search among causes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """How far a search looks, and how much work goes into a model; they belong to the identity of a result.

    Parameters
    ----------
    window : float, nats
        A model that shows is sampled, and its neighbours are fitted, as long as its log posterior probability comes
        this near to that of the best. It covers what a short fit may be below a model's true evidence.
    visible : float, nats
        Evidence by which a model must exceed every part of itself to show, that is to count as a model of its own (20
        to 1); one that was not sampled may fall short of it by two standard errors.
    most_causes : int
        Causes of a model.
    from_prior : int
        Causes up to which fits begin at draws of the prior by themselves, too; where more hold each other in place,
        none comes near a top.
    short_draws, short_starts : int
        Of a short fit: draws of the prior that are looked at, and starts taken from them.
    short_climbs : tuple of (int, int)
        Of a short fit's climbs on all readings: iterations, and how many of the highest go on after each.
    short_tolerance : float
        Error of a simulator's step in a short fit; ranges are then good to 1e-5.
    draws, starts : int
        Of each fit of a model that is sampled: draws of the prior that are looked at, and starts taken from them.
    tolerance : float
        Error of a simulator's step there. Ranges are then good to a millionth (docs/numerics.md).
    doubt : float, nats
        Standard error of the evidence by a short fit.
    missed : float
        Chance that a search never fits the set that would lead. It is a part of every probability that is printed. As
        measured (docs/search-yardstick.md): of n data sets k missed by more than a nat give (k + 1)/(n + 2).
    better : float, nats
        Rise of a log posterior by which a fit counts as another mode: models that rest on the old one are looked at
        again.
    """

    window: float = 8.0
    visible: float = 3.0
    most_causes: int = 6
    from_prior: int = 2
    short_draws: int = 64
    short_starts: int = 4
    short_climbs: tuple[tuple[int, int], ...] = ((3, 2), (12, 1))
    short_tolerance: float = 1e-3
    draws: int = 256
    starts: int = 12
    tolerance: float = 1e-4
    doubt: float = 1.0
    missed: float = 0.02
    better: float = 0.5
