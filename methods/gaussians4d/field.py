"""DeformationField: the differences of Gaussians at a time from the canonical space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor, nn

from gsfw.methods.gaussians4d.box import SpaceBox
from gsfw.methods.gaussians4d.decoder import Decoder
from gsfw.methods.gaussians4d.encoder import Encoder

OPACITIES = "opacity_logits"
"""Name of the decoder's output for opacities."""


@dataclass(frozen=True)
class Deformation:
    """Changes of parameters before their activation; those of scales as the model adds them."""

    means: Float[Tensor, "n 3"]
    """Change of positions in scene units."""
    scales: Float[Tensor, "n 3"]
    """Change of the logarithms of scales, or of scales in units of the box."""
    quats: Float[Tensor, "n 4"]
    opacity_logits: Float[Tensor, " n"] | None
    """``None``: opacities do not change."""
    sh: Float[Tensor, "n k 3"] | None
    """``None``: colours do not change."""


class DeformationField(nn.Module):
    """Box, encoder and decoder, evaluated for all Gaussians at once."""

    def __init__(self, box: SpaceBox, encoder: Encoder, decoder: Decoder) -> None:
        super().__init__()
        self.box, self.encoder, self.decoder = box, encoder, decoder

    def forward(
        self,
        means: Float[Tensor, "n 3"],
        time: Float[Tensor, ""],
        least_opacity_change: Float[Tensor, " n"] | None = None,
    ) -> Deformation:
        """Changes of Gaussians with the canonical centres ``means``.

        Args:
            means: centres in scene units.
            time: in [0, 1]; earlier or later times are clamped.
            least_opacity_change: of the logits; rows whose opacity changes by less cannot be seen
                and need no other changes, which may be 0.
        """
        bounded = self.changes_opacities and least_opacity_change is not None
        least = (OPACITIES, least_opacity_change) if bounded else None
        changes = self.decoder(self._features(means, time), least=least)
        opacities, sh = changes.get(OPACITIES), changes.get("sh")
        return Deformation(
            # The network's outputs are in units of the box, independent of the scene's unit.
            means=changes["means"] * self.box.size,
            scales=changes["log_scales"],
            quats=changes["quats"],
            opacity_logits=None if opacities is None else opacities[:, 0],
            sh=None if sh is None else sh.unflatten(1, (-1, 3)),
        )

    @property
    def changes_opacities(self) -> bool:
        """True if opacities change with time."""
        return OPACITIES in self.decoder.outputs

    def opacity_change(
        self, means: Float[Tensor, "n 3"], time: Float[Tensor, ""]
    ) -> Float[Tensor, " n"]:
        """Changes of the logits of opacities alone, which cost less than all changes."""
        changes = self.decoder(self._features(means, time), only=OPACITIES)
        return changes[OPACITIES][:, 0]

    def _features(
        self, means: Float[Tensor, "n 3"], time: Float[Tensor, ""]
    ) -> Float[Tensor, "n f"]:
        places = self.box(means.detach() if self.encoder.detached else means)
        features: Tensor = self.encoder(places, time.clamp(0, 1))
        return features

    def grids(self) -> tuple[nn.Parameter, ...]:
        """Parameters with cells in space and time."""
        return self.encoder.grids()

    def networks(self) -> tuple[nn.Parameter, ...]:
        """All other parameters."""
        grids = {id(parameter) for parameter in self.grids()}
        return tuple(p for p in self.parameters() if id(p) not in grids)

    def regularizers(self) -> Mapping[str, Tensor]:
        """Weighted scalars to add to the loss, by name."""
        return self.encoder.regularizers()
