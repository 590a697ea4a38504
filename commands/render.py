"""`gsfw render RUN`: pictures of a trained model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from gsfw.commands.arguments import read
from gsfw.commands.run_options import RunOptions

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from gsfw.core.cameras import Cameras
    from gsfw.plugins.restore import Restored

FRAME_MS = 50
"""How long each frame of the animation is shown, in milliseconds."""


@dataclass(kw_only=True)
class RenderOptions(RunOptions):
    """Draw the held-out views and an orbit around the scene, as PNG and an animated WebP."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw render latest",
        "gsfw render runs/first what=orbit frames=120 scale=2 out=orbit",
    )

    what: Literal["all", "views", "orbit"] = "all"
    """What to draw: views (held out, beside their photos), orbit, or all."""
    out: str = ""
    """Folder for the pictures. Empty: renders/ in the run."""
    frames: int = 60
    """Number of frames of the orbit."""
    scale: float = 1.0
    """Size of the orbit's pictures, relative to those the run was trained on."""
    time: float = 0.0
    """When the orbit is drawn, in [0, 1]; a static model ignores it."""


def run(arguments: list[str]) -> int:
    """Draw, and say where the pictures are."""
    options = read("render", RenderOptions, arguments)

    from gsfw.commands.console import Console
    from gsfw.commands.run_argument import find_run
    from gsfw.core.determinism import deterministic
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.registry import installed
    from gsfw.plugins.restore import restore

    if options.frames < 1 or options.scale <= 0 or not 0 <= options.time <= 1:
        raise ConfigError(
            f"frames={options.frames} scale={options.scale:g} time={options.time:g}: "
            "expected at least 1 frame, a scale above 0, and a time in [0, 1]."
        )
    console = Console(options.json)
    found = find_run(options.run)
    restored = restore(found.folder, installed(), found.checkpoint, options.changed())
    out = Path(options.out) if options.out else found.folder.path / "renders"
    written: list[Path] = []
    with deterministic(restored.composition.parts.device):
        if options.what in ("all", "views"):
            written += _progress(_views(restored, out / "views"), _count_views(restored), "views")
        if options.what in ("all", "orbit"):
            pictures = _orbit(restored, out / "orbit", options)
            written += _progress(pictures, options.frames, "orbit")
            written.append(_animate(out / "orbit.webp", written[-options.frames :]))
    console.say(f"{len(written)} pictures in {out}")
    console.result({"run": str(found.folder.path), "written": [str(path) for path in written]})
    return 0


def _progress(pictures: Iterator[Path], total: int, name: str) -> list[Path]:
    """Draw all, showing how far it is."""
    from rich.console import Console as Screen
    from rich.progress import track

    screen = Screen(stderr=True)
    if not screen.is_terminal:
        return list(pictures)
    return list(track(pictures, description=name, total=total, console=screen))


def _count_views(restored: Restored) -> int:
    from gsfw.core.datamanager import Split

    return len(restored.composition.parts.data.views(Split.EVAL))


def _views(restored: Restored, folder: Path) -> Iterator[Path]:
    """Every held-out view, the photo at the left and the render at the right."""
    import torch

    from gsfw.core.datamanager import Split
    from gsfw.core.evaluation import draw

    parts, settings = restored.composition.parts, restored.composition.plan.settings
    assert settings.background is not None
    for index, name in enumerate(parts.data.views(Split.EVAL).names):
        (batch,) = parts.data.load(Split.EVAL, [index], parts.device)
        output = draw(parts.model, parts.rasterizer, batch.cameras, settings, batch.time)
        both = torch.cat([batch.target(settings.background)[0], output.color[0]], dim=1)
        # Numbered and flat: names of the data may be absolute, lead elsewhere, or be equal.
        yield _write(folder / f"{index:04d}_{Path(name).stem}.png", both)


def _orbit(restored: Restored, folder: Path, options: RenderOptions) -> Iterator[Path]:
    """A circle around the scene, frame by frame."""
    import torch

    from gsfw.core.camera_path import orbit
    from gsfw.core.cameras import Cameras
    from gsfw.core.datamanager import Split
    from gsfw.core.evaluation import draw

    parts, settings = restored.composition.parts, restored.composition.plan.settings
    views = parts.data.views(Split.TRAIN).cameras
    cameras = Cameras.cat([_like(camera, views[0]) for camera in views])
    path = orbit(cameras, options.frames)
    path = path.resized(
        max(round(path.width * options.scale), 1), max(round(path.height * options.scale), 1)
    ).to(parts.device)
    time = torch.tensor(options.time, device=parts.device)
    for index in range(options.frames):
        output = draw(parts.model, parts.rasterizer, path.select([index]), settings, time)
        yield _write(folder / f"{index:04d}.png", output.color[0])


def _like(camera: Cameras, first: Cameras) -> Cameras:
    """Where a camera is, with the first one's lens and size: mixed sets have one orbit too."""
    from dataclasses import replace

    return replace(first, world_to_camera=camera.world_to_camera)


def _write(path: Path, picture: Float[Tensor, "h w 3"]) -> Path:
    """Write a PNG, whole or not at all."""
    import io

    from PIL import Image

    from gsfw.core.run_folder import write_atomically

    values = (picture.clamp(0, 1) * 255).round().byte().cpu().numpy()
    buffer = io.BytesIO()
    Image.fromarray(values).save(buffer, "PNG")
    write_atomically(path, buffer.getvalue())
    return path


def _animate(path: Path, frames: list[Path]) -> Path:
    """The frames as one animated WebP, which browsers show."""
    import io

    from PIL import Image

    from gsfw.core.run_folder import write_atomically

    pictures = [Image.open(frame) for frame in frames]
    buffer = io.BytesIO()
    pictures[0].save(
        buffer, "WEBP", save_all=True, append_images=pictures[1:], duration=FRAME_MS, loop=0
    )
    for picture in pictures:
        picture.close()
    write_atomically(path, buffer.getvalue())
    return path
