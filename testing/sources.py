"""Sources: small contents for exporters, and files for importers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from gsfw.core.cameras import Cameras
from gsfw.core.exchange import DepthView, Exporter, ExportSource, Holds, SplatFile, TrackFile
from gsfw.core.maths.camera_path import look_at
from gsfw.core.maths.rays import pixel_rays
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.core.temporal_metrics.tracks import Tracks
from gsfw.plugins.loading import load
from gsfw.plugins.rebuild import stored_model
from gsfw.plugins.restore import Restored
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.stress.case import front_camera, random_splats
from gsfw.testing.promise import NotApplicable
from gsfw.testing.subject import Subject
from gsfw.testing.trial import trial

COUNT = 12
"""Splats of a source."""
OFFSET = (60.0, -20.0, 35.0)
"""The middle of the splats in the world, so that a file in another frame is noticed."""
SIZE = 4.0
"""Length of a unit of the splats in the world."""


def splat_file(count: int = COUNT, degree: int = 0) -> SplatFile:
    """Splats in the world of some data, in float64."""
    splats = random_splats(count, degree, dtype=torch.float64)
    assert splats.scales is not None
    means = splats.means * SIZE + torch.tensor(OFFSET, dtype=torch.float64)
    return SplatFile(replace(splats, means=means, scales=splats.scales * SIZE), up="z")


def image_of(splats: Splats) -> torch.Tensor:
    """An image of splats in the world, in float64; [h, w, 3]."""
    scene = splats.map(lambda tensor: tensor.detach().double())
    assert scene.scales is not None
    means = (scene.means - torch.tensor(OFFSET, dtype=torch.float64)) / SIZE
    scene = replace(scene, means=means, scales=scene.scales / SIZE, rows=None)
    cameras = front_camera(dtype=torch.float64)
    rendered = ReferenceRasterizer().render(scene, cameras, RenderSettings())
    return rendered.color[0].detach()


def source_for(subject: Subject, holds: Holds) -> ExportSource:
    """A source with only the content that an exporter names in ``holds``."""
    if holds in (Holds.SPLATS, Holds.MOTION):
        return splat_file()
    if holds is Holds.TRACKS:
        return _tracks()
    if holds is Holds.DEPTHS:
        return RenderedSphere()
    return subject.once("stored model", lambda: _model(subject))


class RenderedSphere(ExportSource):
    """Depth images of a grey sphere of radius 1, from six sides."""

    def depth_views(self) -> list[DepthView]:
        """One view from each side."""
        return [_sphere_from(place) for place in (*torch.eye(3), *-torch.eye(3))]


def _sphere_from(direction: torch.Tensor) -> DepthView:
    """The sphere from three radii away, in 48 x 48 pixels."""
    place = 3.0 * direction.double()
    pose = look_at(place[None], torch.zeros(3).double(), direction.double().roll(1))
    lens = torch.tensor([[55.0, 0, 24], [0, 55, 24], [0, 0, 1]], dtype=torch.float64)
    camera = Cameras(pose, lens[None], 48, 48)
    directions = pixel_rays(camera)[0, ..., 3:]
    along = -(directions @ place)
    root = along**2 - place.square().sum() + 1
    distance = along - root.clamp_min(0).sqrt()
    depth = torch.where(root > 0, distance * (directions @ pose[0, 2, :3]), 0.0).float()
    return DepthView(camera, torch.full((48, 48, 3), 0.5), depth, (depth > 0).float(), up="z")


def _tracks() -> TrackFile:
    generator = torch.Generator().manual_seed(0)
    positions = torch.rand(3, COUNT, 3, generator=generator, dtype=torch.float64)
    opacities = torch.rand(3, COUNT, generator=generator)
    tracks = Tracks((0.0, 0.5, 1.0), positions, opacities)
    return TrackFile(
        tracks, torch.zeros(3, dtype=torch.float64), (0.0, 1.0, 2.0), opacities.new_zeros(COUNT, 3)
    )


def _model(subject: Subject) -> ExportSource:
    run = trial(subject, "model", {"steps": 1})
    trainer = run.trainer()
    composition = run.composition()
    return stored_model(Restored(trainer.folder, composition, {"step": 0}))


def readable_file(subject: Subject) -> Path:
    """A file that an importer recognises: the subject's data, or one that an exporter writes.

    Raises:
        NotApplicable: no installed exporter writes its format.
    """
    if subject.data is not None:
        return subject.data
    importer = subject.target()
    for name, spec in subject.registry.slot("exporter").items():
        exporter: Exporter = load("exporter", spec)()
        if exporter.holds is Holds.SPLATS and exporter.is_readable:
            path = subject.workspace / f"made-by-{name}{exporter.suffix}"
            if not path.exists():
                exporter.write(path, splat_file())
            if importer.recognises(path):
                return path
    raise NotApplicable("no installed exporter writes its format; name a file with data=FILE")
