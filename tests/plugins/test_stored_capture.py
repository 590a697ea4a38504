"""A stored capture has cameras, and says that it has no images."""

import pytest
import torch
from support.scenes import front_camera

from gsfw.core.datamanager import Split, Views
from gsfw.core.errors import DataError
from gsfw.core.scene import Scene
from gsfw.plugins.stored_capture import StoredCapture


def test_cameras_are_there_and_images_are_not():
    none = torch.zeros(0, 3)
    scene = Scene("garden", none, none, torch.zeros(1, 3), 1.0)
    views = {Split.TRAIN: Views(("a",), (front_camera(8, 6),)), Split.EVAL: Views((), ())}
    capture = StoredCapture(scene, views, "a.gsfw")
    assert capture.scene is scene
    assert capture.views(Split.TRAIN).names == ("a",)
    assert not capture.has_images
    with pytest.raises(DataError) as caught:
        capture.load(Split.TRAIN, [0], torch.device("cpu"))
    assert str(caught.value) == (
        "a.gsfw contains no images, only the cameras that took them.\n"
        "Add data=PATH with the data set it was trained on, or render what needs no images: "
        "gsfw render a.gsfw what=orbit"
    )
    made = StoredCapture(scene, views, "a.gsfw", has_data=False)
    with pytest.raises(DataError) as caught:
        made.load(Split.TRAIN, [0], torch.device("cpu"))
    assert caught.value.advice == (
        "It was trained on the built-in scene, not on a data set: give the run's folder, or render "
        "what needs no images: gsfw render a.gsfw what=orbit"
    )
