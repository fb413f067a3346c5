"""What a rig is made of, and what follows from it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from folders import TOML, refusal, write

from psafit.errors import InputError
from psafit.experiment import describe, read_experiment, read_plan, write_experiment
from psafit.experiment.rig import NEEDED, Rig, beliefs, hertz_stiffness
from psafit.inference.problem import Problem
from psafit.parameters import Bounds, LogNormal, Normal, Tailed
from psafit.physics import TERMS, baseline, informed, terms
from psafit.prior_check import read
from psafit.simulate.contract import STUDY

FACTS = """[rig]
ball_material = "Steel"
face_material = "pzt"
ball_radius = 0.0094
source_resistance = 50
capacity = 1.5e-6
rated_voltage = 150
rated_stroke = 17.4e-6
layer_thickness = 1.1e-4
"""


def test_hertz_contact_is_that_of_a_hand_calculation() -> None:
    """Steel 205/(1 - 0.29^2) = 223.8 GPa on PZT 48/(1 - 0.34^2) = 54.28 GPa: E* = 43.68 GPa, R d = 9.4e-9 m^2."""
    rig = Rig(ball_material="steel", face_material="pzt", ball_radius=9.4e-3)
    assert hertz_stiffness(rig) == pytest.approx(4 / 3 * 43.68e9 * np.sqrt(9.4e-9), rel=1e-3)
    assert hertz_stiffness(Rig(ball_material="steel", ball_radius=9.4e-3)) is None


def test_the_usual_prior_of_the_contact_is_of_the_same_solids() -> None:
    """What `psafit terms k_c` says of steel on PZT is what follows from a rig of steel on PZT."""
    stated = re.search(r"that is (\S+) MN/m at a micrometre", baseline.PARAMETERS[0].source)
    found = hertz_stiffness(Rig(ball_material="steel", face_material="pzt", ball_radius=9.4e-3))
    assert stated and found == pytest.approx(1e6 * float(stated[1]), rel=1e-3)


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("aluminum", "aluminium"),
        ("stainless_steel", "stainless steel"),
        ("Chrome-Steel", "steel"),
        ("100Cr6", "steel"),
        ("Ruby", "sapphire"),
        ("zirconia", "zirconia"),
    ],
)
def test_a_material_has_other_names(tmp_path: Path, said: str, meant: str) -> None:
    rig = read_experiment(write(tmp_path, f'{TOML}[rig]\nball_material = "{said}"\n')).rig
    assert rig is not None and rig.ball_material == meant


@pytest.mark.parametrize(
    ("material", "stiffness"),
    [("zirconia", 5.654), ("sapphire", 6.237)],
)
def test_contact_of_other_balls(material: str, stiffness: float) -> None:
    """By hand, on PZT's 54.28 GPa: 205/(1 - 0.3^2) = 225.3, 400/(1 - 0.28^2) = 434.0 GPa."""
    rig = Rig(ball_material=material, face_material="pzt", ball_radius=9.4e-3)
    assert hertz_stiffness(rig) == pytest.approx(1e6 * stiffness, rel=1e-3)


def test_priors_follow_from_a_rig(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path, TOML + FACTS))
    causes = terms(["amplifier_lag", "anchored_stroke", "preload", "gap"])
    problem = Problem(experiment, experiment.ids, causes)
    known = {p.name: p for p in problem.parameters}
    tail = "; 5 % in a Cauchy tail 3 times as wide"
    assert known["k_c"].prior.describe() == f"log-normal, median 2.82341e+06, factor 2.5 for one sd{tail}"
    lag = known["amplifier_lag_tau"].prior
    assert isinstance(lag, Tailed) and lag.middle == pytest.approx((75e-6, np.hypot(0.25 * 75e-6, 2e-6)))
    assert known["anchored_voltage"].prior.describe() == f"log-normal, median 150, factor 1.1 for one sd{tail}"
    assert known["preload_offset"].source.startswith("2.5 degrees of a string of 90 mm")
    assert known["preload_offset"].bounds.upper == pytest.approx(0.045)  # half of the string
    odds = {t.id: t.probability for t in problem.terms}
    usual = {t.id: t.probability for t in causes}
    assert odds == usual | {"amplifier_lag": 0.95, "anchored_stroke": 0.7}


