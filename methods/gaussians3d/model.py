"""Static Gaussians: position, rotation, scale, opacity and spherical-harmonic colour of each.

Kerbl et al. 2023, section 4: covariance R S S^T R^T (equation 6), scales through exp and opacities
through a sigmoid. Quaternions may have any norm, as there: rasterizers normalise them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from gsfw.core.cameras import Cameras
from gsfw.core.column import Column, Layout, Rows
from gsfw.core.learning_rate import LearningRate
from gsfw.core.maths.rotations import matrices_rows_last
from gsfw.core.maths.spherical_harmonics import degree_of, num_coefficients, rgb_to_dc
from gsfw.core.model import Children, DensifiableModel
from gsfw.core.operators import Operators
from gsfw.core.splats import Sh, Splats
from gsfw.methods.gaussians3d.band_evidence import BandEvidence
from gsfw.methods.gaussians3d.relocation import coincident_copies

MIN_LOG_SCALE, MAX_LOG_SCALE = math.log(1e-10), math.log(1e6)
"""Range of log scales in scene units (cameras span about 1), in which exp stays in float32."""
NEW_OPACITY = 0.1
"""Initial opacity of rows at rendering errors, as at the start (Kerbl et al. 2023)."""
SPLIT_SHRINK = 0.8
"""Children of a split are smaller by 1 / (0.8 * copies): 1.6 for two (Kerbl et al. 2023, 5.2)."""


@dataclass(frozen=True)
class GaussianParameters:
    """Trained parameters of Gaussians, before activation."""

    means: Float[Tensor, "n 3"]
    quats: Float[Tensor, "n 4"]
    log_scales: Float[Tensor, "n 3"]
    opacity_logits: Float[Tensor, " n"]
    sh: Float[Tensor, "n k 3"]


class StaticGaussians(DensifiableModel):
    """Gaussians that do not change with time.

    ``active_degree`` is the SH degree that is rendered and trained now. It follows from the step,
    so it is not part of the state; until a method lowers it, all bands are rendered.

    To extend them, give ``extra`` columns (``StaticGaussiansMethod.extra_columns``): density
    control, optimizer, checkpoints and model files include them. Override ``splats`` to render
    them, ``regularizers`` to add losses, ``extra_rows`` for their values in new rows.
    """

    def __init__(
        self,
        start: GaussianParameters,
        rates: Mapping[str, LearningRate],
        degrees: Int[Tensor, " n"] | None = None,
        extra: Mapping[str, Column] | None = None,
    ) -> None:
        """Make columns from initial parameters.

        Args:
            start: initial values.
            rates: learning rate of each column.
            degrees: SH degree of each row, which may change later; ``None``: the same for all.
            extra: further columns, by name, with the same number of rows.
        """
        super().__init__()
        self.degree = degree_of(start.sh.shape[1])
        self.active_degree = self.degree
        self.means = Column(start.means, rates["means"])
        self.quats = Column(start.quats, rates["quats"])
        self.log_scales = Column(start.log_scales, rates["log_scales"])
        self.opacity_logits = Column(start.opacity_logits, rates["opacity_logits"])
        self.sh_dc = Column(start.sh[:, :1], rates["sh_dc"])
        self.sh_rest: Column | None = None
        self.evidence: BandEvidence | None = None
        self.extra = nn.ModuleDict(dict(extra or {}))
        if self.degree > 0 and degrees is None:
            self.sh_rest = Column(start.sh[:, 1:], rates["sh_rest"], bands=True)
        elif degrees is not None:
            colors = Sh(start.sh, self.degree).of_degrees(degrees)
            assert colors.rest is not None
            self.sh_rest = Column(colors.rest, rates["sh_rest"], Layout.RAGGED, colors.offsets)
            self.evidence = BandEvidence(len(start.sh))

    def columns(self) -> Mapping[str, Column]:
        """Means, quats, log_scales, opacity_logits, sh_dc, sh_rest above degree 0, and extra ones.

        Rows of different degrees also have columns of evidence for their bands.
        """
        always = {
            "means": self.means,
            "quats": self.quats,
            "log_scales": self.log_scales,
            "opacity_logits": self.opacity_logits,
            "sh_dc": self.sh_dc,
        }
        if self.sh_rest is not None:
            always["sh_rest"] = self.sh_rest
        evidence = {} if self.evidence is None else self.evidence.columns()
        return {**always, **evidence, **self._extra_columns()}

    def _extra_columns(self) -> dict[str, Column]:
        return {name: column for name, column in self.extra.items() if isinstance(column, Column)}

    def extra_rows(self, name: str, count: int) -> Rows:
        """Values of an extra column in ``count`` new rows that copy no other: zeros."""
        column = self._extra_columns()[name]
        return Rows(column.values.new_zeros(count, *column.values.shape[1:]))

    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """The activated Gaussians; the same at every time."""
        return Splats(
            means=self.means.values,
            opacities=self.opacity_logits.values.sigmoid(),
            colors=self._colors(),
            quats=self.quats.values,
            scales=self.log_scales.values.exp(),
        )

    def _colors(self) -> Sh:
        # Joining the columns would copy every coefficient, and so would taking the active bands.
        if self.sh_rest is None or self.active_degree == 0 or len(self.sh_rest.values) == 0:
            return Sh(self.sh_dc.values, 0)
        return Sh(self.sh_dc.values, self.active_degree, self.sh_rest.values, self.sh_rest.offsets)

    def degrees(self) -> Int[Tensor, " n"]:
        """SH degree of each row, by its number of coefficients."""
        if self.sh_rest is None or self.sh_rest.offsets is None:
            return torch.full((self.num_rows,), self.degree, device=self.means.values.device)
        return ((self.sh_rest.offsets.diff() + 1).double().sqrt().round() - 1).long()

    def active_bands(self) -> int:
        """Number of coefficients above the constant one that are rendered and trained now."""
        return num_coefficients(self.active_degree) - 1

    @torch.no_grad()
    def project_(self) -> None:
        """Clamp scales so that exp neither overflows nor vanishes, at any learning rate."""
        self.log_scales.values.clamp_(MIN_LOG_SCALE, MAX_LOG_SCALE)

    # For density control.

    @torch.no_grad()
    def opacities(self) -> Float[Tensor, " n"]:
        """Opacity of each row in [0, 1]."""
        return self.opacity_logits.values.sigmoid()

    @torch.no_grad()
    def sizes(self) -> Float[Tensor, " n"]:
        """Largest standard deviation of each row, in scene units."""
        return self.log_scales.values.amax(dim=1).exp()

    @torch.no_grad()
    def split_rows(
        self, rows: Int[Tensor, " r"], copies: int, generator: torch.Generator
    ) -> Children:
        """Smaller children at points sampled from each row's own Gaussian (section 5.2)."""
        children = dict(self.clone_rows(rows.repeat(copies)))
        means, log_scales = children["means"].values, children["log_scales"].values
        noise = torch.randn(means.shape, generator=generator, device=means.device)
        along_axes = (log_scales.exp() * noise.to(means)).T
        offsets = (matrices_rows_last(children["quats"].values) * along_axes).sum(1)
        children["means"] = Rows(means + offsets.T)
        children["log_scales"] = Rows(log_scales - math.log(SPLIT_SHRINK * copies))
        return children

    @torch.no_grad()
    def rows_at(
        self,
        points: Float[Tensor, "r 3"],
        colors: Float[Tensor, "r 3"],
        sizes: Float[Tensor, " r"],
        time: float | None,
    ) -> Children:
        """Isotropic rows with low opacity, and one colour for all directions."""
        count, means = len(points), self.means.values
        log_scales = sizes.to(means).log().clamp(MIN_LOG_SCALE, MAX_LOG_SCALE)
        identity = torch.eye(1, 4, dtype=means.dtype, device=means.device)
        values = {
            "means": points.to(means),
            "quats": identity.repeat(count, 1),
            "log_scales": log_scales[:, None].repeat(1, 3),
            "opacity_logits": means.new_full((count,), NEW_OPACITY).logit(),
            "sh_dc": rgb_to_dc(colors.to(means))[:, None],
        }
        rows = {name: Rows(rows) for name, rows in values.items()}
        rows |= {name: self.extra_rows(name, count) for name in self._extra_columns()}
        if self.evidence is not None:
            none = torch.zeros(count, dtype=torch.int64, device=means.device)
            return {
                **rows,
                "sh_rest": Rows(means.new_zeros(0, 3), none),
                **self.evidence.new_rows(count),
            }
        if self.sh_rest is not None:
            rows["sh_rest"] = Rows(means.new_zeros(count, *self.sh_rest.values.shape[1:]))
        return rows

    @torch.no_grad()
    def relocated(self, rows: Int[Tensor, " r"], counts: Int[Tensor, " r"]) -> Children:
        """``rows`` with the opacity and scale with which ``counts`` copies render as one did."""
        children = dict(self.clone_rows(rows))
        logits, log_scales = children["opacity_logits"].values, children["log_scales"].values
        new_logits, factors = coincident_copies(logits, counts)
        children["opacity_logits"] = Rows(new_logits.to(logits))
        children["log_scales"] = Rows(log_scales + factors.log().to(log_scales)[:, None])
        return children

    @torch.no_grad()
    def perturb_(self, rate: float, generator: torch.Generator, operators: Operators) -> None:
        """Add noise of covariance Sigma^2 to positions of rows with low opacity (eq. 8)."""
        means = self.means.values
        noise = torch.randn(means.shape, generator=generator, device=means.device).to(means)
        operators.add_noise_(
            means,
            self.quats.values,
            self.log_scales.values,
            self.opacity_logits.values,
            noise,
            rate,
        )

    @torch.no_grad()
    def change_opacities_(self, function: Callable[[Tensor], Tensor]) -> tuple[str, ...]:
        """Change opacities by a function; logits of unchanged opacities keep their bits."""
        logits = self.opacity_logits.values
        before = logits.double().sigmoid()
        after = function(before)
        logits.copy_(torch.where(after == before, logits, after.logit().to(logits)))
        return ("opacity_logits",)
