"""Where in a table one trace ends and the next begins."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from itertools import pairwise


def blocks(keys: Sequence[Hashable], times: Sequence[float]) -> list[list[int]]:
    """The rows of each trace, traces in the order of their first rows.

    A trace begins where the time starts again, at or before the first of the trace, or where a condition changes. Where
    the time of the whole table never falls, the table is sorted by it, and rows of one condition are one trace.

    Parameters
    ----------
    keys : sequence of hashable
        Conditions of each row.
    times : sequence of float
        In any unit.
    """
    if all(b >= a for a, b in pairwise(times)):
        sorted_by_time: dict[Hashable, list[int]] = {}
        for row, key in enumerate(keys):
            sorted_by_time.setdefault(key, []).append(row)
        return list(sorted_by_time.values())
    found: list[list[int]] = []
    for row, (key, time) in enumerate(zip(keys, times, strict=True)):
        if row == 0 or key != keys[row - 1] or time <= times[found[-1][0]]:
            found.append([])
        found[-1].append(row)
    return found


def runs_on(parts: Sequence[Sequence[int]], times: Sequence[float]) -> int | None:
    """The first row of a trace whose time goes on from another's: a clock that runs through the table; None for none.

    Traces of one table are counted from starts of their own, so each begins before any other ends. Traces that are
    mixed row by row begin together, before the second sample of any.
    """
    parts = [part for part in parts if len(part) > 1]  # one sample alone shows no clock
    if len(parts) < 2:
        return None
    mixed = any(part[-1] - part[0] >= len(part) for part in parts)
    latest = max((part[0] for part in parts), key=lambda row: times[row])
    return latest if times[latest] > min(times[part[1 if mixed else -1]] for part in parts) else None


def rising(parts: Sequence[Sequence[int]], times: Sequence[float]) -> bool:
    """Whether each trace's time rises from sample to sample."""
    return all(times[a] < times[b] for part in parts for a, b in pairwise(part))
