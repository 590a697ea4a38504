"""Errors of one of several processes, and what they say; without other processes."""

import pytest

from gsfw.commands.interface.team import _own_errors_told
from gsfw.core.errors import ConfigError, DataError, LostProcessError, OutputError
from gsfw.parallel.environment import LINGER, patience


@pytest.fixture
def follower(monkeypatch):
    for name, value in {"RANK": "1", "WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1"}.items():
        monkeypatch.setenv(name, value)


@pytest.mark.parametrize("kind", [OutputError, DataError])
def test_an_error_that_only_a_follower_has_is_printed_with_its_number(follower, capsys, kind):
    with pytest.raises(SystemExit) as ended, _own_errors_told():
        raise kind("the disk is full: /tmp/x could not be written.", "Free some space.")
    assert ended.value.code == 2
    printed = capsys.readouterr().err
    assert printed == (
        "error: process 1: the disk is full: /tmp/x could not be written.\nFree some space.\n"
    )


def test_an_error_that_all_processes_have_is_left_to_the_first(follower, capsys):
    with pytest.raises(ConfigError), _own_errors_told():
        raise ConfigError("all have it.", "")
    assert capsys.readouterr().err == ""


def test_the_first_process_has_time_for_its_message_when_another_one_loses_it(
    follower, capsys, monkeypatch
):
    waits = []
    monkeypatch.setattr("time.sleep", waits.append)
    with pytest.raises(SystemExit) as ended, _own_errors_told():
        raise LostProcessError("it does not answer.", "")
    assert (ended.value.code, waits) == (1, [LINGER])
    assert capsys.readouterr().err == ""


def test_patience_is_a_number_of_minutes(monkeypatch):
    assert patience() == 30
    monkeypatch.setenv("GSFW_PATIENCE", "0.5")
    assert patience() == 0.5
    monkeypatch.setenv("GSFW_PATIENCE", "soon")
    with pytest.raises(ConfigError, match="GSFW_PATIENCE=soon is no number of minutes"):
        patience()
