"""Key frames of a page: its poses in the scene frame, and a camera path in the world of the data.

The file is that of ``gsfw render camera=FILE.json``; see ``gsfw.rendering.key_frames``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.maths.rotations import quaternions_of
from gsfw.core.scene import Scene
from gsfw.rendering.key_frames import CameraPath, KeyFrame, PathFrames, path_frames
from gsfw.viewer.view_state import Pose, ViewState


def key_frame(state: ViewState, scene: Scene, moves: bool) -> KeyFrame:
    """The pose of a page as a key frame; with its time if the scene moves."""
    pose = state.pose
    world_to_camera = scene.world_from_scene.camera(pose.world_to_camera())
    return KeyFrame(
        torch.linalg.inv(world_to_camera),
        math.degrees(pose.fov),
        state.time if moves else None,
    )


def pose_of(camera_to_world: Float[Tensor, "4 4"], fov: float, scene: Scene) -> Pose:
    """A pose in the scene frame, of one in the world and a field of view in degrees."""
    inverse = scene.world_from_scene.inverse()
    camera_to_scene = torch.linalg.inv(inverse.camera(torch.linalg.inv(camera_to_world.double())))
    x, y, z = camera_to_scene[:3, 3].tolist()
    quaternion = quaternions_of(camera_to_scene[None, :3, :3])[0].tolist()
    w, i, j, k = quaternion
    return Pose((x, y, z), (w, i, j, k), math.radians(fov))


def with_key_frame(keys: Sequence[KeyFrame], new: KeyFrame) -> list[KeyFrame]:
    """One key frame more, at the end.

    Where the others have seconds, as those of a file may, it comes as long after the last one as
    they come after one another.
    """
    moments = [key.seconds for key in keys if key.seconds is not None]
    if not moments:
        return [*keys, new]
    step = (moments[-1] - moments[0]) / (len(moments) - 1) if len(moments) > 1 else 1.0
    return [*keys, replace(new, seconds=moments[-1] + step)]


def without_seconds(keys: Sequence[KeyFrame]) -> list[KeyFrame]:
    """The same key frames; the length of the film alone says when they are passed."""
    return [replace(key, seconds=None) for key in keys]


@dataclass(frozen=True)
class PathStates:
    """The states of a page along a camera path, one for each frame of its film."""

    frames: PathFrames
    scene: Scene
    fps: float

    @staticmethod
    def of(path: CameraPath, scene: Scene) -> PathStates:
        """The frames of a path of key frames."""
        return PathStates(path_frames(path), scene, path.fps)

    def __len__(self) -> int:
        return len(self.frames.fovs)

    def at(self, number: int, state: ViewState) -> ViewState:
        """``state`` at the pose, and the time if there is one, of a frame."""
        frames = self.frames
        pose = pose_of(frames.camera_to_world[number], float(frames.fovs[number]), self.scene)
        time = state.time if frames.times is None else float(frames.times[number])
        return replace(state, pose=pose, time=min(max(time, 0.0), 1.0), view=None)
