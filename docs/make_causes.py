"""Write docs/causes.md and its figures from the declarations and the simulator.

`--text` leaves the figures alone.
"""

from __future__ import annotations

import io
import itertools
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import subspace_angles

from psafit.experiment import Group, read_experiment
from psafit.physics import TERMS
from psafit.physics.term import DRIVES, SLOTS, Term
from psafit.records import CauseEntry
from psafit.simulate import Design
from psafit.simulate.catalogue import declaration
from psafit.simulate.sensitivity import REFERENCE, Effect, UsualScatter, effect, plausible, reading_slopes

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "causes.md"
FIGURES = ROOT / "docs" / "figures" / "causes"
PSA = read_experiment(ROOT / "experiments" / "psa")
# What lies between these two comes from the simulator, not from the declarations alone.
BEGIN, END = "<!-- from the simulator -->", "<!-- end -->"
# Pairs nearer than this are named and numbered.
NEAR = 25.0

INTRODUCTION = """\
# The candidate causes

A *cause* is a piece of physics that the study's model leaves out and that may explain where its predictions fail.
This page is generated from the causes' own files by `python docs/make_causes.py`; `psafit terms` prints the same.

Every cause sits in a slot of the rig:

- the **drive**, from the command to the voltage;
- the **stack**, from the voltage to the tip;
- the **contact**, from the tip to the ball;
- the **flight**, from the separation to the turn of the swing;
- the **reading**, from the swing to the number written down.

At the neutral value of its first parameter it vanishes exactly, and the model is the study's. Bounds say what is
possible, the prior what is plausible, and its source why. Priors of strengths have a broad part of 5 %: a value far
beyond the plausible costs a dozen nats and is flagged, it is not forbidden. Each cause says how probable it is to be at
work before any reading; the prior over sets follows. *Checked by hand* are sums that the code must reproduce; they are
nothing to measure.

Where no cause acts in contact in a way that bends the equations of motion, the launch has a closed form, without any
time step; otherwise the stepper follows the motion (see [numerics.md](numerics.md)). Either is compared with a scalar
reference that shares no code with it.

## Adding a cause

Write one file in `psafit/physics/` and add it to the registry in `psafit/physics/__init__.py`: one import, and its
place in the slot's line. Nothing else changes; the contract in `tests/physics/test_causes.py` takes it up by itself.
The smallest cause there could be, a contact stiffer than assumed by a factor:

```python
r\"\"\"A contact stiffer than fitted elsewhere.

.. math:: k_c \\to r\\, k_c.

Why, from where, and what is assumed.
\"\"\"

import numpy as np

from psafit.parameters import Bounds, LogNormal, Parameter
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, Symptom, Term


def setup(rig, p):  # for all parameter sets at once: p is (n_sets, n_parameters)
    \"\"\"Scale the stiffness.\"\"\"
    return rig.change(k_c=rig.k_c * p[:, 0])


def literal(rig, p):  # the same for the scalar reference
    \"\"\"Stiffness ``r k_c``.\"\"\"
    rig.k_c *= p[0]


TERM = Term(
    id="stiffer_contact",
    slot="contact",
    title="stiffer contact",
    equation=r"k_c \\to r\\, k_c",
    description=__doc__,
    parameters=(
        Parameter(
            name="stiffer_contact_r",
            symbol="r",
            unit="1",
            bounds=Bounds(0.5, 2.0),
            prior=LogNormal(1.0, 1.2),
            description="factor on k_c",
            source="where the prior comes from",
            neutral=1.0,
        ),
    ),
    symptom=Symptom("what it does, in words", sign=0, frequency="mixed", amplitude="flat"),
    reference="a book or a paper",
    checks=(Check("2 x 0.1425 N/um = 0.285 N/um", lambda: setup(plain_rig(), np.array([[2.0]])).k_c[0], 2.85e5),),
    literal=literal,
    setup=setup,
)
```

Instead of, or together with, changing a number of the rig (`setup`), a cause may put a function into a slot: `law`
(contact force), `stack_factor` and `branch` (stroke and hysteresis), `deceleration` and `swing_offset` (flight),
`reading`. `psafit/physics/term.py` says what each receives and returns.
"""