def test_what_is_possible_follows_from_a_rig(tmp_path: Path) -> None:
    """A stack of 500 V and 60 um (0.12 um/V), and a ball of 200 g, 18.25 mm in radius: 0.2 kg / (7850 kg/m^3)."""
    rig = Rig(rated_voltage=500.0, rated_stroke=6e-5, ball_material="steel")
    known = {b.name: b for b in beliefs(rig, replace(STUDY, M=0.2))}
    assert known["idle_u0"].bounds == Bounds(-500.0, 500.0)
    assert known["gap_width"].bounds.upper == pytest.approx(2 * 1.17 * 6e-5)
    assert known["adhesion_force"].bounds.upper == pytest.approx(4 * 0.2 * 9.81)
    assert known["adhesion_force"].prior.middle == pytest.approx((0.0, 5e-3 * 18.25 / 9.4), rel=1e-3)
    by_volt = {b.name: b for b in beliefs(replace(rig, rated_stroke=None), STUDY)}
    assert by_volt["gap_width"].bounds.upper == pytest.approx(2 * 1.17 * 500 * 1.2e-7)
    assert not {"idle_u0", "gap_width"} & {b.name for b in beliefs(Rig(ball_material="steel"), STUDY)}


def test_a_stated_lean_is_bounded_by_the_string_nevertheless(tmp_path: Path) -> None:
    stated = '[prior.preload_offset]\nmean = {}\nsd = 0.002\nsource = "x"\n'
    experiment = read_experiment(write(tmp_path, TOML + FACTS + stated.format(0.01)))
    (lean,) = informed(experiment.beliefs, terms(["preload"]))[1][0].parameters
    assert lean.prior == Normal(0.01, 0.002) and lean.bounds.upper == pytest.approx(0.045)
    beyond = read_experiment(write(tmp_path, TOML + FACTS + stated.format(0.06)))
    with pytest.raises(InputError, match=r"it has its middle within 0 to 0\.045 m"):
        informed(beyond.beliefs, TERMS)


def test_what_is_reported_of_a_rig_is_what_is_used(tmp_path: Path) -> None:
    """Every prior with its tail, and how probable a cause has become."""
    experiment = read_experiment(write(tmp_path, TOML + FACTS))
    plain, causes = informed(experiment.beliefs, TERMS)
    used = {p.name: p.prior.describe() for p in (*plain, *(p for t in causes for p in t.parameters))}
    lines = {known["name"]: known["prior"] for known in describe(experiment)["priors"]}
    at_work = {"amplifier_lag_tau": "; at work: 0.95", "anchored_voltage": "; at work: 0.7"}
    assert lines == {name: used[name] + at_work.get(name, "") for name in lines} and len(lines) == 10
    assert all(known["derived"] for known in describe(experiment)["priors"])


def test_one_fact_sets_every_parameter_that_it_is_about(tmp_path: Path) -> None:
    """Layers half as thick double the field; half the string halves a lean of 2.5 degrees."""
    toml = (TOML + FACTS).replace("l = 0.09", "l = 0.045").replace("thickness = 1.1e-4", "thickness = 5.5e-5")
    experiment = read_experiment(write(tmp_path, toml))
    both = informed(experiment.beliefs, terms(["anchored_stroke", "field_dependent_d33", "preload", "session_lean"]))[1]
    known = {p.name: p.prior for t in both for p in t.parameters}
    assert known["field_d33_alpha"] == known["anchored_alpha"] == Tailed(Normal(0.012, 0.008))
    assert known["session_lean_offset"] == known["preload_offset"] == Tailed(Normal(0.0, np.pi / 72 * 0.045))


