"""Challenges: data with an effect hidden in them, and how well a diagnosis finds what it has not been told.

`hide` makes the data and seals the answer, `oracle` says how much the data hold, `campaign` runs many, `score` judges.
"""

EACH, NOTHING, PAIRS, DRAWN = 1, 40, 24, 46
"""Data sets of a campaign: of every cause and strength, with nothing hidden, of two causes, drawn from the priors."""
