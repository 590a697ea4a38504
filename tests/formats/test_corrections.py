"""Corrections of the capture on the command line: resumed, exported, read again."""

import json
from pathlib import Path

import pytest
import torch
from support.resuming import resumes_to_the_same_bits

from gsfw.commands.main import main
from gsfw.core.datamanager import Split
from gsfw.core.loop.run_folder import RunFolder
from gsfw.formats.corrections import refined_transforms
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore

# Whole runs; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

SMALL = (
    "method=3dgs", "device=cpu", "datamanager.views=4", "datamanager.eval_views=1",
    "datamanager.width=32", "datamanager.height=24", "datamanager.points=100", "steps=6",
)  # fmt: skip
CORRECTED = ("exposure=true", "refine_poses=true", "optim.exposure_start=0", "optim.poses_start=0")


@pytest.mark.slow
def test_a_corrected_run_of_a_moving_scene_resumes_to_the_same_bits(tmp_path):
    typed = ("method=spacetime", *CORRECTED)
    summary = resumes_to_the_same_bits(tmp_path, *typed)
    assert summary["pose_degrees"] > 0
    assert summary["exposure_least"] < 1 < summary["exposure_most"]


def test_what_was_learnt_is_written_into_the_run_and_beside_exports(tmp_path, capsys):
    run, elsewhere = tmp_path / "run", tmp_path / "elsewhere"
    assert main(["train", *SMALL, *CORRECTED, f"out={run}"]) == 0
    files = ("exposures.json", "refined_transforms.json")
    assert f", {', '.join(files)}, " in capsys.readouterr().out
    elsewhere.mkdir()
    assert main(["export", str(run), f"out={elsewhere / 'moved.ply'}"]) == 0
    for name in files:
        assert (elsewhere / name).read_bytes() == (run / name).read_bytes()
    exposures = json.loads((run / files[0]).read_text())["exposures"]
    assert list(exposures) == ["train_000", "train_001", "train_002", "train_003"]


def test_a_run_that_corrects_nothing_writes_nothing_of_it(tmp_path):
    assert main(["train", *SMALL, f"out={tmp_path / 'run'}"]) == 0
    assert not [path for path in (tmp_path / "run").iterdir() if path.suffix == ".json"
                and path.name not in ("metrics.json", "requirements.json")]  # fmt: skip


def test_refined_cameras_are_exported_in_the_world_of_the_data(tmp_path):
    assert main(["train", *SMALL, *CORRECTED, f"out={tmp_path / 'run'}"]) == 0
    restored = restore(RunFolder(tmp_path / "run"), installed())
    parts = restored.composition.parts
    data = parts.data
    document = json.loads((tmp_path / "run/refined_transforms.json").read_text())
    assert document == json.loads(json.dumps(refined_transforms(data)))
    assert document["test_filenames"] == ["eval_000"]
    points = data.scene.points
    world = data.scene.world_from_scene.apply(points)
    for split, first in ((Split.TRAIN, 0), (Split.EVAL, 4)):
        for frame, camera in zip(
            document["frames"][first:], data.views(split).cameras, strict=False
        ):
            pose = torch.tensor(frame["transform_matrix"], dtype=torch.float64)
            pose = torch.linalg.inv(pose @ torch.diag(torch.tensor([1.0, -1, -1, 1]).double()))
            x, y, z = (world @ pose[:3, :3].T + pose[:3, 3]).unbind(1)
            found = torch.stack(
                [frame["fl_x"] * x / z + frame["cx"], frame["fl_y"] * y / z + frame["cy"]], dim=1
            )
            local = points @ camera.world_to_camera[0, :3, :3].T + camera.world_to_camera[0, :3, 3]
            seen = local @ camera.intrinsics[0].T
            assert float((found - seen[:, :2] / seen[:, 2:]).abs().max()) < 1e-3


def test_a_model_file_keeps_the_refined_cameras(tmp_path):
    run, file = tmp_path / "run", tmp_path / "model.gsfw"
    assert main(["train", *SMALL, *CORRECTED, f"out={run}"]) == 0
    assert main(["export", str(run), "format=gsfw", f"out={file}"]) == 0
    assert (
        main(["render", str(file), "what=orbit", "frames=2", f"out={Path(tmp_path / 'film')}"]) == 0
    )
