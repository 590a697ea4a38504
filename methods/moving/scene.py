"""Requirements of moving methods on a capture, and the view of their static part."""

from __future__ import annotations

from dataclasses import replace

from gsfw.core.errors import ConfigError
from gsfw.core.scene import Scene


def check_times(scene: Scene, method: str) -> None:
    """Refuse captures of a single time.

    Args:
        scene: the capture.
        method: name and package of the method, as ``Method.registered_as``; may be empty.

    Raises:
        ConfigError: names the remedy.
    """
    if not scene.is_dynamic:
        raise ConfigError(
            f"{method or 'this method'} is for captures of several times, and {scene.name!r} has "
            "one.",
            "Use method=3dgs. If the scene does move, its data have to say when each image "
            'was taken, such as by "time" in every frame of a transforms.json; gsfw prepare VIDEO '
            "layout=transforms writes one. The built-in scene moves with datamanager.moving=true.",
        )


def as_static(scene: Scene) -> Scene:
    """The scene with a single time, for method 3dgs."""
    return replace(scene, num_times=0, time_range=None)
