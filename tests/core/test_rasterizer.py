"""What every rasterizer refuses before it draws, and in which words."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Capabilities
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import RenderSettings, Validation
from gsfw.core.splats import Sh, Splats

CHEAP = RenderSettings(validation=Validation.CHEAP)


class Blank(Rasterizer):
    """Draws nothing."""

    @classmethod
    def capabilities(cls) -> Capabilities:
        return Capabilities(devices=frozenset({"cpu"}))

    def _render(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        shape = (len(cameras), cameras.height, cameras.width)
        color = splats.means.new_zeros(*shape, splats.channels)
        visible = torch.zeros(len(cameras), len(splats), dtype=torch.bool)
        statistics = RenderStatistics(visible, splats.means.new_zeros(visible.shape))
        return RenderOutput(color, splats.means.new_zeros(*shape, 1), statistics)


def refusal(splats: Splats, cameras: Cameras, settings: RenderSettings | None = None) -> str:
    with pytest.raises(ValueError, match=r".") as caught:
        Blank().render(splats, cameras, settings)
    return str(caught.value)


def forced(record: Splats | Cameras, **fields: torch.Tensor) -> Splats | Cameras:
    """A copy with fields that the shape checks of the tests would not let pass."""
    copy = replace(record)
    for name, value in fields.items():
        object.__setattr__(copy, name, value)
    return copy


def changed(tensor: torch.Tensor | None, *index: int, to: float) -> torch.Tensor:
    assert tensor is not None
    copy = tensor.clone()
    copy[index] = to
    return copy


def test_good_inputs_are_drawn():
    output = Blank().render(random_splats(3), front_camera())
    assert output.color.shape == (1, 30, 40, 3)


@pytest.mark.parametrize("field", ["means", "opacities", "quats", "scales"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_values_that_are_not_finite_are_refused_with_their_row(field, value):
    splats = random_splats(5)
    tensor = changed(getattr(splats, field), 3, to=value)
    shown = tensor[3].flatten().tolist()
    message = refusal(replace(splats, **{field: tensor}), front_camera())
    assert message == (
        f"splats.{field}: expected finite values; 1 of 5 rows are not, the first is row 3: {shown}"
    )


def test_values_are_not_looked_at_when_the_check_is_cheap():
    splats = random_splats(5)
    splats = replace(splats, means=changed(splats.means, 3, to=float("nan")))
    Blank().render(splats, front_camera(), CHEAP)


def test_colours_extra_and_background_must_be_finite():
    splats, nan = random_splats(3), float("nan")
    assert isinstance(splats.colors, Sh)
    colors = Sh(changed(splats.colors.coefficients, 1, 2, 0, to=nan), 1)
    assert "splats.colors: expected finite values; 1 of 3 rows" in refusal(
        replace(splats, colors=colors), front_camera()
    )
    assert "splats.extra: expected finite values; 3 of 3 rows" in refusal(
        replace(splats, extra=torch.full((3, 2), nan)), front_camera()
    )
    settings = RenderSettings(background=torch.tensor([0.0, nan, 0.0]))
    assert refusal(splats, front_camera(), settings) == (
        "settings.background: expected finite values; 1 of 3 rows are not, "
        "the first is row 1: [nan]"
    )


def test_covariances_must_be_finite():
    covariances = torch.eye(3).repeat(2, 1, 1)
    splats = replace(random_splats(2), quats=None, scales=None)
    splats = replace(splats, covariances=changed(covariances, 1, 0, 0, to=float("inf")))
    assert refusal(splats, front_camera()).startswith(
        "splats.covariances: expected finite values; 1 of 2 rows are not, the first is row 1: [inf,"
    )


def test_negative_scales_are_refused():
    splats = random_splats(5)
    scales = changed(changed(splats.scales, 2, 1, to=-0.5), 4, to=-1.0)
    message = refusal(replace(splats, scales=scales), front_camera())
    assert message == (
        "splats.scales: expected scales >= 0; 2 of 5 rows are not, "
        f"the first is row 2: {scales[2].tolist()}"
    )


@pytest.mark.parametrize("value", [-0.25, 1.25])
def test_opacities_out_of_range_are_refused(value):
    splats = random_splats(5)
    splats = replace(splats, opacities=changed(splats.opacities, 0, to=value))
    assert refusal(splats, front_camera()) == (
        f"splats.opacities: expected values in [0, 1]; 1 of 5 rows are not, "
        f"the first is row 0: [{value}]"
    )


def test_cameras_without_focal_length_with_skew_or_nan_are_refused():
    camera, splats = front_camera(), random_splats(2)
    for index, value, expected in [
        ((0, 1, 1), 0.0, "focal lengths > 0"),
        ((0, 0, 0), -48.0, "focal lengths > 0"),
        ((0, 0, 1), 0.5, "no skew"),
    ]:
        wrong = replace(camera, intrinsics=changed(camera.intrinsics, *index, to=value))
        assert refusal(splats, wrong).startswith(
            f"cameras.intrinsics: expected {expected}; 1 of 1 rows are not, the first is row 0: "
        )
    pose = changed(camera.world_to_camera, 0, 1, 3, to=float("nan"))
    assert refusal(splats, replace(camera, world_to_camera=pose)).startswith(
        "cameras.world_to_camera: expected finite values; 1 of 1 rows are not"
    )


def test_exactly_one_form_of_shape_is_needed():
    splats = random_splats(2)
    covariances = torch.eye(3).repeat(2, 1, 1)
    for wrong in (
        replace(splats, quats=None),
        replace(splats, scales=None),
        replace(splats, quats=None, scales=None),
        replace(splats, covariances=covariances),
        replace(splats, quats=None, covariances=covariances),
    ):
        message = refusal(wrong, front_camera())
        assert message == "splats: give either quats and scales, or covariances"


def test_an_image_without_pixels_is_refused():
    message = refusal(random_splats(2), replace(front_camera(), width=0))
    assert message == "cameras: image size 0x30 has no pixel"


@pytest.mark.parametrize(
    ("field", "shape", "expected"),
    [
        ("opacities", (4, 1), "[4]"),
        ("quats", (4, 3), "[4, 4]"),
        ("scales", (3, 3), "[4, 3]"),
        ("means", (4, 2), "[4, 3]"),
        ("extra", (4,), "[4, any]"),
        ("extra", (5, 2), "[4, any]"),
        ("colors", (4,), "[4, any]"),
    ],
)
def test_wrong_shapes_are_refused(field, shape, expected):
    wrong = forced(random_splats(4), **{field: torch.zeros(shape)})
    message = refusal(wrong, front_camera(), CHEAP)
    assert message == f"splats.{field}: expected shape {expected}, found {list(shape)}"


def test_wrong_shapes_of_spherical_harmonics_are_refused():
    def with_colors(colors: Sh) -> Splats:
        return replace(random_splats(4), colors=colors)

    assert refusal(with_colors(Sh(torch.zeros(3, 4, 3), 1)), front_camera()) == (
        "splats.colors: expected shape [4, any, 3], found [3, 4, 3]"
    )
    assert refusal(with_colors(Sh(torch.zeros(4, 5, 3), 1)), front_camera()) == (
        "5 SH coefficients: expected 1, 4, 9, 16 or 25"
    )
    assert refusal(with_colors(Sh(torch.zeros(4, 4, 3), 5)), front_camera()) == (
        "splats.colors: expected degree 0 to 4, found 5"
    )
    constant, offsets = torch.zeros(4, 1, 3), torch.tensor([0, 0, 3, 6])
    ragged = Sh(constant, 1, torch.zeros(6, 3), offsets)
    assert refusal(with_colors(ragged), front_camera()) == (
        "splats.colors.offsets: expected shape [5], found [4]"
    )
    assert refusal(with_colors(Sh(constant, 1, offsets=torch.arange(5))), front_camera()) == (
        "splats.colors: expected rest beside offsets, found None"
    )


def ragged(offsets: torch.Tensor, rows: int = 6) -> Splats:
    colors = Sh(torch.zeros(3, 1, 3), 1, torch.zeros(rows, 3), offsets)
    return replace(random_splats(3), colors=colors)


def test_offsets_are_whole_numbers_beside_the_splats():
    Blank().render(ragged(torch.tensor([0, 3, 3, 6])), front_camera())
    assert refusal(ragged(torch.tensor([0, 3, 3, 6]).int()), front_camera(), CHEAP) == (
        "splats.colors.offsets: expected torch.int64, found torch.int32"
    )
    assert refusal(ragged(torch.tensor([0, 3, 3, 6]).to("meta")), front_camera(), CHEAP) == (
        "splats.colors.offsets: expected device cpu, found meta"
    )


def test_offsets_rise_from_zero_to_the_rows_of_rest():
    assert refusal(ragged(torch.tensor([0, 6, 3, 6])), front_camera()) == (
        "splats.colors.offsets: expected row lengths >= 0; 1 of 3 rows are not, "
        "the first is row 1: [-3]"
    )
    for offsets in ([0, 3, 3, 9], [0, 3, 3, 3], [3, 3, 3, 6]):
        assert refusal(ragged(torch.tensor(offsets)), front_camera()) == (
            "splats.colors.offsets: expected 0 first and the 6 rows of rest last, "
            f"found {offsets[0]} and {offsets[-1]}"
        )
    Blank().render(ragged(torch.tensor([0, 6, 3, 6])), front_camera(), CHEAP)


def test_wrong_shapes_of_cameras_are_refused():
    wrong = forced(front_camera(), intrinsics=torch.eye(3))
    assert refusal(random_splats(2), wrong) == (
        "cameras.intrinsics: expected shape [1, 3, 3], found [3, 3]"
    )


def test_one_floating_point_type_is_needed_everywhere():
    splats = random_splats(2)
    assert splats.scales is not None
    assert refusal(replace(splats, scales=splats.scales.double()), front_camera()) == (
        "splats.scales: expected torch.float32, found torch.float64"
    )
    assert refusal(splats, front_camera(dtype=torch.float64)) == (
        "cameras.world_to_camera: expected torch.float32, found torch.float64"
    )
    settings = RenderSettings(background=torch.zeros(3, dtype=torch.float64))
    assert refusal(splats, front_camera(), settings) == (
        "settings.background: expected torch.float32, found torch.float64"
    )


def test_one_device_is_needed_everywhere():
    splats = random_splats(2)
    assert refusal(splats, front_camera().to("meta")) == (
        "cameras.world_to_camera: expected device cpu, found meta"
    )


def test_the_background_has_as_many_channels_as_the_colours():
    settings = RenderSettings(background=torch.zeros(4))
    assert refusal(random_splats(2), front_camera(), settings) == (
        "settings.background: expected 3 channels, found 4"
    )