@pytest.mark.parametrize(
    ("toml", "odds"),
    [
        (TOML + FACTS.replace("rated_stroke = 17.4e-6", ""), 0.3),  # where q comes from is not said
        (TOML + FACTS.replace("rated_stroke = 17.4e-6", "rated_stroke = 26e-6"), 0.3),  # q is not the data sheet's
        (TOML + FACTS + '[prior.anchored_alpha]\nmean = 0.01\nsd = 0.01\nsource = "x"\n', 0.7),
        (TOML + FACTS + '[prior.anchored_voltage]\nmedian = 150\nfactor = 1.2\nsource = "x"\n', 0.7),
        (
            TOML + FACTS + '[prior.anchored_alpha]\nmean = 0.01\nsd = 0.01\nsource = "x"\nprobability = 0.1\n',
            0.1,
        ),
        (TOML + FACTS + '[prior.anchored_alpha]\nprobability = 0.2\nsource = "x"\n', 0.2),
    ],
)
def test_how_probable_a_cause_is_follows_from_the_rig_unless_it_is_stated(
    tmp_path: Path, toml: str, odds: float
) -> None:
    """A stated prior is about values. The definition is written with it, as it was or anew."""
    first = read_experiment(write(tmp_path / "a", toml))
    (cause,) = informed(first.beliefs, terms(["anchored_stroke"]))[1]
    assert cause.probability == odds
    write_experiment(first, tmp_path / "b")
    assert (tmp_path / "b" / "experiment.toml").read_text("utf-8").startswith(toml.rstrip())
    (tmp_path / "a" / "experiment.toml").unlink()
    write_experiment(first, tmp_path / "c")
    assert read_plan(tmp_path / "b").beliefs == read_plan(tmp_path / "c").beliefs == first.beliefs


def test_a_probability_alone_leaves_the_values_as_they_are(tmp_path: Path) -> None:
    """As usual, or as they follow from the rig."""
    only = '[prior.{}]\nprobability = 0.2\nsource = "seen"\n'
    causes = terms(["anchored_stroke", "gap"])
    with_facts = read_experiment(write(tmp_path / "a", TOML + FACTS))
    both = read_experiment(
        write(tmp_path / "b", TOML + FACTS + only.format("anchored_alpha") + only.format("gap_width"))
    )
    before, after = (informed(e.beliefs, causes)[1] for e in (with_facts, both))
    assert [c.parameters for c in after] == [c.parameters for c in before] and before[0].probability != 0.2
    assert [c.probability for c in after] == [0.2, 0.2]
    assert [p for p in describe(both)["priors"] if p["source"] == "seen"] == [
        {"name": name, "prior": "at work: 0.2", "source": "seen", "derived": False}
        for name in ("anchored_alpha", "gap_width")
    ]


@pytest.mark.parametrize(
    ("name", "probability", "said"),
    [
        ("k_c", "0.9", "k_c is of the model itself, which is always at work"),
        ("gap", "1", "probability is not a finite number above 0 and below 1"),
    ],
)
def test_a_probability_that_cannot_be_is_refused(tmp_path: Path, name: str, probability: str, said: str) -> None:
    toml = f'{TOML}[prior.{name}]\nmedian = 4e6\nfactor = 2\nsource = "x"\nprobability = {probability}\n'
    with pytest.raises(InputError, match=said):
        informed(read_experiment(write(tmp_path, toml)).beliefs, ())


def test_what_follows_from_a_rig_makes_far_values_surprising_and_forbids_none(tmp_path: Path) -> None:
    """A soft film on the face is known to no handbook: k_c of a hundredth costs a surprise, not 19 nats."""
    experiment = read_experiment(write(tmp_path, TOML + FACTS))
    (k_c, *_), _ = informed(experiment.beliefs, ())
    most, *far = k_c.log_prior(k_c.to_sampling([2.8e6, 1e4, 1e3]))
    assert all(5.0 < most - x < 12.0 for x in far)
    assert all(isinstance(b.prior, Tailed) for b in experiment.beliefs)


def test_what_is_stated_itself_comes_before_what_follows(tmp_path: Path) -> None:
    stated = '[prior.k_c]\nmedian = 4e6\nfactor = 1.5\nsource = "measured"\n'
    experiment = read_experiment(write(tmp_path, TOML + FACTS + stated))
    assert [b.source for b in experiment.beliefs if b.name == "k_c"] == ["measured"]


def test_a_rig_is_written_as_it_was_read(tmp_path: Path) -> None:
    """Also where the definition is made anew."""
    first = read_experiment(write(tmp_path / "a", TOML + FACTS))
    (tmp_path / "a" / "experiment.toml").unlink()
    (tmp_path / "b").mkdir()
    write_experiment(first, tmp_path / "b")
    assert (read_plan(tmp_path / "b").rig, read_plan(tmp_path / "b").beliefs) == (first.rig, first.beliefs)


DOUBTS = {
    "ball_radius = 0.0094": ("ball_radius = 0.0188", "a steel ball of radius 0.0188 m weighs 0.218 kg"),
    "source_resistance = 50": ("source_resistance = 0.6", "is it given in kilo-ohms?"),
    "capacity = 1.5e-6": ("capacity = 1.5", "is it given in uF or nF?"),
    "rated_stroke = 17.4e-6": ("rated_stroke = 8.7e-6", "rated_stroke over rated_voltage is 5.8e-08 m/V"),
}


