"""Drawing: the pictures of a run from its model and its data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import UInt8

from gsfw.core.cameras import Cameras, shrunk_to
from gsfw.core.context import ViewContext
from gsfw.core.datamanager import Split, spread
from gsfw.core.loop.determinism import deterministic
from gsfw.core.loop.evaluation import own_images, render_model
from gsfw.core.loop.training_parts import TrainingParts
from gsfw.core.maths.camera_path import at_times, orbit
from gsfw.core.metrics import psnr
from gsfw.core.progress import tracked
from gsfw.core.render_settings import RenderSettings
from gsfw.reports.encoding import animated_webp, fitted, webp
from gsfw.reports.error_image import ErrorImage
from gsfw.reports.pictures import Pictures, ViewPicture

LONGEST, STILL_LONGEST, ORBIT_LONGEST = 480, 960, 400
"""Longest sides of the images of views, of the large still image and of the film, in pixels."""

IMAGE_BYTES, STILL_BYTES, ORBIT_BYTES = 36_000, 120_000, 480_000
"""Most bytes of each: a page has a bounded size."""

LOOP_MS = 3600
"""Duration of the film, in milliseconds."""


@dataclass(frozen=True)
class DrawingRule:
    """Bounds and kind of the drawn images."""

    views: int
    """Most views with images."""
    frames: int
    """Frames of the film; 0 for none."""
    error: ErrorImage
    film_share: float = 1.0
    """Part of ``ORBIT_BYTES`` that the film may take."""


@dataclass(frozen=True)
class Model:
    """The parts of a run that drawing needs."""

    parts: TrainingParts
    settings: RenderSettings
    step: int
    """Number of finished steps."""


def draw_pictures(
    model: Model, worst_first: Sequence[str], rule: DrawingRule, only: Sequence[str] = ()
) -> Pictures:
    """Draw some views beside their photos, and a film around the scene.

    Args:
        model: of the run.
        worst_first: names of the held-out views in order of their error; may be empty.
        rule: what to draw.
        only: views to draw instead of the worst, the median and the best.
    """
    data = model.parts.data
    split = Split.EVAL if len(data.views(Split.EVAL)) else Split.TRAIN
    if not data.has_images:
        chosen: list[tuple[str, str]] = []
    elif only:
        chosen = [(name, "") for name in only]
    else:
        chosen = choose_views(_ordered(model, split, worst_first), rule.views)
        if split is Split.TRAIN or not worst_first:
            chosen = [(name, "") for name, _ in chosen]
    with deterministic(model.parts.device):
        views, still, still_name = _draw_views(model, split, chosen, rule.error)
        film = _film(model, rule.frames) if rule.frames else []
    most = round(ORBIT_BYTES * rule.film_share)
    return Pictures(
        step=model.step,
        split=split.value,
        error=rule.error.words,
        views=tuple(views),
        still=still,
        still_name=still_name,
        is_still_median=bool(still and worst_first and split is Split.EVAL),
        orbit=animated_webp(film, LOOP_MS // len(film), most) if film else b"",
        is_moving=data.scene.is_dynamic,
    )


def choose_views(worst_first: Sequence[str], most: int) -> list[tuple[str, str]]:
    """Names and labels of at most ``most`` views: the worst, the median and the best, in order.

    More than half are the worst ones, since these show what is wrong.
    """
    count = len(worst_first)
    if count <= most:
        return [(name, "") for name in worst_first]
    others = min(max(most // 4, 1), (most - 1) // 2)
    worst = most - 2 * others
    middle = min(max((count - others) // 2, worst), count - 2 * others)
    places = {place: "worst" for place in range(worst)}
    places |= {place: "median" for place in range(middle, middle + others)}
    places |= {place: "best" for place in range(count - others, count)}
    return [(worst_first[place], label) for place, label in places.items()]


def _ordered(model: Model, split: Split, worst_first: Sequence[str]) -> list[str]:
    """Names that the split has; some of all views where nothing is known of their errors."""
    names = model.parts.data.views(split).names
    known = set(names)
    found = [name for name in worst_first if name in known]
    return found or [names[index] for index in spread(range(len(names)), 6)]


def _draw_views(
    model: Model, split: Split, chosen: Sequence[tuple[str, str]], error: ErrorImage
) -> tuple[list[ViewPicture], bytes, str]:
    """The chosen views, the worst first, and the render of the median one at a larger size."""
    parts, settings = model.parts, model.settings
    assert settings.background is not None
    places = {name: index for index, name in enumerate(parts.data.views(split).names)}
    middle = next((n for n, label in chosen if label == "median"), None)
    middle = middle or (chosen[len(chosen) // 2][0] if chosen else "")
    drawn, still = [], b""
    for name, label in tracked(chosen, "drawing views for the report", len(chosen)):
        if name not in places:
            continue
        (batch,) = parts.data.load(split, [places[name]], parts.device)
        output = render_model(parts.model, parts.rasterizer, batch.cameras, settings, batch.time)
        targets = batch.target(settings.background)
        rendered, target = output.color[0], targets[0]
        valid = None if batch.valid is None else batch.valid[0]
        counted = rendered if valid is None else torch.where(valid, rendered, target)
        photo, image = fitted(target, LONGEST), fitted(rendered, LONGEST)
        wrong = error.draw(fitted(counted, LONGEST), photo)
        files = [webp(item, IMAGE_BYTES) for item in (photo, image, wrong)]
        context = ViewContext(batch, output, targets, parts.data.scene.extent)
        own = {
            kind: webp(fitted(item, LONGEST), IMAGE_BYTES)
            for kind, item in own_images(parts.method, context).items()
        }
        figure = psnr(rendered, target, valid)
        drawn.append(ViewPicture(name, label, figure, files[0], files[1], files[2], own))
        if name == middle:
            still = webp(fitted(rendered, STILL_LONGEST), STILL_BYTES)
    drawn.sort(key=lambda view: math.inf if math.isnan(view.psnr) else view.psnr)
    return drawn, still, middle


def _film(model: Model, frames: int) -> list[UInt8[np.ndarray, "h w 3"]]:
    """Frames around the scene; where it moves, time passes from the first to the last one."""
    parts = model.parts
    cameras = _orbit(model, frames).to(parts.device)
    known: dict[bytes, UInt8[np.ndarray, "h w 3"]] = {}
    drawn = []
    for index in tracked(range(frames), "drawing an orbit for the report", frames):
        camera = cameras.select([index])
        time = None if camera.time is None else camera.time[0]
        # An arc goes to and fro: each place is drawn once.
        place = camera.world_to_camera.double().round(decimals=6).cpu().numpy().tobytes()
        place += b"" if time is None else str(float(time)).encode()
        if place not in known:
            output = render_model(parts.model, parts.rasterizer, camera, model.settings, time)
            known[place] = fitted(output.color[0], ORBIT_LONGEST)
        drawn.append(known[place])
    return drawn


def _orbit(model: Model, frames: int) -> Cameras:
    """A path around the scene, seen through the lens of the first training view."""
    data = model.parts.data
    views = data.views(Split.TRAIN).cameras
    alike = [replace(views[0], world_to_camera=camera.world_to_camera) for camera in views]
    cameras = shrunk_to(orbit(Cameras.cat(alike), frames), ORBIT_LONGEST)
    if not data.scene.is_dynamic:
        return cameras
    return at_times(cameras, [index / max(frames - 1, 1) for index in range(frames)])