NOTATION = """\
## Notation

| symbol | meaning |
|---|---|
| $u$, $V_a$, $f$ | voltage; amplitude and frequency of the command |
| $x_1$, $x_2$, $d$ | place of tip and ball; indentation |
| $v$ | speed of the ball at separation |
| $m$, $M$ | mass of stack and ball |
| $k_s$, $c_s$; $k_c$, $c_c$ | stiffness and damping of the stack; of the contact |
| $q$, $l$, $L$ | free stroke per volt; string; launch range |

In the symptom, the trends are those of the size of the relative change of the launch range: whether it grows or falls
with frequency (0.1-25 kHz) and with voltage (1-20 V). They hold on three rigs: the study's, a hard contact on a stack
with little damping, and one on a damped stack. They are "mixed" where these, or sine and square, differ. `observe` in
`psafit/simulate/sensitivity.py` has the definitions and computes them; a test compares.

In the figures the baseline has the study's parameters (Table 3). The cause has a strength that its prior expects to be
exceeded as often as not. Above each panel stand the least and the greatest change of the launch range in each group
(−100 %: no launch, or almost none).
"""


# --- text -------------------------------------------------------------------------------------------


def markdown(body: str) -> str:
    """Turn the reStructuredText of the declarations, which is little, into GitHub's Markdown."""
    blocks = []
    for block in body.split("\n\n"):
        text = block
        if block.startswith(".. math::"):
            lines = [line.strip() for line in block.removeprefix(".. math::").strip().splitlines()]
            text = "$$\n" + "\n".join(lines) + "\n$$"
        else:
            text = re.sub(r":math:`([^`]*)`", lambda m: f"${' '.join(m[1].split())}$", text)
            text = text.replace("``", "`")
        blocks.append(text)
    return "\n\n".join(blocks)


def number(x: float) -> str:
    return f"{x:.4g}".replace("e-0", "e-").replace("e+0", "e")


def cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def contents(entries: Sequence[CauseEntry]) -> Iterator[str]:
    yield "| cause | slot | what | parameters | neutral | simulated by |"
    yield "|---|---|---|---|---|---|"
    for e in entries:
        symbols = ", ".join(f"${p.symbol}$" + (f" ({p.unit})" if p.unit != "1" else "") for p in e.parameters)
        neutral = number(e.parameters[0].neutral or 0.0)
        yield f"| [{e.id}](#{e.id}) | {e.slot} | {cell(e.title)} | {symbols} | {neutral} | {e.path} |"


def section(e: CauseEntry) -> Iterator[str]:
    title = e.title if e.title[:1].isupper() else e.title[:1].upper() + e.title[1:]
    yield f"### {e.id}"
    yield f"**{title}.** {markdown(e.description)}"
    table = ["| parameter | | unit | neutral | possible | plausible (prior) |", "|---|---|---|---|---|---|"]
    parameters = [*e.parameters, *([e.latent] if e.latent else [])]
    for p in parameters:
        neutral = "" if p.neutral is None else number(p.neutral)
        bounds = f"{number(p.bounds[0])} to {number(p.bounds[1])}"
        each = ", one for each session" if p is e.latent else ""
        table.append(
            f"| ${p.symbol}$ | {cell(p.description)}{each} (`{p.name}`) | {p.unit} | {neutral} | {bounds} | {p.prior} |"
        )
    yield "\n".join(table)
    yield "\n".join(f"- *Prior of* ${p.symbol}$: {cell(p.source)}." for p in parameters)
    why = cell(e.because) or "a surprise, like most causes"
    yield f"*At work, before any reading:* probability {number(e.probability)}; {why}."
    if e.look:
        yield f"*To see it without launches:* {cell(e.look)}."
    s = e.symptom
    sign = {1: "raises the range", -1: "lowers the range", 0: "may raise or lower the range"}[s.sign]
    on = " and ".join(f"{name}s" for name in s.waveforms)
    acts = "" if e.drives == "every" else f" It {DRIVES[e.drives]}."
    yield (
        f"*Symptom:* {cell(s.text)}. On {on}, a larger value {sign}; its relative effect with"
        f" frequency: {s.frequency}; with voltage: {s.amplitude}.{acts}"
    )
    if e.reads:
        yield f"*Changes the readings of:* {', '.join(f'`{name}`' for name in e.reads)}."
    yield f"![Effect of {e.id} on the six groups](figures/causes/{e.id}.png)"
    yield f"*Reference:* {cell(e.reference)}."
    yield "*Checked by hand:*\n\n" + "\n".join(f"- {cell(check)}" for check in e.checks)


