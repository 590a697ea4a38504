"""Tests of gsfw.commands.stress."""

import json
from pathlib import Path

import pytest

from gsfw.commands.main import main
from gsfw.studies.stress.catalogue import CASES
from gsfw.studies.stress.runner import NAMES

FEW = ("rasterizer=reference", "method=none", "out=none")


def document(capsys, *arguments: str, code: int = 0) -> dict:
    assert main(["stress", *arguments, "json=true"]) == code
    return json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_the_document_has_a_record_for_each_case(capsys):
    found = document(capsys, *FEW, "only=shape/discs,input/skew")
    assert len(found["cases"]) == 2 * 6 + 1
    first = found["cases"][0]
    assert first["name"] == "shape/discs"
    assert {"section", "backend", "dtype", "note"} < first.keys()
    assert first["passed"] is first["finite"] is first["deterministic"] is True
    assert 0 < first["forward"] < 1e-5
    assert {"means", "quats", "scales", "opacities", "colors"} <= first["gradient"].keys()
    refused = found["cases"][-1]
    assert refused["name"] == "input/skew"
    assert refused["refused"].startswith("cameras.intrinsics: expected no skew")
    assert refused["forward"] is None
    none = {"failed": 0, "not_claimed": 0, "left_out": []}
    assert found["totals"] == [
        {"backend": "reference", "dtype": "float32", "passed": 7, **none},
        {"backend": "reference", "dtype": "float64", "passed": 6, **none},
    ]
    assert found["planes"] == []


def test_people_get_a_table_for_each_backend_and_the_totals(capsys):
    assert main(["stress", *FEW, "dtype=float32", "only=shape/discs,input/skew"]) == 0
    text = capsys.readouterr().out
    assert "reference, float32\ncase " in text
    assert "passed, ill-conditioned" in text
    assert "passed, refused: cameras.intrinsics: expected no skew" in text
    assert text.endswith("reference, float32: 7 passed, 0 failed\n")


def test_a_dynamic_method_is_held_to_the_cases_of_time(capsys):
    found = document(
        capsys, "rasterizer=reference", "method=dynamic3dgs", "only=time", "out=none",
        "dtype=float32",
    )  # fmt: skip
    assert {case["backend"] for case in found["cases"]} == {"dynamic3dgs"}
    outside = next(case for case in found["cases"] if case["name"] == "time/outside")
    assert outside["passed"]
    assert outside["claimed"]
    polynomials = next(case for case in found["cases"] if case["name"] == "time/polynomials")
    assert not polynomials["passed"]
    assert not polynomials["claimed"]
    assert polynomials["note"] == "needs columns motion"


def test_a_failure_is_told_and_is_the_exit_code(capsys, monkeypatch):
    monkeypatch.setattr("gsfw.studies.stress.judgement.PIXEL", 0.0)
    arguments = (*FEW, "dtype=float32", "only=colour/degree-1")
    assert main(["stress", *arguments]) == 1
    text = capsys.readouterr().out
    assert "\nfailed:\n  reference, float32, colour/degree-1: color: " in text
    assert text.endswith("reference, float32: 0 passed, 1 failed\n")
    assert not document(capsys, *arguments, code=1)["cases"][0]["passed"]


def test_the_heat_map_is_written_where_it_is_asked_for(capsys, tmp_path, monkeypatch):
    from gsfw.studies.stress import plane

    small = plane.Plane("p", "x", "y", (0.1, 1.0), (4.0,), plane.PLANES[0].make)
    monkeypatch.setattr(plane, "PLANES", (small,))
    path = tmp_path / "map.png"
    arguments = ("rasterizer=reference", "method=none", "only=input/skew", "dtype=float32")
    found = document(capsys, *arguments, f"out={path}")
    assert path.is_file()
    assert found["image"] == str(path)
    assert found["planes"][0]["across"] == {"name": "x", "values": [0.1, 1.0]}


def test_all_cases_can_be_listed_without_being_run(capsys):
    assert main(["stress", "list=true"]) == 0
    text = capsys.readouterr().out
    assert f"{len(NAMES)} cases" in text
    assert all(name in text for name in CASES)


def test_rasterizers_that_do_not_run_here_are_named(capsys, monkeypatch):
    from gsfw.core.capabilities import Capabilities
    from gsfw.studies import entrants

    able = {
        "reference": Capabilities(devices=frozenset({"cpu"})),
        "far": Capabilities(unavailable="it needs another machine."),
        "other": Capabilities(devices=frozenset({"cpu"}), rule="rays"),
    }
    monkeypatch.setattr(entrants, "rasterizer_capabilities", lambda registry: able)
    assert main(["stress", "method=none", "out=none", "only=input/skew"]) == 0
    text = capsys.readouterr().out
    assert "rasterizer far is left out: it needs another machine." in text
    assert "rasterizer other is left out: it renders by another rule than splatting's" in text


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("only=shap", "error: only=shap: no case has this name."),
        ("rasterizer=cpo", "error: no rasterizer 'cpo'. Did you mean 'cpu'?"),
        (
            "method=3dgs",
            "error: method=3dgs: it is not dynamic, and all cases for methods are cases",
        ),
        ("method=5dgs", "error: no method '5dgs'."),
        ("dtype=float16", "error: dtype=float16: expected"),
    ],
)
def test_mistakes_are_told_in_one_message(capsys, argument, message):
    assert main(["stress", argument, "out=none"]) == 2
    assert capsys.readouterr().err.startswith(message)


def test_the_help_shows_every_key(capsys):
    assert main(["stress", "--help"]) == 0
    text = capsys.readouterr().out
    assert all(key in text for key in ("rasterizer", "method", "dtype", "only", "out", "list"))


def test_nothing_is_written_without_a_heat_map(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["stress", *FEW, "only=input/skew"]) == 0
    assert not list(Path().iterdir())
    assert "written" not in capsys.readouterr().out
