"""How a statement names causes, groups and numbers: as plain text here, otherwise where somebody overrides it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from psafit.experiment import GroupId
from psafit.text import fixed, percent, prefixed, series, set_name, significant, span_text, with_unit

NO_ACTION: Final = "does not act on what was read"
"""What is said of a cause that acts on no drive of the readings, or changes only what was not read."""


class Words:
    """Plain text: causes by their identifiers."""

    experiment = "EXP"
    """What stands for the experiment's folder in a command."""

    options = ""
    """What a command needs besides."""

    def put(self, template: str, *parts: object) -> str:
        """Return a sentence with its parts in place."""
        return template.format(*parts)

    def causes(self, ids: Sequence[str]) -> str:
        """Return a set of causes."""
        return set_name(ids)

    def cause(self, id: str) -> str:
        """Return one cause."""
        return id

    def parameter(self, name: str) -> str:
        """Return a parameter."""
        return name

    def groups(self, ids: Sequence[GroupId]) -> str:
        """Return some groups: ``group 1``, ``groups 1 and 2``."""
        return self.put("group {}" if len(ids) == 1 else "groups {}", self.listed(map(str, ids)))

    def listed(self, items: Iterable[object]) -> str:
        """Return ``a, b and c``."""
        return series(items)

    def joined(self, by: str, items: Iterable[object]) -> str:
        """Return items with a separator between them."""
        return by.join(map(str, items))

    def choices(self, items: Sequence[object]) -> str:
        """Return ``a; or b; or c.``, of what excludes each other; the end of a sentence."""
        return self.put("{}.", self.joined("; or ", items))

    def number(self, text: str) -> str:
        """Return a number, perhaps with its unit, that is text already."""
        return text

    def code(self, text: str) -> str:
        """Return a command."""
        return text

    def fit_command(self, groups: Sequence[GroupId], terms: Sequence[str]) -> str:
        """Return the command that fits some causes to some groups."""
        chosen = f"--group {','.join(map(str, groups))} --terms {','.join(terms)}"
        return self.code(f"psafit fit {self.experiment} {chosen} {self.options}".rstrip())

    def per_cent(self, fraction: float) -> str:
        """Return a share in whole per cent; never 0 or 100 unless it is."""
        return percent(fraction)

    def size(self, name: str, unit: str, median: float, ends: tuple[float, float] | None) -> str:
        """Return a parameter's value with its interval."""
        return f"{name} = {self.value(unit, median, ends)}"

    def value(self, unit: str, median: float, ends: tuple[float, float] | None) -> str:
        """Return a value with its interval."""
        unit, (median, *both) = prefixed(unit, median, *(ends or ()))
        middle, *interval = map(significant, (median, *both))
        return with_unit(f"{middle} ({' to '.join(interval)})" if interval else middle, unit)

    def span(self, unit: str, ends: tuple[float, float]) -> str:
        """Return where a value may lie."""
        return span_text(unit, ends)

    # What follows is made of the above.

    def instead(self, named: Sequence[str], ids: Sequence[str], large: int = 3) -> str:
        """Return a set as good as what is `named`: by what is exchanged, if that is shorter and `named` is `large`."""
        gone, new = ([id for id in one if id not in other] for one, other in ((named, ids), (ids, named)))
        if len(named) < large or len(gone) + len(new) > 2 or not ids:
            return self.causes(ids)
        if not gone:
            return self.put("these and {}", self.causes(new))
        if not new:
            return self.put("these without {}", self.causes(gone))
        return self.put("{} in the place of {}", self.causes(new), self.causes(gone))

    def named_before(self, ids: Sequence[str], large: int = 3) -> str:
        """Return the set that an answer names first: by its causes, if they are fewer than `large`."""
        return self.causes(ids) if len(ids) < large else self.put("the set named first")

    def nats(self, value: float) -> str:
        """Return nats with one digit behind the point."""
        return self.number(f"{fixed(value, 1)} nats")

    def share(self, value: float, least: float = 0.01, nothing: float = 1e-5) -> str:
        """Return a probability: in whole per cent, with two digits below `least`; not below `nothing`, which says that.

        What is less hangs on the tails of priors and scatter, which nobody knows.
        """
        if 0.0 < value < nothing:
            return self.put("under {}", self.fraction(nothing))
        return self.per_cent(value) if value >= least else self.fraction(value)

    def fraction(self, value: float) -> str:
        """Return a small share in per cent, with two digits."""
        return self.number(f"{significant(value, 2, per_cent=True)} %")


PLAIN = Words()
