r"""From a discrepancy without a name to a draft of a cause.

Where no cause explains the readings, what is left is described as a factor on one observable that departs from one
about a place on one axis: the drive frequency, the amplitude, or what is predicted of that observable,

.. math:: L_\mathrm{read} = L\, e^{s\,h}, \qquad h = e^{-\ln^2(x/x_0)/2w^2}.

It is smooth, and one where the axis tends to zero or infinity. Observable and axis are those where such a factor takes
up most of the discrepancy; traces, which are read over time, are none. All else in the file comes from the conditions:
priors span what was measured, and know nothing of the fit. So a diagnosis with ``--plugin draft_cause.py`` scores it on
held-out groups like any cause.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.diagnose.discrepancy import Discrepancy
from psafit.diagnose.judging import Judgement
from psafit.diagnose.record.misfit import Axis, Draft
from psafit.files import write_atomically
from psafit.inference.candidate import Candidate
from psafit.observables import OBSERVABLES, Observable, named, recorded_name
from psafit.physics import plugin
from psafit.simulate.contract import STUDY, of_ranges
from psafit.simulate.sensitivity import observe
from psafit.workers import scratch

FILE = "draft_cause.py"
TEMPLATE = Path(__file__).parent / "draft_cause.txt"
_SI = {"um": "m", "mm/s": "m/s", "us": "s", "N": "N"}


@dataclass(frozen=True)
class DraftSettings:
    """What is tried in a draft.

    Parameters
    ----------
    places : int
        Of the middle, evenly over the logarithm of what was measured.
    widths : int
        Evenly over their logarithm: from the usual step between conditions to half of what was measured.
    share : float
        Of the discrepancy's squares at all readings that a draft must take up: half, so that it describes more than it
        leaves.
    """

    places: int = 50
    widths: int = 12
    share: float = 0.5


def drafted(judgement: Judgement, folder: Path) -> Draft | None:
    """Draft a cause where a verdict is unexplained: added to the causes, or in their place where that is simpler."""
    if judgement.verdict.verdict != "unexplained":
        return None
    if judgement.verdict.unexplained_by == "structure" or not judgement.verdict.named:
        return draft(judgement.model_set.best_model, judgement.left, folder)
    found = draft(judgement.model_set.baseline, judgement.bare, folder)
    return found and replace(found, added=False)


def draft(candidate: Candidate, left: Discrepancy, folder: Path, settings: DraftSettings | None = None) -> Draft | None:
    """Describe what a model leaves, and write it as a cause.

    None where the readings do not ask for a discrepancy, or no axis takes up enough of it.

    Parameters
    ----------
    candidate : Candidate
        The model to which the discrepancy was added.
    left : Discrepancy
    folder : Path
        Where `draft_cause.py` goes; `draft_cause_2.py` and so on where another is there, which somebody may have
        edited.
    settings : DraftSettings, optional
    """
    settings = settings or DraftSettings()
    design = candidate.problem.design
    whole = _squares(left, design.measured)
    if left.log_bayes <= 0 or whole == 0:
        return None
    axes: dict[Axis, FloatArray] = {
        "frequency": design.frequency, "amplitude": design.amplitude, "range": candidate.predicted,
    }  # fmt: skip
    best: tuple[Draft, FloatArray, tuple[float, float]] | None = None
    for k, (axis, values) in itertools.product(np.unique(design.measured), axes.items()):
        rows = (design.measured == k) & np.isfinite(left.sd) & (values > 0)
        if not OBSERVABLES[k].traced and rows.sum() > 3 and np.ptp(x := np.log(values[rows])) > 0:
            widths = _widths(x, design.group[rows])
            found = _described(OBSERVABLES[k], axis, x, left.mean[rows], widths, whole, settings)
            best = (found, x, widths) if best is None or found.share > best[0].share else best
    if best is None or best[0].share < settings.share:
        return None
    chosen, x, widths = best
    text = _text(chosen, x, widths).encode()
    path = next(p for p in _names(folder) if not p.exists() or p.read_bytes() == text)
    write_atomically(path, text)
    return replace(chosen, file=path.name)


def _names(folder: Path) -> Iterator[Path]:
    """Where a draft may go: ``draft_cause.py``, ``draft_cause_2.py`` and so on."""
    first = folder / FILE
    yield first
    for k in itertools.count(2):
        yield first.with_stem(f"{first.stem}_{k}")


def _squares(left: Discrepancy, measured: NDArray[np.signedinteger]) -> float:
    """Squares of a discrepancy at all readings that show one, apart from a factor common to each observable."""
    seen = np.isfinite(left.sd)
    each = (left.mean[seen & (measured == kind)] for kind in np.unique(measured[seen]))
    return float(sum(np.sum((y - y.mean()) ** 2) for y in each))


def _widths(x: FloatArray, group: NDArray[np.signedinteger]) -> tuple[float, float]:
    """The narrowest and the widest departure that readings at the logarithms `x` can show.

    The first is the mean step along the sweeps that go along the axis, or, where none does, between all places.
    """
    sweeps = [np.unique(x[group == g]) for g in np.unique(group)]
    along = [at for at in sweeps if at.size > 1] or [np.unique(x)]
    narrow = sum(map(float, map(np.ptp, along))) / sum(at.size - 1 for at in along)
    return narrow, max(_half(x), 2.0 * narrow)


def _half(x: FloatArray) -> float:
    return max(0.5 * float(np.ptp(x)), math.log(2.0))


def _described(
    observable: Observable,
    axis: Axis,
    x: FloatArray,
    y: FloatArray,
    ends: tuple[float, float],
    whole: float,
    settings: DraftSettings,
) -> Draft:
    """The factor on one axis that takes up most of a discrepancy, apart from one common to all; `x` is a logarithm.

    Its width lies between the `ends`.

    How large it is: by what readings differ that it changes most and least. Between readings it may be anything. Its
    share is of the `whole` squares.
    """
    y = y - y.mean()
    read = recorded_name(observable)
    widths = np.geomspace(*ends, settings.widths).tolist()
    best = Draft(FILE, axis, math.exp(float(x[0])), 1.0, widths[0], 0.0, observable=read)
    for place in np.linspace(x.min(), x.max(), settings.places):
        for width in widths:
            bump = np.exp(-0.5 * ((x - place) / width) ** 2)
            own = bump - bump.mean()
            size = float(own @ own)
            if size < 1e-9:
                continue
            strength = float(own @ y) / size
            share = strength * float(own @ y) / whole
            if share > best.share:
                factor = math.exp(strength * float(np.ptp(bump)))
                best = replace(best, place=math.exp(float(place)), factor=factor, width=width, share=share)
    return best


def _text(found: Draft, x: FloatArray, widths: tuple[float, float]) -> str:
    """The file's text for what was read at the logarithms `x`; its symptom is worked out as `check-cause` does."""
    o = named(found.observable)
    unit, scale = {"frequency": ("Hz", 1.0), "amplitude": ("V", 1.0), "range": (_SI[o.unit], 1.0 / o.scale)}[found.axis]
    half, (narrow, widest) = _half(x), widths
    middle = math.exp(0.5 * (float(x.min()) + float(x.max()))) * scale
    place, reach = f"{float(f'{found.place * scale:.3g}'):g} {unit}", f"{math.exp(found.width):.3g}"
    text = _filled(
        TEMPLATE.read_text("utf-8"), axis=o.title if found.axis == "range" else found.axis, kind=found.axis, unit=unit,
        observable=o.name, title=o.title, titles=o.titles, middle=f"{middle:.3g}", factor=f"{math.exp(half):.3g}",
        least=f"{middle * math.exp(-2 * half):.3g}", most=f"{middle * math.exp(2 * half):.3g}",
        narrow=f"{0.25 * narrow:.3g}", wide=f"{4.0 * widest:.3g}", width=f"{math.sqrt(narrow * widest):.3g}",
        spread=f"{max(math.sqrt(widest / narrow), 2.0):.3g}",
        found=f"a factor of {found.factor:.3g} at {place}, within a factor of {reach} to either side",
    )  # fmt: skip
    with scratch() as folder:
        first = folder / FILE
        first.write_text(_filled(text, sign="0", over_frequency="mixed", over_amplitude="mixed"), "utf-8")
        shown = observe(of_ranges(plugin.read(first)), STUDY)
    return _filled(text, sign=str(shown.sign), over_frequency=shown.frequency, over_amplitude=shown.amplitude)


def _filled(text: str, **values: str) -> str:
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    return text
