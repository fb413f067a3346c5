"""The groups of a diagnosis with what its models say of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.compare import Predicted, read_predictions
from psafit.diagnose.record import Diagnosis
from psafit.diagnose.show import Line
from psafit.experiment import Experiment, Group
from psafit.report import figures
from psafit.report.catalogue import TITLES
from psafit.report.page import figure_data_uri
from psafit.report.wording import factor
from psafit.validate import log_ratio, root_mean_square, tables_at

_LOOKS: Final = {"baseline": ("baseline", "grey"), "extended": ("extended model", "vermillion")}


@dataclass(frozen=True, eq=False)
class Shown:
    """A group with what the models say of it.

    Parameters
    ----------
    group : Group
    sweep : Sweep
    curves : list of Curve
        Baseline and extended model, as far as they are on record.
    errors : list of float
        Of each: root mean square of ln((predicted + 0.3 um)/(measured + 0.3 um)).
    more : list of Curve
        What else is on record, to be switched on.
    rows : (n_points,) int array
        Places of its readings in what the record holds one group after the other.
    """

    group: Group
    sweep: figures.Sweep
    curves: list[figures.Curve]
    errors: list[float]
    more: list[figures.Curve]
    rows: NDArray[np.intp]

    @property
    def text(self) -> str:
        """By what factor each model is off."""
        return "; ".join(f"{c.name} off by ×{factor(e)}" for c, e in zip(self.curves, self.errors, strict=True))

    @property
    def title(self) -> str:
        """The group and what is held."""
        return f"Group {self.group.id}: {self.sweep.held}"

    @property
    def name(self) -> str:
        """The group and, where several observables are shown, what is read."""
        return f"{self.group.id} ({self.sweep.read})" if self.sweep.read else str(self.group.id)


def shown_groups(result: Diagnosis, experiment: Experiment, folder: Path) -> list[Shown]:
    """The groups of the record with the models' predictions, which the record holds one group after the other."""
    members = experiment.select(result.groups)
    n = sum(g.n_points for g in members)
    models = {name: np.asarray(model.predicted, dtype=float) for name, model in result.show.items()}
    adopted = _predicted(result.table(folder, result.predictions))
    strict = result.gain.get("strict")
    unseen = _predicted(result.table(folder, strict.predictions), "extended") if strict else {}
    extended = result.show.get("extended")
    each = {id: np.asarray(v, dtype=float) for id, v in (extended.without if extended else {}).items()}
    without = {id: ranges for id, ranges in each.items() if ranges.size == n}
    lines = {model: {line.of: line for line in show.lines} for model, show in result.show.items()}
    starts = np.cumsum([0, *(g.n_points for g in members)])
    found = []
    parts = [(whole, part) for whole in members for part in whole.parts]
    sweeps = figures.sweeps_of([part for _, part in parts])
    for (whole, group), abscissa in zip(parts, sweeps, strict=True):
        part = starts[members.index(whole)] + np.flatnonzero(whole.measured == group.measured[0])
        name, sweep = group.label, (str(group.id), group.observable.name)
        looks = {model: _LOOKS.get(model, (model, "purple")) for model, values in models.items() if values.size == n}
        last = "extended" if "extended" in looks and result.verdict != "adequate" else "baseline"
        curves = {
            model: figures.Curve(
                *look,
                models[model][part],
                _band(adopted.get(name), group.n_points) if model == last else (),
                dashed=model == "baseline",
                line=_line(lines[model].get(sweep)),
            )
            for model, look in looks.items()
        }
        shown = [curve for model, curve in curves.items() if model in _LOOKS]
        more = [curve for model, curve in curves.items() if model not in _LOOKS]
        if band := _band(unseen.get(name), group.n_points):
            more.append(figures.Curve("extended model without this group", "blue", unseen[name].median, band))
        finer = {id: _line(lines["extended"].get(sweep), id) for id in without}
        more += figures.without_curves({id: ranges[part] for id, ranges in without.items()}, TITLES, finer)
        errors = [root_mean_square(log_ratio(c.middle, group.reading, *group.observable.metric)) for c in shown]
        found.append(Shown(group, abscissa, shown, errors, more, part))
    return found


def _predicted(path: Path, model: str | None = None) -> dict[str, Predicted]:
    """What tables in the folder of the record say of each group; nothing where there are none."""
    return {t.group.label: t for t in read_predictions(path, model)} if tables_at(path) else {}


def _band(given: Predicted | None, n: int) -> tuple[figures.Band, ...]:
    return (figures.Band(figures.READING_BAND, given.lower, given.upper),) if given and given.lower.size == n else ()


def _line(given: Line | None, gone: str | None = None) -> tuple[FloatArray, FloatArray] | None:
    """What a record says between the readings of a group, with all causes or without one; a sweep of two is none."""
    if given is None:
        return None
    at, value = np.asarray(given.at), np.asarray(given.value if gone is None else given.without[gone], dtype=float)
    return (at, value) if np.isfinite(value).all() else None


def image(figure: Figure, n: int) -> str:
    """Image of one of `n` of a kind, which are simpler than those of a fit."""
    return figure_data_uri(figure, like=n, few=12)