SWAPPED = TOML.replace("M = 0.027", "M = 0.005").replace("\nm = 0.005", "\nm = 0.027")
BALL = "constant M = 0.005 kg; constant m = 0.027 kg is: are m, of the stack, and M, of the ball, swapped?"
STACK = "weighs about 0.0023 kg, constant m = 0.027 kg; constant M = 0.005 kg is nearer: are m, of the stack, and M, of"


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ("", []),
        ("ball_radius = 0.0094", []),  # 5 g may be nylon
        ("ball_radius = 0.012", [f"a solid ball of radius 0.012 m weighs 0.00825 to 0.109 kg, {BALL}"]),
        (
            'ball_radius = 0.0094\nball_material = "steel"',
            [f"a steel ball of radius 0.0094 m weighs 0.0273 kg, {BALL}"],
        ),
        ("rated_stroke = 17.4e-6", [STACK]),
    ],
)
def test_masses_of_ball_and_stack_that_are_swapped_are_reported(facts: str, said: list[str], tmp_path: Path) -> None:
    """By hand: 4/3 pi (9.4 mm)^3 = 3.479e-6 m^3; 7500/48e9 x 4.89e7 x (17.4e-6/1e-3)^2 = 2.3 g."""
    warnings = read_experiment(write(tmp_path / "swapped", f"{SWAPPED}[rig]\n{facts}\n")).warnings
    assert len(warnings) == len(said) and all(text in line for text, line in zip(said, warnings, strict=True))
    assert not read_experiment(write(tmp_path / "right", f"{TOML}[rig]\n{facts}\n")).warnings


def test_a_heavy_stack_next_to_a_ball_of_the_right_mass_is_no_swap(tmp_path: Path) -> None:
    """A head may be glued on; nothing is asked where a prior says how its mass was found."""
    heavy = TOML.replace("\nm = 0.005", "\nm = 0.05") + "[rig]\nrated_stroke = 17.4e-6\n"
    steel = 'ball_radius = 0.0094\nball_material = "steel"\n'
    (warning,) = read_experiment(write(tmp_path / "heavy", heavy + steel)).warnings
    assert "swapped" not in warning and "If a head is part of m, go on" in warning
    (without,) = read_experiment(write(tmp_path / "unknown", heavy.replace("M = 0.027", "M = 0.005"))).warnings
    assert "are m, of the stack, and M, of the ball, swapped?" in without
    weighed = '[prior.modal_mass_ratio]\nmedian = 1\nfactor = 1.1\nsource = "weighed"\n'
    assert not read_experiment(write(tmp_path / "weighed", heavy + steel + weighed)).warnings


def test_a_stroke_in_another_unit_is_not_taken_for_a_swap(tmp_path: Path) -> None:
    facts = FACTS.replace("rated_stroke = 17.4e-6", "rated_stroke = 17.4e-5")
    (warning,) = read_experiment(write(tmp_path, TOML + facts)).warnings
    assert "rated_stroke over rated_voltage" in warning


FAR = {
    "source_resistance": ("0.05", "is it given in kilo-ohms?", "1e6", "is it given in milliohms?"),
    "rated_voltage": ("0.15", "is it given in kV?", "1.5e5", "is it given in mV?"),
    "rated_stroke": ("1.2e-8", "is it the stroke per volt?", "0.0174", "is it given in um or mm?"),
    "capacity": ("1.5e-12", "is a power of ten wrong?", "1.5", "is it given in uF or nF?"),
    "layer_thickness": ("1.1e-7", "is a power of ten wrong?", "0.11", "is it given in um or mm?"),
}


