"""Small stored models for tests of model files."""

import torch

from gsfw.core.cameras import CameraModel
from gsfw.core.column import Layout
from gsfw.core.datamanager import Split, Views
from gsfw.core.exchange import StoredColumn, StoredModel
from gsfw.core.maths.similarity import Similarity
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from support.scenes import front_camera


def camera(**changes):
    fields = {**vars(front_camera(8, 6)), **changes}
    return type(front_camera(8, 6))(**fields)


def some_model(state=None):
    """A model with columns of every layout, and cameras of every kind."""
    generator = torch.Generator().manual_seed(0)
    fisheye = camera(
        model=CameraModel.FISHEYE, time=torch.tensor([1 / 3]), camera_index=torch.tensor([2]),
    )  # fmt: skip
    views = {
        Split.TRAIN: Views(("a/0.png", "ä.png"), (camera(), fisheye), "all"),
        Split.EVAL: Views((), (), "none"),
    }
    scene = Scene(
        "garden", torch.zeros(0, 3), torch.zeros(0, 3),
        torch.cat([c.centers for c in views[Split.TRAIN].cameras]), 1.1,
        Similarity(
            2.0, torch.eye(3, dtype=torch.float64), torch.tensor([5e6, 0.1, 1 / 3]).double()
        ),
        None, (10.0, 14.5), 3, True, "z",
    )  # fmt: skip
    columns = {
        "means": StoredColumn(Layout.DENSE, "means.values"),
        "motion": StoredColumn(Layout.RAGGED, "motion.values", "motion.offsets"),
        "past": StoredColumn(Layout.STACKED, "past.values"),
    }
    usual = {
        "means.values": torch.rand(2, 3, generator=generator),
        "motion.values": torch.rand(3, 1, generator=generator),
        "motion.offsets": torch.tensor([0, 3, 3]),
        "past.values": torch.ones(2, 2, 4, dtype=torch.int16),
        "half": torch.rand(5, generator=generator).half(),
        "flag": torch.tensor(True),
    }
    return StoredModel(
        "mine", "my-package", "1.2", {"method": "mine", "size": 0.1, "list": [1, 2], "none": None},
        70, 2, scene, views, RenderSettings(background=torch.tensor([1.0, 0.5, 0.0])), columns,
        usual if state is None else state,
    )  # fmt: skip
