"""Numbers, units and lists as a page shows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from psafit.challenge.score import percent
from psafit.cli.diagnosing import share_text
from psafit.diagnose.next_experiment import NextExperiment, Proposal, Purpose
from psafit.report import wording
from psafit.report.diagnosis import words


def plain_spaces(text: str) -> str:
    return text.replace("\xa0", " ")


def test_numbers():
    assert plain_spaces(wording.number(3220596.8, 526000.0)) == "3.22 × 10⁶"
    assert wording.number(0.2, 0.056) == "0.200"
    assert wording.number(-12.34, 0.5) == "−12.34"
    assert wording.number(float("nan")) == "–"
    assert plain_spaces(wording.interval(2.72e6, 3.77e6, 5e5)) == "(2.72 to 3.77) × 10⁶"
    assert plain_spaces(wording.interval(23270.9, 4.297e7)) == "2.33 × 10⁴ to 4.30 × 10⁷"
    assert wording.exact(1e9) == "10⁹" and wording.exact(0.01) == "0.01"
    assert plain_spaces(wording.exact(2.5e6)) == "2.5 × 10⁶"
    assert wording.p_value(1 / 1001) == "≤ 0.001" and wording.p_value(0.5) == "0.50"
    assert plain_spaces(wording.percent(0.998)) == "over 99 %" and plain_spaces(wording.percent(1.0)) == "100 %"
    assert wording.factor(np.log(2)) == "2.00" and "10" in wording.factor(1e6)


def test_symbols_and_lists_are_escaped():
    assert wording.symbol_html(r"\sigma_{rel}") == "<i>σ<sub>rel</sub></i>"
    own = wording.symbol_html(r"\sigma_{rel,\mathrm{launch\ speed}}")
    assert own == "<i>σ<sub>rel,launch speed</sub></i>"
    assert wording.symbol_html("k_c") == "<i>k<sub>c</sub></i>"
    assert wording.symbol_html(r"N_\mathrm{cyc}") == "<i>N<sub>cyc</sub></i>"
    assert "<b>" not in wording.symbol_html("<b>") and "<b>" not in wording.listed(["<b>", "<b>"])
    assert wording.listed(["a", "b", "c"]) == "a, b and c"
    assert wording.listed(range(20)).endswith("and 12 more")


def test_plain_text_is_typeset():
    assert plain_spaces(wording.typeset("k_c = 3.22e6 N/m (90 %: -2 um to 1e-7), 275 us; R-hat 2-6")) == (
        "k_c = 3.22 × 10⁶ N/m (90 %: −2 µm to 1 × 10⁻⁷), 275 µs; R-hat 2-6"
    )


def test_the_same_probability_reads_the_same_everywhere():
    assert wording.p_value(0.925) == "0.93" and plain_spaces(wording.percent(0.925)) == "93 %"
    assert share_text(0.925) == "92.5" and share_text(0.0125) == "1.3" and percent(0.925) == "93 %"


def test_nothing_is_narrower_by_minus_zero():
    one = Proposal("", "sine", [], [], {}, -1e-3, None, 0.0)
    offered = NextExperiment.of([one], Purpose("narrow", parameter="k_c"))
    assert "whose standard deviation falls by about 0 %" in offered.promise(one)
    assert plain_spaces(words.narrowing(one)).startswith("0 %") and words.nats(-0.04) == "0.0" == words.signed(-0.04)
    assert wording.exact(-0.0) == "0" and "-0 " not in wording.typeset(replace(one, separation=-0.01).lead)