@pytest.mark.parametrize("name", FAR)
def test_a_fact_too_small_is_asked_for_another_unit_than_one_too_large(tmp_path: Path, name: str) -> None:
    small, below, large, above = FAR[name]
    for value, question in ((small, below), (large, above)):
        folder = write(tmp_path / value, f"{TOML}[rig]\n{name} = {value}\n")
        (said,) = (w for w in read_experiment(folder).warnings if f"[rig] {name} = " in w and " is outside " in w)
        assert said.endswith(question)


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ("rated_voltage = 150\nlayer_thickness = 1.1e-3", "rated_voltage over layer_thickness is 0.136 kV/mm"),
        ("rated_voltage = 1500\nlayer_thickness = 1.1e-4", "rated_voltage over layer_thickness is 13.6 kV/mm"),
        ("rated_voltage = 1000\nlayer_thickness = 1e-3", ""),
        ("rated_voltage = 100\nlayer_thickness = 25e-6", ""),
        ("rated_voltage = 100", ""),  # exactly a fifth below zero
        ("rated_voltage = 15", "rated_voltage = 15 V is below the drive of group 1, which reaches 20 V"),
    ],
)
def test_a_rating_is_held_against_layers_and_drive(tmp_path: Path, facts: str, said: str) -> None:
    """By hand: 150 V over 1.1 mm is 0.136 kV/mm; the readings go up to 20 V."""
    warnings = read_experiment(write(tmp_path, f"{TOML}[rig]\n{facts}\n")).warnings
    assert [said in w for w in warnings] == [True] * bool(said)


@pytest.mark.parametrize(
    ("keys", "reaches"),
    [
        ("bias_v = 10\nidle_v = 0", 30),
        ("bias_v = -10\nidle_v = 0", 30),
        ("idle_v = -40", 40),
        ('waveform = "unipolar_sine"\nbias_v = -10\nidle_v = 0', 20),  # of the other group
    ],
)
def test_a_bias_counts_towards_the_rating(tmp_path: Path, keys: str, reaches: int) -> None:
    toml = TOML.replace('waveform = "sine"', keys if "waveform" in keys else f'waveform = "sine"\n{keys}')
    (said,) = read_experiment(write(tmp_path, f"{toml}[rig]\nrated_voltage = 15\n")).warnings
    assert said.endswith(f"which reaches {reaches} V; is one of them wrong?")


def test_each_drive_far_below_zero_is_reported(tmp_path: Path) -> None:
    """Also where the rating is that of the drive, or a little less: strokes are stated below the highest voltage."""
    for rated in (90, 20, 16):
        warnings = read_experiment(write(tmp_path, f"{TOML}[rig]\nrated_voltage = {rated}\n")).warnings
        low = f"goes down to -20 V, which most stacks of {rated} V do not survive; if it goes from 0 to V: unipolar_"
        assert warnings == (
            f"experiment.toml: [rig] the drive of group 1, sine, {low}sine",
            f"experiment.toml: [rig] the drive of group late-2, square, {low}square",
        )


def test_drives_far_below_zero_of_one_waveform_are_asked_about_in_one_line(tmp_path: Path) -> None:
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"\nidle_v = -30')
    (said,) = read_experiment(write(tmp_path, f"{toml}[rig]\nrated_voltage = 60\n")).warnings
    assert "the drives of groups 1 and late-2, sine, go as far down as -30 V, which most stacks of 60 V" in said


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('waveform = "unipolar_sine"', ""),
        ('waveform = "sine"\nbias_v = 10\nidle_v = 0', ""),
        ('waveform = "sine"\nidle_v = -30', "goes down to -30 V"),
        ('waveform = "triangle"', "if it goes from 0 to V: unipolar_triangle"),
        ('waveform = "unipolar_sine"\nbias_v = -40\nidle_v = 0', "is its sign right, and bias_v?"),
    ],
)
def test_what_a_drive_far_below_zero_could_be_is_asked(tmp_path: Path, keys: str, said: str) -> None:
    toml = TOML.replace('waveform = "square"', 'waveform = "unipolar_square"').replace('waveform = "sine"', keys)
    warnings = read_experiment(write(tmp_path, f"{toml}[rig]\nrated_voltage = 60\n")).warnings
    assert [said in w for w in warnings] == [True] * bool(said)


def test_a_radius_follows_from_mass_and_material(tmp_path: Path) -> None:
    """By hand: 27 g of 7850 kg/m^3 are 3.439 cm^3, a ball of 9.363 mm, whose contact is as that of one stated."""
    solids = 'ball_material = "steel"\nface_material = "pzt"\n'
    found = read_experiment(write(tmp_path, f"{TOML}[rig]\n{solids}"))
    (derived,) = (b for b in found.beliefs if b.name == "k_c")
    stated = read_experiment(write(tmp_path, f"{TOML}[rig]\n{solids}ball_radius = 9.363e-3\n"))
    (known,) = (b for b in stated.beliefs if b.name == "k_c")
    medians = [float(b.prior.describe().split("median ")[1].split(",")[0]) for b in (derived, known)]
    assert medians[0] == pytest.approx(medians[1], rel=1e-4)
    assert "of 9.36 mm, the radius of a solid one of mass M, on pzt" in derived.source
    assert "mass" not in known.source and found.rig and found.rig.ball_radius is None