def likeness() -> Iterator[str]:
    """What the simulator says of the causes' likeness: not from the declarations."""
    six, first = six_groups(), first_group()
    yield "![Which causes are confounded](figures/causes/confounded.png)"
    for name, found in (("Group 1 alone", first), ("All six groups", six)):
        absorbed, idle = (
            [f"`{id}`" for id, s in zip(found.ids, found.status, strict=True) if s == kind]
            for kind in ("absorbed", "idle")
        )
        yield (
            f"**{name}.** The refit absorbs {listed(absorbed)}. At a plausible strength too small to be seen:"
            f" {listed(idle)}."
        )
    reported = [
        f"`{id}`" for id, one, all_six in zip(first.ids, first.status, six.status, strict=True)
        if all_six == "visible" != one
    ]  # fmt: skip
    yield f"What the amplitude sweeps and the square waves add: they bring out {listed(reported)}, and part most pairs."
    rows = ["| confounded in group 1 or in all six | group 1 | all six |", "|---|---|---|"]
    pairs = itertools.combinations(range(len(six.ids)), 2)
    angles = [(float(six.angle[i, j]), float(first.angle[i, j]), i, j) for i, j in pairs]
    for all_six, one, i, j in sorted(a for a in angles if a[0] < NEAR or a[1] < NEAR):
        cells = ["not seen" if np.isnan(a) else f"{a:.0f}°" for a in (one, all_six)]
        rows.append(f"| `{six.ids[i]}`, `{six.ids[j]}` | {cells[0]} | {cells[1]} |")
    yield "\n".join(rows)


def listed(items: Sequence[str]) -> str:
    return "nothing" if not items else items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"


LIKENESS = """\
## Which causes are confounded

A cause shows only by what a refit of $k_c$, $c_s$ and $c_c$ cannot imitate. For every cause the change of all launch
ranges, in units of a scatter of 5 % and 0.3 µm, is freed of the baseline's own three directions. The angle between what
is left of two causes says whether the data could separate them: 0° never, 90° easily, given enough of an effect.

The refit is linear, about the study's parameters, and strengths are plausible ones: a guide to what to measure, not a
verdict on given data.
"""

APART = """\
What stays close with all six groups needs another kind of measurement. A ball that leans by $x_0$ is held back by the
constant deceleration $g x_0/l$, as by a friction $a_s$: `preload` and `sliding_support` differ by how the ball sits
before the launch, and by whether it swings back. Lean it on purpose by a known amount, or watch the free swing: its
decay shows friction but no lean.

A frequency sweep at one voltage cannot show what bends the growth with the voltage, nor a single session its own gain.
`stroke_tolerance`, `amplitude_scale` and `swing_drag` scale all ranges in the same way and `stack_stiffness` acts
through its ratio to the damping, so that $k_c$, $c_s$ and $c_c$ make up for them: measure the stroke of the free tip
with the vibrometer, and how a swing decays.
"""


