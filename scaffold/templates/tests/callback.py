"""Tests of callback my-part."""

from gsfw.api import Control, RunInfo, StepReport
from gsfw.testing import conformance

from my_part.callback import MyPart

test_conforms = conformance("callback", "my-part")


def test_every_logged_step_is_a_line(tmp_path):
    callback = MyPart(every=2)
    callback.on_start(RunInfo(tmp_path, "3dgs", "scene", 30, 0, {}, {}), Control())
    for step in (10, 20, 30):
        report = StepReport(step, 0.5, {"l1": 0.5}, 20.0, 100, {}, 1.0)
        callback.on_step(report, Control())
    lines = (tmp_path / "losses.csv").read_text().splitlines()
    assert lines == ["step,gaussians,l1", "10,100,0.5", "30,100,0.5"]
