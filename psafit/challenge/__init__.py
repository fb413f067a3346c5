"""Challenges: data with an effect hidden in them, and how well a diagnosis finds what it has not been told.

`hide` makes the data and seals the answer, `oracle` says how much the data hold, `campaign` runs many, `score` judges.
"""
