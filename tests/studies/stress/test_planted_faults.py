"""Faults that kernels had elsewhere, planted in the reference: each is caught by a named case."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest
import torch
from torch import Tensor

from gsfw.core.capabilities import Capabilities
from gsfw.core.errors import ConfigError
from gsfw.core.maths import slices
from gsfw.core.maths.rotations import unit_matrices
from gsfw.core.maths.slices import Conditional, conditional
from gsfw.core.operators import Operators
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.splats import Sh
from gsfw.plugins.registry import installed
from gsfw.rasterizers.reference import project
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.entrants import Entrant
from gsfw.studies.stress.case import Drawing
from gsfw.studies.stress.catalogue import CASES
from gsfw.studies.stress.measure import Oracle, measure
from gsfw.studies.stress.moving_case import MOVING_CASES, moving_model
from gsfw.studies.stress.moving_measure import measure_moving
from gsfw.studies.stress.result import CaseResult

# Seconds each; .ci/run runs them.
pytestmark = pytest.mark.slow

TILE = 16

Draw = Callable[[Drawing], RenderOutput]


class Faulty(Rasterizer):
    """The reference, given something else than what it is asked for."""

    def __init__(self, change: Callable[[Drawing, Draw], RenderOutput]) -> None:
        self._change, self._reference = change, ReferenceRasterizer()

    @classmethod
    def capabilities(cls) -> Capabilities:
        return ReferenceRasterizer.capabilities()

    def _render(self, splats, cameras, settings):
        return self._change(Drawing(splats, cameras, settings), self._as_it_is)

    def _as_it_is(self, drawing: Drawing) -> RenderOutput:
        return self._reference._render(drawing.splats, drawing.cameras, drawing.settings)


def verdict(rasterizer: Rasterizer, name: str, dtype: torch.dtype = torch.float32) -> CaseResult:
    entrant = Entrant("faulty", rasterizer, rasterizer.capabilities(), torch.device("cpu"), (1, 1))
    return measure(entrant, CASES[name], dtype, Oracle(ReferenceRasterizer()))


def no_near_plane(drawing: Drawing, draw: Draw) -> RenderOutput:
    return draw(replace(drawing, settings=replace(drawing.settings, near=0.0)))


def with_profile(**values: float) -> Callable[[Drawing, Draw], RenderOutput]:
    def fault(drawing: Drawing, draw: Draw) -> RenderOutput:
        profile = replace(drawing.settings.profile, **values)
        return draw(replace(drawing, settings=replace(drawing.settings, profile=profile)))

    return fault


def no_normalisation(drawing: Drawing, draw: Draw) -> RenderOutput:
    """Rotation matrices of quaternions as they are."""
    splats = drawing.splats
    axes = unit_matrices(splats.quats) * splats.scales[:, None]
    made = replace(splats, quats=None, scales=None, covariances=axes @ axes.transpose(1, 2))
    return draw(replace(drawing, splats=made))


def last_row_first(drawing: Drawing, draw: Draw) -> RenderOutput:
    """Ties of depth by falling rows, as an unstable sort may have them."""
    flipped = draw(replace(drawing, splats=drawing.splats.map(lambda tensor: tensor.flip(0))))
    statistics = flipped.statistics
    back = {
        name: getattr(statistics, name).flip(1)
        for name in ("visible", "radii", "contribution")
        if getattr(statistics, name) is not None
    }
    return replace(flipped, statistics=replace(statistics, **back))


def int32_counts(drawing: Drawing, draw: Draw) -> RenderOutput:
    """What a kernel does whose limit is compared with a count that has overflowed."""
    cameras = drawing.cameras
    tiles = -(-cameras.width // TILE) * -(-cameras.height // TILE)
    count = int(torch.tensor(len(drawing.splats) * tiles).to(torch.int32))
    if count * 64 > 4096 * 2**20:
        raise ConfigError(f"this image needs {64 * count} bytes for {count} pairs.")
    like, shape = drawing.splats.means, (1, cameras.height, cameras.width)
    color = like.sum() * like.new_zeros(*shape, drawing.splats.channels)
    return RenderOutput(color, like.new_zeros(*shape, 1), RenderStatistics.zeros(like, 1, set()))


def forgets_the_background(drawing: Drawing, draw: Draw) -> RenderOutput:
    background = drawing.settings.background
    if background is None:
        return draw(drawing)
    clamped = replace(drawing.settings, background=background.clamp(0, 1))
    return draw(replace(drawing, settings=clamped))


def unclamped_colours(drawing: Drawing, draw: Draw) -> RenderOutput:
    """Colours of degree 0 without the clamp at 0."""
    colors = drawing.splats.colors
    if not isinstance(colors, Sh):
        return draw(drawing)
    plain = 0.5 + 0.28209479177387814 * colors.coefficients[:, 0]
    return draw(replace(drawing, splats=replace(drawing.splats, colors=plain)))


def other_bits_each_time(drawing: Drawing, draw: Draw) -> RenderOutput:
    output = draw(drawing)
    return replace(output, color=output.color * (1 + 1e-6 * torch.rand_like(output.color)))


FAULTS: dict[str, tuple[Callable[[Drawing, Draw], RenderOutput], str]] = {
    "no near plane": (no_near_plane, "depth/near-plane"),
    "no near plane, large": (no_near_plane, "depth/near-plane/straddling"),
    "no far plane": (
        lambda drawing, draw: draw(
            replace(drawing, settings=replace(drawing.settings, far=float("inf")))
        ),
        "depth/far-plane",
    ),
    "no quaternion normalisation": (no_normalisation, "rotation/norm-100"),
    "no alpha clamp": (with_profile(alpha_max=1.0), "opacity/at-the-clamp"),
    "the clamp of another profile": (
        with_profile(alpha_max=0.999),
        "opacity/one-over-everything",
    ),
    "no cut-off of alpha": (with_profile(alpha_min=0.0), "opacity/below-the-cut-off"),
    "no stop": (with_profile(transmittance_min=0.0), "layers/below-the-stop"),
    "a stop too early": (with_profile(transmittance_min=2e-4), "layers/above-the-stop"),
    "no floor of the compensation": (
        with_profile(compensation_min=1e-6),
        "shape/scales-1e-7/no-cut-offs",
    ),
    "ties of depth by falling rows": (last_row_first, "depth/thousand-equal"),
    "counts in 32 bits": (int32_counts, "size/more-pairs-than-int32"),
    "a background that is clamped": (forgets_the_background, "colour/background-outside"),
    "colours without their clamp": (unclamped_colours, "colour/negative"),
    "other bits each time": (other_bits_each_time, "shape/discs"),
}  # fmt: skip
"""What is wrong, and the name of the case that says so."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_caught_by_a_named_case(fault):
    change, name = FAULTS[fault]
    assert verdict(Faulty(change), name).faults
    if not CASES[name].refusal:
        sound = Faulty(lambda drawing, draw: draw(drawing))
        assert verdict(sound, name).passed


