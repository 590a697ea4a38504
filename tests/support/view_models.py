"""A model whose splats depend on the view."""

from dataclasses import replace

import torch

from gsfw.core.model import PrimitiveModel


class ByView(PrimitiveModel):
    """Another model that is fainter from some sides; as it is where there is no view."""

    depends_on_view = True

    def __init__(self, given: PrimitiveModel) -> None:
        super().__init__()
        self.given = given
        self.asked: list[int] = []
        """Number of cameras of each call that had some."""

    def columns(self):
        return self.given.columns()

    def splats(self, time=None, cameras=None):
        splats = self.given.splats(time, cameras)
        if cameras is None:
            return splats
        self.asked.append(len(cameras))
        # By place and by axis: cameras of a test may differ in one of them.
        side = cameras.centers.sum() + cameras.world_to_camera[:, 2, :3].sum()
        return replace(splats, opacities=splats.opacities * torch.sigmoid(2 * side))
