"""LodModel: a model that is drawn as a cut of its tree, chosen anew for each view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.column import Column
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.similarity import Similarity
from gsfw.core.model import PrimitiveModel
from gsfw.core.render_output import RenderOutput
from gsfw.core.splats import Splats
from gsfw.lod.cut import Limits, select
from gsfw.lod.nodes import Tree


class LodModel(PrimitiveModel):
    """Another static model, of which each view draws a cut of the tree; it is not trained."""

    depends_on_view = True

    def __init__(
        self,
        given: PrimitiveModel,
        tree: Tree,
        limits: Limits,
        tree_from_scene: Similarity | None = None,
        views: Sequence[Cameras] | None = None,
    ) -> None:
        """Draw the cuts of ``tree`` in place of the splats of ``given``.

        Args:
            given: the model, or one with only the coarse nodes of the tree.
            tree: its tree.
            limits: of each view.
            tree_from_scene: leads from the scene frame to that of the tree; ``None`` if they are
                the same.
            views: cameras in the scene frame whose cut stands for the model where there is no
                view, as for exports; ``None``: the largest nodes do.
        """
        super().__init__()
        self._given, self.tree, self.limits = given, tree, limits
        self._frame, self._views = tree_from_scene, views
        # Frames that were rendered within other limits must not be kept.
        drawn = torch.tensor([limits.most, limits.pixels], dtype=torch.float64)
        self.register_buffer("_drawn", drawn)

    def columns(self) -> Mapping[str, Column]:
        """The columns of the model."""
        return self._given.columns()

    @torch.no_grad()
    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """The cut for the cameras; without cameras that for the views of the model."""
        device = next(iter(self.columns().values())).values.device
        views = self._views if cameras is None else [cameras]
        seen = None if views is None else [self._moved(item) for item in views]
        cut = select(self.tree, seen, self.limits)
        splats = self.tree.nodes(cut).splats()
        if self._frame is not None:
            splats = transform_splats(splats, self._frame.inverse()).map(Tensor.float)
        return splats.to(device)

    def _moved(self, cameras: Cameras) -> Cameras:
        """The cameras in the frame of the tree, on the CPU."""
        views = cameras.to("cpu")
        if self._frame is None:
            return views
        poses = self._frame.camera(views.world_to_camera.detach()).to(views.world_to_camera)
        return replace(views, world_to_camera=poses)

    def decode(self, output: RenderOutput, cameras: Cameras) -> RenderOutput:
        """Decode as the model does."""
        return self._given.decode(output, cameras)
