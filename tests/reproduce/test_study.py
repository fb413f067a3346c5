"""The published claims and the cause of their failure."""

from __future__ import annotations

import json

import numpy as np
import pytest

from psafit.reproduce import NOT_REPRODUCED, ONLY_WITH_STEP, REPRODUCED, Claim, Reproduction, judge

# Table 4, um, typed here from the study once more: 16 to 20 V.
TABLE_4 = {
    1200: (60.60, 64.40, 68.18, 72.96, 75.75),
    3000: (28.97, 30.70, 32.60, 34.41, 36.22),
}


@pytest.fixture(scope="module")
def claims(result: Reproduction) -> dict[str, Claim]:
    return {claim.id: claim for claim in result.claims}


def test_table_4_comes_out_with_the_studys_step_and_not_without(claims: dict[str, Claim]) -> None:
    for frequency, column in TABLE_4.items():
        for volt, printed in zip(range(16, 21), column, strict=True):
            claim = claims[f"table4_{frequency}hz_{volt}v"]
            assert claim.published == printed
            if (frequency, volt) == (1200, 19):  # 71.96 misprinted?
                assert claim.verdict == NOT_REPRODUCED
                assert claim.study_step == pytest.approx(71.96, rel=0.001)
                continue
            assert claim.study_step == pytest.approx(printed, rel=0.003)
            assert claim.converged > 1.03 * printed
            assert claim.verdict == ONLY_WITH_STEP


def test_converged_values_and_the_peak(claims: dict[str, Claim]) -> None:
    assert claims["table4_1200hz_20v"].converged == pytest.approx(113.9110, abs=1e-3)
    assert claims["fig12_sine_peak"].study_step == pytest.approx(77.46, abs=0.01)
    assert claims["fig12_sine_peak_frequency"].study_step == 1000.0
    assert claims["fig12_sine_peak_frequency"].converged == 300.0


def test_every_verdict_is_one_of_three_and_follows_from_the_numbers(result: Reproduction) -> None:
    verdicts = {
        "reproduced",
        "reproduced only with the study's time step",
        "not reproduced",
    }
    assert {claim.verdict for claim in result.claims} == verdicts
    assert sum(result.count(v) for v in (REPRODUCED, ONLY_WITH_STEP, NOT_REPRODUCED)) == len(result.claims)
    for claim in result.claims:
        assert claim.verdict == judge(claim.published, claim.tolerance, claim.study_step, claim.converged)
        assert claim.tolerance > 0
        assert claim.reason


def test_stability_limit_is_that_of_the_real_axis(result: Reproduction) -> None:
    # RK4 on the negative real axis: z^3 + 4 z^2 + 12 z + 24 = 0, the root of R(z) = 1 other than 0.
    edge = min(r.real for r in np.roots([1, 4, 12, 24]) if abs(r.imag) < 1e-12)
    assert edge == pytest.approx(-2.785293563405282)
    s = result.stability
    assert s.largest_stable_step == pytest.approx(-edge / 2.8083195e6, rel=1e-7)
    assert s.largest_stable_step == pytest.approx(0.9918e-6, abs=5e-11)
    assert s.study_growth[0] == pytest.approx(1.0353, abs=5e-5)
    assert (s.study_growth[1:] < 1).all()


def test_the_march_grows_as_the_stability_function_says(result: Reproduction) -> None:
    unstable = result.fast_modes[0]
    assert unstable.growth == pytest.approx(result.stability.study_growth[0], rel=1e-4)
    # It ends the contact: the runaway mode is as large as the indentation.
    assert unstable.error[-1] == pytest.approx(unstable.indentation.max(), rel=0.2)
    for stable in result.fast_modes[1:]:
        assert stable.error[-1] < 1e-5 * stable.indentation.max()


def test_refinement_converges_at_first_order(result: Reproduction) -> None:
    for case in result.convergence:
        assert case.order == pytest.approx(1.0, abs=0.25)
        assert case.launch_range[-1] == pytest.approx(case.exact, rel=1e-3)
        assert case.launch_range[0] < 0.97 * case.exact


def test_no_reading_of_the_square_wave_gives_table_4_and_the_peak(result: Reproduction) -> None:
    for attempt in result.square_attempts:
        peak_fits = attempt.diverged == 0 and abs(attempt.largest / 95.5 - 1) < 0.003
        table_fits = abs(attempt.sine_check / 60.60 - 1) < 0.003
        assert not (peak_fits and table_fits)


def test_restitution_jumps_only_with_the_studys_step(claims: dict[str, Claim]) -> None:
    ratio = claims["fig15_restitution_ratio"]
    assert ratio.study_step > 2.0
    assert ratio.converged == pytest.approx(1.0, abs=0.05)


def test_rounding_of_the_parameters_matters_only_to_the_false_values(result: Reproduction) -> None:
    sine = result.rounding[0]
    assert np.ptp(sine.study_step) / sine.study_step[1] > 0.05
    assert np.ptp(sine.converged) / sine.converged[1] < 0.01


def test_record_is_strict_json_and_survives_the_round_trip(result: Reproduction) -> None:
    record = result.to_dict()
    text = json.dumps(record, allow_nan=False)
    assert json.loads(text) == record
    assert record["schema"] == 1
    square = next(c for c in record["claims"] if c["id"] == "fig12_square_peak")
    assert square["study_step"] is None  # overflow
