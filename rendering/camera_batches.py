"""Camera batches: cameras of a user's own in one batch."""

from __future__ import annotations

from collections.abc import Sequence

from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError


def one_batch(cameras: Cameras | Sequence[Cameras]) -> Cameras:
    """All cameras in one batch.

    Raises:
        ConfigError: there are none, they differ in size or model, or something else was given.
    """
    if isinstance(cameras, Cameras):
        return cameras
    items = cameras if isinstance(cameras, Sequence) and not isinstance(cameras, str) else [cameras]
    for item in items:
        if not isinstance(item, Cameras):
            raise ConfigError(
                f"cameras: expected Cameras, found {type(item).__name__}.",
                "model.camera_path('orbit'), model.cameras() and Cameras.look_at make them.",
            )
    if len(cameras) == 0:
        raise ConfigError("render: expected at least one camera, found none.")
    try:
        return Cameras.cat(list(cameras))
    except ValueError as error:
        raise ConfigError(
            f"render: {error}.", "Render them one at a time: [render(it, camera) for camera in ...]"
        ) from None