@pytest.mark.parametrize(
    ("facts", "lacking"),
    [
        ('ball_material = "steel"', {"k_c": ["face_material"]}),
        (
            'face_material = "pzt"\ncapacity = 1e-6',
            {"k_c": ["ball_material"], "amplifier_lag_tau": ["source_resistance"]},
        ),
        ("rated_stroke = 17.4e-6", {"anchored_voltage": ["rated_voltage"]}),
        ("rated_voltage = 150\nlayer_thickness = 1e-4", {}),
        ('ball_material = "steel"\n[prior.k_c]\nmedian = 3e6\nfactor = 2\nsource = "x"', {}),
    ],
)
def test_what_a_prior_lacks_is_said(facts: str, lacking: dict[str, list[str]], tmp_path: Path) -> None:
    assert describe(read_experiment(write(tmp_path, f"{TOML}[rig]\n{facts}\n")))["lacking"] == lacking


@pytest.mark.parametrize("fact", NEEDED)
def test_a_prior_lacks_no_more_than_is_needed(fact: str, tmp_path: Path) -> None:
    values = dict(line.split(" = ") for line in FACTS.splitlines()[1:])
    facts = "\n".join(f"{name} = {values[name]}" for name in NEEDED[fact])
    assert fact in {b.name for b in read_experiment(write(tmp_path, f"{TOML}[rig]\n{facts}\n")).beliefs}


@pytest.mark.parametrize(
    ("fact", "said"), [("face_material", "pzt, the bare stack, or alumina"), ("ball_material", "zirc")]
)
def test_a_ceramic_may_be_several(fact: str, said: str, tmp_path: Path) -> None:
    """By hand: E* of steel on PZT is 43.7 GPa, on alumina 142 GPa."""
    error = refusal(write(tmp_path, f'{TOML}[rig]\n{fact} = "Ceramic"\n'))
    assert "say which: " in error.remedy and said in error.remedy
    pzt, alumina = (hertz_stiffness(Rig("steel", face, 9.4e-3)) or 0.0 for face in ("pzt", "alumina"))
    assert alumina / pzt == pytest.approx(3.25, rel=0.01)


@pytest.mark.parametrize("fact", DOUBTS)
def test_facts_that_cannot_be_right_are_reported(tmp_path: Path, fact: str) -> None:
    other, said = DOUBTS[fact]
    warnings = read_experiment(write(tmp_path, TOML + FACTS.replace(fact, other))).warnings
    assert len(warnings) == 1 and said in warnings[0] and warnings[0].startswith("experiment.toml: [rig] ")


def test_facts_that_follow_to_what_cannot_be_are_refused_where_they_stand(tmp_path: Path) -> None:
    """Fifty kilo-ohms into a stack: a lag of 75 ms, of which none is believed in."""
    place = write(tmp_path, TOML + FACTS.replace("source_resistance = 50", "source_resistance = 5e4"))
    text = (place / "experiment.toml").read_text("utf-8")
    experiment = read_experiment(place)
    with pytest.raises(
        InputError,
        match=r"amplifier_lag_tau cannot be what follows from source_resistance = 50000 ohm and capacity = 1.5e-06 F;",
    ) as found:
        Problem(experiment, experiment.ids)
    assert found.value.file == place / "experiment.toml"
    assert text.splitlines()[(found.value.line or 0) - 1] == "source_resistance = 5e4"


def faults_of(folder: Path) -> list[str]:
    """What `psafit check` says of a folder that it refuses, each fault with the text of its line."""
    with pytest.raises(InputError) as found:
        read(folder)
    lines = (folder / "experiment.toml").read_text("utf-8").splitlines()
    return [f"{lines[(fault.line or 0) - 1]} -> {fault.what}; {fault.remedy}" for fault in found.value.faults]


