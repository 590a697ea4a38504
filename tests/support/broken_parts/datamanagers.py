"""Data managers that break a promise."""

import random
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from gsfw.core.batch import Batch
from gsfw.core.config import Detection
from gsfw.core.datamanager import WrappedDataManager
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from support.broken_parts.registry import breaks


@dataclass
class _Scene(SyntheticConfig):
    """The built-in scene at its smallest, with a fault."""

    views: int = 6
    """Training views."""
    eval_views: int = 2
    """Held-out views."""
    width: int = 24
    """Width."""
    height: int = 18
    """Height."""
    points: int = 80
    """Points."""

    def build(self, request):
        return type(self).wrapper(super().build(request))


def _data(promise: str, **members):
    wrapper = type("Faulty", (WrappedDataManager,), members)
    name = f"Data_{promise.replace('-', '_')}"
    config = dataclass(
        type(name, (_Scene,), {"wrapper": wrapper, "__module__": __name__, "__doc__": "Faulty."})
    )
    globals()[name] = breaks("datamanager", promise)(config)


def _with_images(change):
    def load(self, split, indices, device):
        return [change(batch) for batch in self.given.load(split, indices, device)]

    return load


def _skewed_views(self, split):
    views = self.given.views(split)
    cameras = [
        replace(camera, world_to_camera=camera.world_to_camera * 1.1) for camera in views.cameras
    ]
    return replace(views, cameras=tuple(cameras))


def _same_names(self, split):
    views = self.given.views(split)
    return replace(views, names=tuple(f"view_{n}" for n in range(len(views))))


def _random_image(batch: Batch) -> Batch:
    return replace(batch, images=torch.full_like(batch.images, random.random()))


_data("loads-the-same", load=_with_images(_random_image))
_data("views-are-sound", views=_skewed_views)
_data("batches-fit-their-views", load=_with_images(lambda b: replace(b, images=b.images * 255)))
_data("splits-are-disjoint", views=_same_names)
_data("masks-fit-their-images", load=_with_images(
    lambda b: replace(b, mask=torch.zeros_like(b.images[..., :1], dtype=torch.bool))
))  # fmt: skip


@breaks("datamanager", "recognises-its-format")
@dataclass
class Greedy(SyntheticConfig):
    @classmethod
    def detect(cls, path: Path) -> Detection:
        return Detection(True, "anything", "something")


@breaks("datamanager", "downscale-halves")
@dataclass
class NeverShrinks(_Scene):
    wrapper = WrappedDataManager

    def build(self, request):
        return super().build(replace(request, downscale=1.0))


@breaks("datamanager", "missing-data-is-named")
@dataclass
class AcceptsAnything(_Scene):
    wrapper = WrappedDataManager

    def build(self, request):
        return super().build(replace(request, path=None))


@breaks("datamanager", "damaged-files-are-named")
@dataclass
class ReadsText(_Scene):
    wrapper = WrappedDataManager

    def build(self, request):
        assert len((request.path / "poses.txt").read_text().split()) == 4
        return super().build(replace(request, path=None))
