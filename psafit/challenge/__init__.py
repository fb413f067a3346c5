"""Challenges: data with an effect hidden in them, and how well a diagnosis finds what it does not know.

`conditions` draws rigs and sweeps, `hide` makes the data and seals the answer, `oracle` says how much the data hold,
`campaign` runs many, `score` judges.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    """How many data sets of each kind a campaign has.

    Parameters
    ----------
    each : int
        Of every cause and strength.
    nothing, pairs : int
        With nothing hidden, and of two causes.
    drawn : int
        Drawn from the priors.
    designs : int
        One in so many data sets has a drawn rig and drawn sweeps; with 0 none has.
    """

    each: int = 1
    nothing: int = 100
    pairs: int = 24
    drawn: int = 46
    designs: int = 2
