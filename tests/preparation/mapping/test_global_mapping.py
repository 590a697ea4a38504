import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from support.matched_captures import matched_capture

from gsfw.core.errors import DataError
from gsfw.preparation.mapping.global_mapping import LOG, run_global
from gsfw.preparation.mapping.mapping_rule import MappingRule


class Interrupted(subprocess.Popen[bytes]):
    """A process during which Ctrl-C is pressed at once."""

    last: "Interrupted"

    def __init__(self, command: Sequence[str], **options: Any) -> None:
        super().__init__(command, **options)
        Interrupted.last = self
        self.pressed = False

    def wait(self, timeout: float | None = None) -> int:
        if not self.pressed:
            self.pressed = True
            raise KeyboardInterrupt
        return super().wait(timeout)


def test_ctrl_c_kills_the_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = matched_capture(tmp_path, 4)
    (tmp_path / "models").mkdir()
    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_global(capture.database, tmp_path / "models", MappingRule(mapper="global"))
    assert Interrupted.last.returncode not in (None, 0)


def test_a_process_that_fails_is_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = matched_capture(tmp_path, 4)
    (tmp_path / "models").mkdir()
    monkeypatch.setattr("sys.executable", "false")
    with pytest.raises(DataError) as failure:
        run_global(capture.database, tmp_path / "models", MappingRule(mapper="global"))
    assert failure.value.message == (
        f"COLMAP could not compute camera poses at once with {capture.database}: "
        "it stopped without a message."
    )
    assert not (tmp_path / "models" / "database.db").exists()
    assert (capture.database.parent / LOG).is_file()