def test_needles_catch_the_published_determinant(monkeypatch):
    name = "shape/one-needle"
    assert verdict(ReferenceRasterizer(), name).passed

    def published(axes: Tensor) -> tuple[Tensor, Tensor]:
        first, second = axes.unbind(1)
        products = torch.stack([first * first, first * second, second * second], dim=1).sum(2)
        if axes.dtype == torch.float64:  # The oracle keeps its own.
            return products, torch.linalg.cross(first, second).square().sum(1)
        return products, products[:, 0] * products[:, 2] - products[:, 1] ** 2

    sound = Oracle(ReferenceRasterizer())
    sound.plain(CASES[name], CASES[name].make().settings.profile)  # Before the fault is there.
    monkeypatch.setattr(project, "_from_axes", published)
    entrant = Entrant(
        "faulty", ReferenceRasterizer(), ReferenceRasterizer.capabilities(), torch.device("cpu")
    )
    assert measure(entrant, CASES[name], torch.float32, sound).faults


@dataclass(frozen=True)
class Textbook(Conditional):
    """Sigma_xx - Sigma_xt Sigma_tt^-1 Sigma_tx, as released codes have it."""

    naive: Tensor

    @property
    def covariances(self) -> Tensor:
        return self.naive


def textbook(rotations: Tensor, scales: Tensor) -> Conditional:
    exact = conditional(rotations, scales)
    factors = rotations.permute(2, 0, 1) * scales[:, None]
    whole = factors @ factors.transpose(1, 2)
    across = whole[:, :3, 3:]
    naive = whole[:, :3, :3] - across @ across.transpose(1, 2) / whole[:, 3:, 3:]
    return Textbook(exact.factors, exact.velocities, exact.variances, naive)


@pytest.mark.parametrize("name", ["time/thin-and-long", "time/thin-and-endless"])
def test_the_textbook_conditional_covariance_is_caught_by_a_named_case(monkeypatch, name):
    case = next(case for case in MOVING_CASES if case.name == name)
    model = moving_model("4d-rotor", installed())
    assert measure_moving(case, "4d-rotor", model, torch.float32).passed
    model._operators = Operators()
    monkeypatch.setattr(slices, "conditional", textbook)
    faults = measure_moving(case, "4d-rotor", model, torch.float32).faults
    assert any("of the covariances are not positive semi-definite" in fault for fault in faults)


def test_a_rotor_that_is_not_normalised_is_caught_by_a_named_case(monkeypatch):
    case = next(case for case in MOVING_CASES if case.name == "time/rotors-1e-9")
    model = moving_model("4d-rotor", installed())
    model._operators = Operators()
    monkeypatch.setattr(
        slices, "normalised", lambda quats: quats / (quats.norm(dim=1, keepdim=True) + 1e-6)
    )
    assert measure_moving(case, "4d-rotor", model, torch.float32).faults


class Slanted(torch.autograd.Function):
    """The identity, whose gradient is off by a part of it."""

    @staticmethod
    def forward(context, values: Tensor, part: float) -> Tensor:
        context.part = part
        return values.clone()

    @staticmethod
    def backward(context, gradient: Tensor) -> tuple[Tensor, None]:
        return gradient * (1 + context.part), None


def test_a_small_error_of_a_gradient_is_caught_in_float64_although_its_case_is_ill_conditioned():
    name = "depth/to-1e9/fisheye-no-cut-offs"

    def slanted(drawing: Drawing, draw: Draw) -> RenderOutput:
        means = Slanted.apply(drawing.splats.means, 1e-8)
        return draw(replace(drawing, splats=replace(drawing.splats, means=means)))

    (fault,) = verdict(Faulty(slanted), name, torch.float64).faults
    assert fault.startswith("gradient of means is off by 1.0e-08")
    assert verdict(Faulty(lambda drawing, draw: draw(drawing)), name, torch.float64).passed
