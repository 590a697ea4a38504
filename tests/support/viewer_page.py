"""A page without a browser: speaks the viewer's protocol over a websocket."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from PIL import Image
from websockets.sync.client import ClientConnection, connect

from gsfw.viewer.view_state import Pose


class ViewerPage:
    """Sends camera poses, and takes the frames."""

    def __init__(self, socket: ClientConnection, size: tuple[int, int]) -> None:
        self._socket, self._size = socket, size
        self.frames: list[np.ndarray] = []
        self.messages: list[str] = []
        """Names of all that came."""

    def look(self, pose: Pose) -> None:
        """Report a pose of the page's camera."""
        self._socket.send(pose_message(pose, self._size))

    def send(self, content: bytes | str) -> None:
        """Send anything."""
        self._socket.send(content)

    def wait_for_frame(self, seconds: float = 30.0, width: int = 0) -> np.ndarray:
        """The next frame, of at least this width.

        Raises:
            TimeoutError: none came.
        """
        end = time.monotonic() + seconds
        while True:
            raw = self._socket.recv(timeout=max(end - time.monotonic(), 0.0))
            assert isinstance(raw, bytes)
            for frame in self._frames(raw):
                self.frames.append(frame)
            if self.frames and self.frames[-1].shape[1] >= width:
                return self.frames.pop()

    def _frames(self, raw: bytes) -> Iterator[np.ndarray]:
        length = int.from_bytes(raw[8:16], "little")
        packed = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + length])
        for message in msgspec.msgpack.decode(packed)["messages"]:
            self.messages.append(message["type"])
            content: Any = message.get("rgb_data")
            if message["type"] == "BackgroundImageMessage" and content is not None:
                yield np.asarray(Image.open(io.BytesIO(content)).convert("RGB"))


def pose_message(pose: Pose, size: tuple[int, int]) -> bytes:
    """What a page of this size reports when its camera moves."""
    x, y, z = pose.position
    message = {
        "type": "ViewerCameraMessage",
        "wxyz": pose.wxyz,
        "position": pose.position,
        "fov": pose.fov,
        "near": 0.01,
        "far": 100.0,
        "image_height": size[1],
        "image_width": size[0],
        "look_at": (x, y, z + 1.0),
        "up_direction": (0.0, -1.0, 0.0),
    }
    return msgspec.msgpack.encode(message)


@contextmanager
def open_page(address: str, size: tuple[int, int] = (64, 48)) -> Iterator[ViewerPage]:
    """Open the page at an address, with its secret; it has not reported a camera yet."""
    socket = connect(
        address.replace("http://", "ws://").rstrip("/"),
        subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
        proxy=None,
        compression=None,
        max_size=None,
    )
    try:
        yield ViewerPage(socket, size)
    finally:
        socket.close()