LEFT_OUT = r"""
## What is not in the catalogue

Estimated for the study's rig (27 g of steel, radius 9.4 mm, contact forces of 1 to 5 N) and left out. The estimates are
made by hand, or by an integration that is named, and no test repeats them. They are to be held against a scatter of 5 %
and 0.3 um, which is more than each of them.

- **Spin.** Struck by a face tilted by $\theta$ and held by friction, the ball has along the drive
  $\cos^2\theta + \tfrac27 \sin^2\theta$ of its speed: 0.5 % less at 5 degrees, 2 % at 10. It is a factor of all ranges
  of a session, as in `reading_gain`.
- **Force acting back on the voltage.** A force frees the charge $q F$, 0.12 uC/N: 0.08 V/N on 1.5 uF without a source.
  That is 0.4-2 % of 20 V at 1 to 5 N, and less with a source of 50 ohm, which drains it within 75 us.
- **Bending of the stack.** A ball $e$ off the axis of a stack of width $b$ adds $12 e^2/b^2$ of the stack's compliance:
  48 % for 1 mm and 5 mm, 1e-8 m/N. Compared with the 3e-7 m/N of a contact of 3e6 N/m that is 3 %, which $k_c$ takes
  up.
- **Plastic contact.** Hertz's greatest pressure of steel on PZT is 0.28 GPa at 5 N. Yield begins at 1.6 times the yield
  stress, above 1 GPa in either.
- **Stretch of the string.** 0.26 N on nylon of 0.2 mm (1 kN/m at 90 mm) is 0.3 % of the length and 0.14 % of the range.
  Its bounce, at 31 Hz, is driven by a pull that stays the same to 1e-5.
- **Temperature.** 10 K are 0.04 % by the string. The stroke of soft PZT grows by 0.1-0.3 % per K (from memory): at most
  3 %, a factor of all ranges.
- **Capacity that grows with the field.** $\tau_a (1 + \beta |u|)$ with $\beta$ = 0.006 1/V, 12 % at 20 V, as the stroke
  grows. Integrated with SciPy over 0.3-8 kHz at 5 and 20 V: once a constant $\tau_a$ is refitted (77 us for 75), ranges
  differ by 0.4 % on the study's rig and 0.8 % on a damped one, by 1.3 % at most.

## What is not modelled and may show

By their own estimates these are not negligible, for the same rig. No cause describes them. Where one is at work, tests
may find structure, and another cause may take its place.

- **Squeeze film** of air between ball and face. It takes $6 \pi \eta R^2/M$ = 1.1 um/s of the ball's speed for every
  factor e by which the gap grows, whatever the speed. The swing was integrated with it, from a gap of 0.1 to 1 um
  (roughness). Ranges of 260, 100, 26 and 4 um come out 0.2-0.3 %, 0.5-0.7 %, 1.2-2.1 % and 4-9 % lower. For ranges of
  a few micrometres that looks like an absolute scatter of 0.1-0.4 um. *What would show it:* the same weak launches from
  a polished and from a roughened face, or in a vacuum.
- **Seat that differs from launch to launch.** Gaps that scatter by 0.1 um (half-normal) scatter the ranges by the same
  number of micrometres at every voltage, as the absolute scatter does, and lower their mean, as `gap` does. On the
  study's rig that is 4-6 um at 0.3-2 kHz and 0.6-2 um at 8 kHz; on harder ones 5-50 um. What no cause describes is only
  how it changes with frequency: readings may fail the tests of the spread. *What would show it:* twenty launches each
  at 0.5 and at 8 kHz, the ball hung still anew before each.
- **Creep of the stack.** After a step of the voltage the stroke goes on growing with the logarithm of time,
  $1 + \gamma \log_{10}(t/0.1\,\mathrm{s})$ with $\gamma$ = 0.01-0.02 (Physik Instrumente, Piezo tutorial, read). If the
  law holds at shorter times, which that source does not say, a sweep from 0.1 to 25 kHz has 2-5 % more stroke at its
  slow end, smoothly. Ranges that go with the square of the speed have twice that. $c_s$, a lag or a `frame_compliance`
  may take it up. *What would show it:* the stroke of the free tip at one voltage, at 10 Hz and at 5 kHz.
"""


def page(computed: str) -> str:
    """The whole page; `computed` stands between the marks."""
    entries = [declaration(t) for t in TERMS]
    parts = [INTRODUCTION, "## Contents", "\n".join(contents(entries)), NOTATION, LIKENESS]
    parts += [f"{BEGIN}\n\n{computed}\n\n{END}", APART]
    for slot in SLOTS:
        parts.append(f"## {slot.capitalize()}")
        parts += [text for e in entries if e.slot == slot for text in section(e)]
    return "\n\n".join(part.strip() for part in [*parts, LEFT_OUT]) + "\n"


