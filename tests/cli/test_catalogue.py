"""`psafit terms`."""

from __future__ import annotations

import json
from pathlib import Path

from commands import run


def test_terms(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    from psafit.physics import TERMS

    assert run(monkeypatch, "terms", "--json", tmp_path / "t.json") == 0
    said = capsys.readouterr().out.splitlines()
    assert max(len(line) for line in said) <= 120 and any("sigma_abs (um)" in line for line in said)
    assert [line.split()[0] for line in said if line.startswith("  ") and line[2] != " "] == [t.id for t in TERMS]
    listed = json.loads((tmp_path / "t.json").read_text())
    assert [entry["id"] for entry in listed] == [t.id for t in TERMS]
    by_id = {entry["id"]: entry for entry in listed}
    assert by_id["hysteresis"]["path"] == "stepper" and by_id["modal_mass"]["path"] == "closed form"
    assert [p["neutral"] for p in by_id["hysteresis"]["parameters"]] == [0.0, None]
    assert by_id["gap"]["parameters"][0]["unit"] == "m" and by_id["gap"]["parameters"][0]["bounds"] == [0.0, 2e-5]
    assert by_id["start_phase"]["symptom"]["waveforms"] == ["sine"] and by_id["start_phase"]["latent"] is None
    assert by_id["reading_gain"]["latent"]["symbol"] == "z"
    for entry in listed:
        assert all(entry[key] for key in ("title", "slot", "equation", "description", "reference", "checks"))
        assert all(p["prior"] and p["source"] and p["description"] for p in entry["parameters"])


def test_one_cause_in_full(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    from psafit.physics import TERMS

    for t in TERMS:
        assert run(monkeypatch, "terms", t.id) == 0
        said = " ".join(capsys.readouterr().out.split())
        on = " and ".join(f"{name}s" for name in t.symptom.waveforms)
        wanted = [t.title, f"on {on}: ", t.symptom.text, t.reference, *(c.working for c in t.checks)]
        wanted += [text for p in t.parameters for text in (p.name, p.description, p.source, p.prior.describe())]
        assert all(" ".join(text.split()) in said for text in wanted)
        assert ":math:" not in said
    assert run(monkeypatch, "terms", "gap", "--quiet", "--json", tmp_path / "t.json") == 0
    assert capsys.readouterr().out == ""
    assert [entry["id"] for entry in json.loads((tmp_path / "t.json").read_text())] == ["gap"]
    assert run(monkeypatch, "terms", "gap_width") == 0 and capsys.readouterr().out.startswith("gap: ")
    assert run(monkeypatch, "terms", "k_c", "--json", tmp_path / "p.json") == 0
    assert "k_c (N/m): contact stiffness" in capsys.readouterr().out
    assert [entry["name"] for entry in json.loads((tmp_path / "p.json").read_text())] == ["k_c"]
    assert run(monkeypatch, "terms", "hertz") == 2
    assert "did you mean hertz_exponent" in capsys.readouterr().err
