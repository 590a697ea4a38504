"""The benchmark of corrections makes training views wrong, and held-out views never."""

import corrections
import pytest
import torch

from gsfw.core.datamanager import Split
from gsfw.plugins.opening import open_data

SMALL = ["datamanager.views=10", "datamanager.width=32", "datamanager.height=24"]


@pytest.fixture(scope="module")
def given():
    return open_data(corrections.settings_of(SMALL))


def batch_of(data, split):
    (batch,) = data.load(split, [0], torch.device("cpu"))
    return batch


@pytest.mark.parametrize("fault", sorted(corrections.FAULTS))
def test_faults_are_of_training_views_alone(fault, given):
    wrong = corrections.FAULTS[fault](given)
    for split in Split:
        before, after = batch_of(given, split), batch_of(wrong, split)
        same_pose = torch.equal(before.cameras.world_to_camera, after.cameras.world_to_camera)
        is_right = same_pose and torch.equal(before.images, after.images)
        assert is_right == (split is Split.EVAL or fault == "none")


@pytest.mark.slow
def test_each_row_has_a_line_with_both_figures(capsys):
    corrections.main(
        ["-", "--rows", "strategy=none", "exposure=true", "--settings", "steps=2", *SMALL]
    )
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" | ")[2] for line in lines[2:]] == ["strategy=none", "exposure=true"]
    assert all(len(line.split(" | ")) == len(lines[0].split(" | ")) == 6 for line in lines[2:])
