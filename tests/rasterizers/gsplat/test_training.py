"""A run with rasterizer=gsplat draws with gsplat's constants, and says so."""

import json

import pytest
import yaml

from gsfw.commands.main import main
from gsfw.core.errors import ConfigError
from gsfw.plugins.compose import check
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, Settings, resolve
from gsfw.rasterizers.gsplat import package

SMALL = ("datamanager.views=4", "datamanager.eval_views=1", "datamanager.width=32")
SMALL += ("datamanager.height=24", "datamanager.points=100", "device=cpu", "steps=6")


@pytest.fixture
def works_here(adapter, monkeypatch) -> None:
    """gsplat, as a rasterizer that draws on this machine."""
    monkeypatch.setattr(package, "unavailable", str)


def settings(**values: str) -> Settings:
    return resolve(
        installed(), [Layer(COMMAND_LINE, {"method": "3dgs", "device": "cpu", **values})]
    )


def test_the_profile_follows_the_rasterizer(works_here, monkeypatch):
    found = settings(rasterizer="gsplat")
    assert found.config.profile == "gsplat-1.5"
    assert found.sources["profile"] == (
        "chosen automatically: the only one that rasterizer gsplat draws with"
    )
    check(found, installed())
    assert settings(rasterizer="reference").config.profile == "default"
    assert settings(rasterizer="reference", profile="gsplat-1.5").config.profile == "gsplat-1.5"
    monkeypatch.setattr(package, "version", lambda: "1.6.0")
    assert settings(rasterizer="gsplat").config.profile == "default"


def test_another_profile_is_refused_before_anything_is_read(works_here):
    with pytest.raises(ConfigError) as caught:
        check(settings(rasterizer="gsplat", profile="default"), installed())
    assert caught.value.message == (
        "rasterizer 'gsplat' does not fit:\n"
        "  method '3dgs' needs numerics 'default' (it renders only with 'gsplat-1.5')"
    )


def test_a_profile_that_was_asked_for_is_minded_when_the_rasterizer_is_chosen(
    works_here, monkeypatch
):
    monkeypatch.setattr("gsfw.rasterizers.cpu.rasterizer.instruction_sets", list)
    monkeypatch.setattr("gsfw.rasterizers.cpu.rasterizer.instruction_set", str)
    assert settings().choices["rasterizer"].name == "gsplat"
    assert settings(profile="default").choices["rasterizer"].name == "reference"


@pytest.mark.slow
def test_it_trains_and_the_run_keeps_its_profile(works_here, tmp_path, capsys):
    out = tmp_path / "run"
    assert main(["train", "method=3dgs", "rasterizer=gsplat", *SMALL, f"out={out}"]) == 0
    saved = yaml.safe_load((out / "config.yaml").read_text())
    assert (saved["rasterizer"], saved["profile"]) == ("gsplat", "gsplat-1.5")
    assert "profile" not in saved["given"]
    assert "gsplat-1.5" in json.dumps(json.loads((out / "metrics.json").read_text()))
    assert main(["eval", str(out)]) == 0
    capsys.readouterr()


def test_doctor_says_in_one_line_why_it_cannot_draw(monkeypatch, capsys):
    monkeypatch.setattr(package, "unavailable", lambda: "gsplat is not installed; pip install it")
    main(["doctor", "json=true"])
    findings = json.loads(capsys.readouterr().out)["findings"]
    line = next(item for item in findings if item["what"] == "rasterizer gsplat")
    assert line["status"] == "missing"
    assert line["details"] == "gsplat is not installed; pip install it"