WRONG = {
    "ball_radius": ("9.4", "9.4 m is outside 0.0001 to 0.1; is it given in mm?"),
    "capacity": ("0.7", "0.7 F is outside 1e-10 to 0.001; is it given in uF or nF?"),
    "rated_voltage": ("0.1", "0.1 V is outside 5 to 5000; is it given in kV?"),
    "layer_thickness": ("0.11", "0.11 m is outside 1e-06 to 0.005; is it given in um or mm?"),
}


@pytest.mark.parametrize("name", ["capacity", "rated_voltage"])
def test_a_wrong_fact_is_refused_by_its_own_name(tmp_path: Path, name: str) -> None:
    value, said = WRONG[name]
    text = re.sub(rf"^{name} = .*", f"{name} = {value}", FACTS, flags=re.MULTILINE)
    assert faults_of(write(tmp_path, TOML + text)) == [f"{name} = {value} -> {name} = {said}"]


def test_a_wrong_string_is_refused_once_and_as_the_constant_that_it_is(tmp_path: Path) -> None:
    """Two priors follow from it."""
    folder = write(tmp_path, TOML.replace("l = 0.09", "l = 150") + FACTS)
    assert faults_of(folder) == ["l = 150 -> constant l = 150 m is outside 0.001 to 10; is it given in mm?"]


@pytest.mark.parametrize("layer", ["0.11", "110"])
def test_all_wrong_facts_are_reported_at_once(tmp_path: Path, layer: str) -> None:
    """Those beyond hard limits, those from which no prior follows, and those of which none does at all."""
    wrong = {name: value for name, (value, _) in WRONG.items()} | {"layer_thickness": layer}
    facts = "".join(f"{name} = {value}\n" for name, value in wrong.items())
    found = faults_of(write(tmp_path, f"{TOML}[rig]\n{facts}"))
    assert [line.partition(" -> ")[0] for line in found] == facts.splitlines()
    assert [line.rpartition("; ")[2] for line in found] == [said.rpartition("; ")[2] for _, said in WRONG.values()]


@pytest.mark.parametrize(
    "fact", ["ball_radius = 1e300", "source_resistance = 1e-300", "rated_voltage = 1e-320", "layer_thickness = 1e300"]
)
def test_facts_beyond_any_rig_are_refused(tmp_path: Path, fact: str) -> None:
    """Their products and powers are beyond what a number holds."""
    name = fact.partition(" ")[0]
    lines = [fact if line.startswith(f"{name} =") else line for line in (TOML + FACTS).split("\n")]
    error = refusal(write(tmp_path, "\n".join(lines)))
    assert error.what.startswith(f"{name} = ") and "is beyond the limits" in error.what
    assert error.line == lines.index(fact) + 1


@pytest.mark.parametrize(("ohm", "farad"), [(1, 180e-9), (50, 6e-9), (0.5, 20e-9), (0.05, 1.5e-6), (1e-6, 1e-15)])
def test_a_good_amplifier_leaves_a_lag_of_its_own(tmp_path: Path, ohm: float, farad: float) -> None:
    """Microseconds, which no resistance says. Nothing of it shows, so that it is no more likely to be at work."""
    facts = FACTS.replace("source_resistance = 50", f"source_resistance = {ohm}")
    experiment = read_experiment(write(tmp_path, TOML + facts.replace("1.5e-6", f"{farad}")))
    (lag,) = Problem(experiment, experiment.ids, terms(["amplifier_lag"])).terms
    assert isinstance(lag.strength.prior, Tailed) and lag.strength.prior.middle[1] == pytest.approx(2e-6, rel=1e-3)
    assert lag.probability == terms(["amplifier_lag"])[0].probability
    assert not lag.strength.is_implausible(0.0) and not lag.strength.is_implausible(4e-6)


def test_every_rating_that_may_be_is_believed(tmp_path: Path) -> None:
    """Up to the bounds of the voltage, whatever they are."""
    (usual,) = (p for p in terms(["anchored_stroke"])[0].parameters if p.name == "anchored_voltage")
    for volts in (usual.bounds.lower, usual.bounds.upper):
        experiment = read_experiment(write(tmp_path / f"{volts:g}", f"{TOML}[rig]\nrated_voltage = {volts!r}\n"))
        known = {p.name: p for p in Problem(experiment, experiment.ids, terms(["anchored_stroke"])).parameters}
        assert known[usual.name].prior == Tailed(LogNormal(volts, 1.1))
