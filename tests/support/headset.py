"""A headset for the web player: eyes with lenses of their own, and what they see."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gsfw.core.cameras import Cameras
from support.chromium import Page

SOURCE = Path(__file__).with_suffix(".js").read_text(encoding="utf-8")
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""From axes of WebXR (y up, z backward) to those of cameras, and back."""


@dataclass(frozen=True)
class Eye:
    """An eye of a headset."""

    pose: np.ndarray
    """[4, 4] from the eye to the room, in metres; y up, z backward."""
    slopes: tuple[float, float, float, float]
    """Tangents of the angles to the left, right, lower and upper edge; left and lower below 0."""

    @property
    def projection(self) -> np.ndarray:
        """[4, 4], as WebXR has it, from 0.1 to 1000 m."""
        left, right, down, up = self.slopes
        return np.array([
            [2 / (right - left), 0, (right + left) / (right - left), 0],
            [0, 2 / (up - down), (up + down) / (up - down), 0],
            [0, 0, -1000.1 / 999.9, -200 / 999.9],
            [0, 0, -1, 0],
        ])  # fmt: skip

    def camera(self, room: np.ndarray, metre: float, width: int, height: int) -> Cameras:
        """The camera of gsfw that sees what the eye sees.

        Args:
            room: [4, 4] from the room to the world, a rotation and a shift.
            metre: world units of a metre.
        """
        scaled = self.pose.copy()
        scaled[:3, 3] *= metre
        left, right, down, up = self.slopes
        fx, fy = width / (right - left), height / (up - down)
        lens = [[fx, 0, -left * fx], [0, fy, up * fy], [0, 0, 1]]
        pose = np.linalg.inv(room @ scaled @ FLIP)
        return Cameras(
            torch.tensor(pose)[None], torch.tensor(lens, dtype=torch.float64)[None], width, height
        )


def pose(place: Sequence[float], yaw: float = 0.0, pitch: float = 0.0) -> np.ndarray:
    """[4, 4] of a head or an eye in the room: metres, radians to the left and upwards."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    found = np.eye(4)
    found[:3, :3] = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]) @ np.array(
        [[1, 0, 0], [0, cp, -sp], [0, sp, cp]]
    )
    found[:3, 3] = place
    return found


def eyes_of(head: np.ndarray) -> list[Eye]:
    """Two eyes, 64 mm apart, turned outwards by 3 degrees, whose lenses mirror one another."""
    outside, inside, down, up = 0.9, 0.6, 0.75, 0.55
    return [
        Eye(head @ pose([-0.032, 0, 0], np.radians(3)), (-outside, inside, -down, up)),
        Eye(head @ pose([0.032, 0, 0], -np.radians(3)), (-inside, outside, -down, up)),
    ]


class Headset:
    """The headset of a page."""

    def __init__(self, page: Page) -> None:
        self.page = page
        page.command("Page.addScriptToEvaluateOnNewDocument", source=SOURCE)

    def offer(self, *modes: str) -> None:
        """Let the machine have sessions of these modes from now on."""
        self.page.evaluate(
            f"headset.kinds = {json.dumps(modes)};"
            " navigator.xr.dispatchEvent(new Event('devicechange'))"
        )

    def enter(self, kind: str = "vr") -> None:
        """Press the button, and wait for the session."""
        self.page.wait_for(f"!document.getElementById('{kind}').hidden")
        self.page.click(f"#{kind}")
        self.page.wait_for("headset.session?.waiting.length === 1")

    def image(self, head: np.ndarray, milliseconds: float = 1000 / 72, count: int = 1) -> None:
        """Let the session go on by some images, which no eye looks at."""
        arguments = f"{_json(head)}, [], {milliseconds}"
        self.page.evaluate(
            f"(() => {{ for (let k = 0; k < {count}; k++) headset.image({arguments}); }})()"
        )

    def look(self, head: np.ndarray) -> list[np.ndarray]:
        """What the eyes see, [h w 4] in [0, 1] each, without a passing of time."""
        found = self.page.evaluate(f"headset.look({_json(head)}, {_json_of_eyes(head)})")
        return [
            np.array(eye["pixels"]).reshape(eye["height"], eye["width"], 4)[::-1] / 255
            for eye in found
        ]

    def push(self, hand: str, right: float, down: float) -> None:
        """Push the stick of a controller; the other controllers are laid down."""
        self.page.evaluate(
            f"headset.inputs = [{{handedness: {json.dumps(hand)},"
            f" gamepad: {{axes: [0, 0, {right}, {down}]}}}}]"
        )

    def head(self) -> dict[str, Any]:
        """Position and axes of the head in the page's scene."""
        return self.page.evaluate("page.scene.head")


def _json(matrix: np.ndarray) -> str:
    """A matrix by columns, as WebXR has it."""
    return json.dumps(matrix.T.ravel().tolist())


def _json_of_eyes(head: np.ndarray) -> str:
    parts = (
        f"{{matrix: {_json(eye.pose)}, projection: {_json(eye.projection)}}}"
        for eye in eyes_of(head)
    )
    return f"[{', '.join(parts)}]"