# --- what the simulator says -------------------------------------------------------------------------


@dataclass(frozen=True)
class Confounding:
    """Which causes are confounded once the baseline has been refitted.

    Parameters
    ----------
    ids : list of str
    angle : (n, n) array, degrees
        Between what is left of two effects: 0 where one can be had for the other, 90 where they have nothing in common,
        NaN where one of them leaves nothing. Of several directions (one a session) it is the smallest.
    status : list of str
        "visible"; "absorbed" where the refit leaves less than one standard deviation of the scatter; "idle" where there
        was no more than that before.
    """

    ids: list[str]
    angle: np.ndarray[Any, Any]
    status: list[str]


def confounding(design: Design) -> Confounding:
    """Compare all causes by what a linear refit of the baseline cannot imitate."""
    size = effect(TERMS[0], design).neutral * 1e6
    scatter = np.hypot(UsualScatter.absolute_m * 1e6, UsualScatter.relative * size)
    known = spanned(np.where(size > 0, reading_slopes(design, REFERENCE) / scatter, 0.0), 1e-9)
    status, left = [], []
    for term in TERMS:
        shift = effect(term, design).deviation
        rest = shift - (shift @ known.T) @ known
        before, after = np.linalg.norm(shift), np.linalg.norm(rest)
        status.append("idle" if before < 1.0 else "absorbed" if after < 1.0 else "visible")
        # A direction is one only if the scatter leaves it visible.
        least = 1.0 / np.linalg.norm(rest, 2) if status[-1] == "visible" else np.inf
        left.append(spanned(rest, least))
    angle = np.full((len(TERMS), len(TERMS)), np.nan)
    for i, one in enumerate(left):
        for j, other in enumerate(left):
            if len(one) and len(other):
                angle[i, j] = np.degrees(subspace_angles(one.T, other.T).min())
    return Confounding([t.id for t in TERMS], angle, status)


def spanned(rows: np.ndarray[Any, Any], least: float) -> np.ndarray[Any, Any]:
    """Orthonormal rows that span the given ones; those smaller than `least` times the largest are left out."""
    _, size, directions = np.linalg.svd(rows, full_matrices=False)
    return directions[size > least * size.max()]


def first_group() -> Confounding:
    return confounding(Design.of(PSA.constants, PSA.groups[:1]))


def six_groups() -> Confounding:
    return confounding(Design.of(PSA.constants, PSA.groups))


def sweep(group: Group, n: int = 161) -> tuple[np.ndarray[Any, Any], Design, bool]:
    """A dense sweep over a group's range: its variable, its conditions, and whether the frequency is swept."""
    f, v = group.frequency_hz, group.amplitude_v
    by_frequency = bool(np.ptp(f) > 0)
    x = np.geomspace(f.min(), f.max(), n) if by_frequency else np.linspace(v.min(), v.max(), n)
    frequency, amplitude = (x, v[0]) if by_frequency else (f[0], x)
    return x, Design.sweep(PSA.constants, group.waveform, frequency, amplitude), by_frequency


def strength_in_words(term: Term) -> str:
    units = {"m": (1e6, "µm"), "s": (1e6, "µs"), "N": (1e3, "mN"), "s/V": (1e6, "µs/V"), "m/s^2": (1.0, "m/s²")}
    words = []
    for p, value in zip(term.parameters, plausible(term), strict=True):
        factor, unit = units.get(p.unit, (1.0, p.unit))
        words.append(f"${p.symbol}$ = {float(f'{value * factor:.2g}'):g}" + (f" {unit}" if unit != "1" else ""))
    return ", ".join(words)


