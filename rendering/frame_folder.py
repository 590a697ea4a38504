"""FrameFolder: the frames of one request, so that what was rendered before is kept.

``frames.json`` beside the frames says what they show. A frame is written whole or not at all, so
that one that exists is complete.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text, parsed_json
from gsfw.core.files.reading import is_file

if TYPE_CHECKING:
    from gsfw.core.cameras import Cameras
    from gsfw.core.model import PrimitiveModel

SCHEMA = 1
"""Version of the layout; folders of others are rendered anew."""

MANIFEST = "frames.json"

Scales = Mapping[str, tuple[float, float]]
"""Least and largest value of the colour scale of each channel of values."""


class FrameFolder:
    """A folder of frames, of an earlier run of the same request or of none."""

    def __init__(self, path: Path, request: Mapping[str, Any], names: Sequence[str]) -> None:
        """Read what a folder holds; nothing is changed yet.

        Args:
            path: the folder, which need not exist.
            request: all that the frames depend on, as plain data.
            names: file names of the frames, in order.
        """
        self.path, self.names = path, tuple(names)
        self._request = parsed_json(json_text({"schema": SCHEMA, "names": names, **request}))
        self._found = _read(path / MANIFEST)
        self._is_same = self._found.get("request") == self._request

    @property
    def scales(self) -> Scales | None:
        """Colour scales of the earlier run; ``None`` if this is another request."""
        if not self._is_same:
            return None
        return {name: (low, high) for name, (low, high) in self._found["scales"].items()}

    def start(self, scales: Scales) -> None:
        """Take the folder for this request; frames of another one are removed.

        Raises:
            OutputError: it cannot be written.
        """
        if self._is_same:
            return
        for name in self._found.get("request", {}).get("names", ()):
            # Only what an earlier run listed, and only in this folder.
            if Path(name).name == name and is_file(self.path / name):
                (self.path / name).unlink()
        document = {"request": self._request, "scales": scales}
        write_atomically(self.path / MANIFEST, (json_text(document, indent=1) + "\n").encode())

    def has(self, name: str) -> bool:
        """True if a frame is there from an earlier run of the same request."""
        return self._is_same and (self.path / name).is_file()

    @property
    def kept(self) -> int:
        """Number of frames that are there from an earlier run."""
        return sum(self.has(name) for name in self.names)


def _read(manifest: Path) -> Mapping[str, Any]:
    try:
        document = parsed_json(manifest.read_text(encoding="utf-8"))
        names = document["request"]["names"]
        sound = isinstance(names, list) and all(isinstance(name, str) for name in names)
        sound = sound and {
            name: (float(low), float(high)) for name, (low, high) in document["scales"].items()
        } == {name: tuple(ends) for name, ends in document["scales"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}
    return document if sound else {}


def model_digest(model: PrimitiveModel) -> str:
    """Identifies the state of a model."""
    digest = hashlib.blake2b(digest_size=16)
    for name, value in sorted(model.state_dict().items()):
        if isinstance(value, Tensor):
            digest.update(f"{name} {value.dtype} {tuple(value.shape)}".encode())
            digest.update(_bytes(value))
        else:  # A module's extra state may be anything.
            digest.update(f"{name} {value!r}".encode())
    return digest.hexdigest()


def _bytes(tensor: Tensor) -> bytes:
    """The content of a tensor of any type, those included that NumPy lacks."""
    flat = tensor.detach().cpu().contiguous().flatten()
    return flat.view(torch.uint8).numpy().tobytes() if len(flat) else b""


def cameras_digest(cameras: Sequence[Cameras]) -> str:
    """Identifies cameras, with their sizes and times."""
    digest = hashlib.blake2b(digest_size=16)
    for camera in cameras:
        digest.update(f"{camera.model.value} {camera.width} {camera.height}".encode())
        for tensor in (camera.world_to_camera, camera.intrinsics, camera.time):
            digest.update(b"" if tensor is None else _bytes(tensor))
    return digest.hexdigest()
