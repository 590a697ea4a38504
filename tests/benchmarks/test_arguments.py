"""Benchmarks explain themselves, and answer wrong arguments and unsuitable runs in a sentence."""

from importlib import import_module

import pytest


@pytest.mark.parametrize(
    "name", ["city", "corrections", "file_memory", "remaining_time", "scaling_plan", "tracks"]
)
def test_help_is_shown(name, capsys):
    with pytest.raises(SystemExit) as ended:
        import_module(name).main(["--help"])
    assert ended.value.code == 0
    assert f"python benchmarks/{name}.py" in capsys.readouterr().out


def test_an_unknown_setting_of_the_city_is_named(tmp_path, capsys):
    with pytest.raises(SystemExit):
        import_module("city").main([str(tmp_path), "tile=3x3"])
    assert "unknown setting 'tile'. Settings: tiles, views," in capsys.readouterr().err


def test_runs_that_are_too_short_to_be_judged_are_told(finished_run, capsys):
    import_module("remaining_time").main(["0.25", str(finished_run)])
    said = "No run is finished and has 30 logged steps. Name longer runs.\n"
    assert capsys.readouterr().out == said


def test_a_run_of_the_still_scene_has_no_tracks(finished_run, capsys):
    with pytest.raises(SystemExit):
        import_module("tracks").main([str(finished_run)])
    assert "is of the built-in still scene. Name a run of the moving" in capsys.readouterr().err