def change_in_words(found: Effect) -> str:
    """The least and the greatest change over one panel."""
    change = np.expm1(found.log_change[0])
    low, high = float(change.min()), float(change.max())
    largest = max(abs(low), abs(high))
    if largest < 5e-7:
        return "no change"

    def words(x: float) -> str:
        if abs(x) < 1e-3 * largest:
            return "0"
        if x >= 3.0:
            return f"×{float(f'{1 + x:.2g}'):g}"
        percent = f"{100 * x:+.0f}" if largest > 0.1 else f"{float(f'{100 * x:.2g}'):+g}"
        return percent.replace("-", "−") + " %"

    ends = [words(low), words(high)]
    if ends[0] == ends[1]:
        return ends[0]
    if ends[0].endswith(" %") and ends[1].endswith(" %"):
        ends[0] = ends[0].removesuffix(" %")
    return f"{ends[0]} to {ends[1]}"


# --- figures ------------------------------------------------------------------------------------------


def save(figure: Any, path: Path, colours: int = 64) -> None:
    """Write a PNG with a palette: flat colours need no more, and it is a third of the size."""
    from PIL import Image

    raw = io.BytesIO()
    figure.savefig(raw, dpi=110)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.open(raw).convert("RGB").quantize(colours).save(path, optimize=True)


def draw_cause(term: Term) -> None:
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator

    from psafit.report.style import PALETTE, figure_style, plain_log_ticks

    with figure_style():
        figure = Figure(figsize=(8.4, 5.1), layout="constrained")
        grid = figure.subplots(2, 3)
        for k, (axes, group) in enumerate(zip(grid.flat, PSA.groups, strict=True)):
            x, design, by_frequency = sweep(group)
            found = effect(term, design)
            below = found.neutral
            with_cause = np.where(found.launch_range[0] > 0, found.launch_range[0], np.nan)
            line = {"linewidth": 2.0, "solid_capstyle": "butt"}
            axes.plot(x, below * 1e6, color=PALETTE["sky"], linewidth=3.6, label="baseline")
            label = f"with {term.id}, {strength_in_words(term)}"
            if term.latent:
                axes.plot(x, with_cause * 1e6, color=PALETTE["vermillion"], **line, label=f"{label}, $z$ = ±1")
                other = effect(term, design, share=1 - 0.8413447460685429).launch_range[0]
                axes.plot(x, np.where(other > 0, other, np.nan) * 1e6, color=PALETTE["vermillion"], **line)
            else:
                axes.plot(x, with_cause * 1e6, color=PALETTE["vermillion"], **line, label=label)
            axes.set_yscale("log")
            top, bottom = 2.2 * below.max() * 1e6, max(0.3 * below.min() * 1e6, 0.06)
            top = max(top, 1.3 * np.nanmax(with_cause) * 1e6) if np.isfinite(with_cause).any() else top
            bottom = (
                min(bottom, max(0.06, 0.8 * np.nanmin(with_cause) * 1e6)) if np.isfinite(with_cause).any() else bottom
            )
            axes.set_ylim(bottom, top)
            axes.set_xlim(x[0], x[-1])
            missing = np.isnan(with_cause)
            if missing.any():
                at = x[missing]
                axes.plot(
                    [at[0], at[-1]], [bottom, bottom], color=PALETTE["vermillion"], linewidth=5, clip_on=False,
                    solid_capstyle="butt",
                )  # fmt: skip
                if len(at) > 0.25 * len(x):
                    middle = np.sqrt(at[0] * at[-1]) if by_frequency else 0.5 * (at[0] + at[-1])
                    axes.annotate(
                        "no launch", (middle, bottom), (0, 6), textcoords="offset points", ha="center", fontsize=9,
                        color=PALETTE["vermillion"],
                    )  # fmt: skip
            if by_frequency:
                axes.set_xscale("log")
                axes.set_xlabel("Drive frequency (Hz)")
                what = f"{group.waveform}, {group.amplitude_v[0]:g} V"
            else:
                axes.set_xlabel("Drive amplitude (V)")
                what = f"{group.waveform}, {group.frequency_hz[0] / 1e3:g} kHz"
            plain_log_ticks(axes, x=by_frequency, y=True)
            if top < 60 * bottom:
                axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            if by_frequency and x[0] < 10:
                axes.set_xticks([1, 100, 10000])
            if k % 3 == 0:
                axes.set_ylabel("Launch range (µm)")
            axes.set_title(f"{group.id}: {what}", fontsize=10, pad=19)
            change = change_in_words(found)
            if term.latent:
                change = change.replace("+", "±")
            axes.text(0, 1.035, change, transform=axes.transAxes, fontsize=9.5, color=PALETTE["vermillion"])
        handles, labels = grid.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize=9.5, frameon=False)
        save(figure, FIGURES / f"{term.id}.png")


def clustered(found: Confounding) -> list[int]:
    """Order of the causes in which neighbours are confounded."""
    from scipy.cluster.hierarchy import leaves_list, linkage, optimal_leaf_ordering
    from scipy.spatial.distance import squareform

    seen = [i for i, s in enumerate(found.status) if s == "visible"]
    distance = squareform(found.angle[np.ix_(seen, seen)], checks=False)
    tree = linkage(distance, "average")
    return [seen[i] for i in leaves_list(optimal_leaf_ordering(tree, distance))]


def draw_confounded() -> None:
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    from psafit.report.style import PALETTE, figure_style

    first, six = first_group(), six_groups()
    order = clustered(six)
    order += [i for i, s in enumerate(first.status) if s == "visible" and i not in order]
    n = len(order)
    colours = LinearSegmentedColormap.from_list("angle", ["#08306b", "#2a7ab9", "#9ecae1", "#eaf2f9", "#ffffff"])
    with figure_style():
        figure = Figure(figsize=(10.4, 5.9), layout="constrained")
        panels = figure.subplots(1, 2)
        for axes, found, title in zip(panels, (first, six), ("Group 1 alone", "All six groups"), strict=True):
            angle = found.angle[np.ix_(order, order)]
            image = axes.imshow(np.ma.masked_invalid(angle), cmap=colours, vmin=0, vmax=90)
            axes.set_facecolor("#ececec")
            for i, j in itertools.product(range(n), range(n)):
                if i != j and angle[i, j] < NEAR:
                    axes.text(
                        j, i, f"{angle[i, j]:.0f}", ha="center", va="center", fontsize=8, color="white",
                        fontweight="bold" if angle[i, j] < 10 else "normal",
                    )  # fmt: skip
                if i == j and np.isfinite(angle[i, i]):
                    axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, facecolor=PALETTE["grey"], edgecolor="none"))
            names = [six.ids[i] for i in order]
            axes.set_xticks(range(n), names, rotation=60, ha="right", rotation_mode="anchor", fontsize=8.5)
            axes.set_yticks(range(n), names if axes is panels[0] else [""] * n, fontsize=8.5)
            for label, i in zip(axes.get_xticklabels(), order, strict=True):
                label.set_color(PALETTE["ink"] if found.status[i] == "visible" else "#9aa1ab")
            axes.set_xticks(np.arange(n + 1) - 0.5, minor=True)
            axes.set_yticks(np.arange(n + 1) - 0.5, minor=True)
            axes.grid(False)
            axes.grid(which="minor", color="white", linewidth=1.0)
            axes.tick_params(which="both", length=0)
            axes.spines[:].set_visible(False)
            axes.set_title(title)
        bar = figure.colorbar(image, ax=panels, shrink=0.72, aspect=28, pad=0.015)
        bar.set_label("Angle after the refit (°): 0 confounded, 90 distinct")
        bar.set_ticks([0, 30, 60, 90])
        bar.outline.set_visible(False)
        figure.legend(
            [Rectangle((0, 0), 1, 1, facecolor="#ececec")], ["absorbed by the refit, or too small to be seen"],
            loc="outside lower center", fontsize=9.5, frameon=False,
        )  # fmt: skip
        save(figure, FIGURES / "confounded.png", colours=160)


def main() -> int:
    PAGE.write_text(page("\n\n".join(likeness())), encoding="utf-8")
    if "--text" not in sys.argv:
        draw_confounded()
        for term in TERMS:
            draw_cause(term)
    return 0


if __name__ == "__main__":
    sys.exit(main())
