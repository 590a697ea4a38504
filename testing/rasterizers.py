"""Promises of rasterizers: what they claim, against the reference in float64."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial

import torch
from torch import Tensor

from gsfw.core.cameras import CameraModel
from gsfw.core.capabilities import SPLATTING, Determinism, Feature
from gsfw.core.numerics import DEFAULT, PROFILES
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.splats import Splats
from gsfw.plugins.registry import Registry
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.entrants import Entrant, entrant_of
from gsfw.studies.stress.case import Drawing, Section, StressCase, front_camera, random_splats
from gsfw.studies.stress.catalogue import CASES
from gsfw.studies.stress.catalogue.variants import EVERYTHING
from gsfw.studies.stress.claimed import left_out, without
from gsfw.studies.stress.drawn import draw_everything, mixed, same_bits
from gsfw.studies.stress.measure import Oracle, measure
from gsfw.testing.promise import NotApplicable, Promise, require
from gsfw.testing.subject import Subject
from gsfw.testing.trial import Losses, trial

SAMPLE = 5
"""Every fifth case of each section is drawn here; ``gsfw stress`` draws them all."""
LARGE = ("image/16384x64", "layers/100000", "layers/5000")
"""Cases that take long in plain torch."""
SIZES = ((1, 1), (17, 5), (33, 31), (16, 16))
"""Widths and heights, most of them no multiples of a tile."""
STEP = {torch.float32: 1e-3, torch.float64: 1e-6}
"""Half the distance of the two images of a finite difference."""
SLOPE = {torch.float32: 3e-2, torch.float64: 1e-6}
"""Largest relative error of a derivative along a random direction."""


@lru_cache(maxsize=1)
def _oracle() -> Oracle:
    return Oracle(ReferenceRasterizer(), keep=500)


def _entrant(subject: Subject) -> Entrant:
    """The backend, on the device that it usually runs on.

    Raises:
        NotApplicable: it cannot run on this machine.
    """
    able = subject.target().capabilities()
    if able.unavailable:
        raise NotApplicable(f"it cannot run here: {able.unavailable}")
    registry: Registry = subject.registry
    return subject.once("entrant", lambda: entrant_of(subject.name, registry))


def _splatting(subject: Subject) -> Entrant:
    """The backend, if it claims to render by splatting's rule.

    Raises:
        NotApplicable: it has a rule of its own, or cannot run on this machine.
    """
    found = _entrant(subject)
    if found.capabilities.rule != SPLATTING:
        raise NotApplicable(f"its rule is {found.capabilities.rule}, and not {SPLATTING}")
    return found


def _claims(subject: Subject) -> None:
    entrant = _entrant(subject)
    able, built = entrant.capabilities, entrant.rasterizer.capabilities()
    for name in ("devices", "camera_models", "features", "max_channels", "rule"):
        require(
            getattr(able, name) == getattr(built, name),
            f"{name} of the configuration and of the rasterizer differ.",
            "Let capabilities() of the configuration return that of the rasterizer's class.",
        )
    require(bool(able.devices), "it claims no device.", 'Give devices=frozenset({"cpu"}).')
    require(bool(able.camera_models), "it claims no camera model.", "Give camera_models.")


def _section(section: Section, subject: Subject) -> None:
    entrant = replace(_splatting(subject), threads=(1,))
    cases = [
        case
        for case in CASES.values()
        if case.section is section and not case.name.startswith(LARGE)
    ]
    judged = 0
    for dtype in (torch.float32, torch.float64):
        for case in cases[::SAMPLE]:
            result = measure(entrant, case, dtype, _oracle())
            judged += not result.not_claimed
            require(
                not result.faults,
                f"{case.name}, {result.dtype}: {'; '.join(result.faults[:2])}.",
                f"See it alone: gsfw stress rasterizer={subject.name} only={case.name}. If the "
                "backend cannot do this, do not claim the feature.",
            )
    if not judged:
        raise NotApplicable(f"it claims nothing that a case of {section.value} needs")


def _ordinary(
    entrant: Entrant, count: int = 12, width: int = 20, height: int = 15, views: int = 1
) -> Drawing:
    """An ordinary scene with all that a backend claims, in float64 if it can."""
    able = entrant.capabilities
    dtype = torch.float64 if Feature.FLOAT64 in able.features else torch.float32
    splats = random_splats(count, degree=1, dtype=torch.float32)
    poses = front_camera(width, height).select([0] * views)
    shift = torch.zeros_like(poses.world_to_camera)
    shift[:, 0, 3] = 0.1 * torch.arange(views)
    models = able.camera_models
    model = CameraModel.PINHOLE if CameraModel.PINHOLE in models else min(models, key=str)
    cameras = replace(poses, world_to_camera=poses.world_to_camera + shift, model=model)
    profile = PROFILES.get(able.profile, DEFAULT)
    drawing = Drawing(splats, cameras, replace(EVERYTHING, near=0.01, profile=profile))
    case = StressCase("shape/ordinary", lambda: drawing)
    drawing = without(drawing, left_out(case, drawing, able))
    return drawing.double() if dtype == torch.float64 else drawing


def _check_against_reference(entrant: Entrant, drawing: Drawing, what: str) -> None:
    """Compare images with those of the reference in float64."""
    with torch.no_grad():
        found = entrant.rasterizer.render(
            drawing.splats.to(entrant.device),
            drawing.cameras.to(entrant.device),
            drawing.to(entrant.device).settings,
        )
        exact = drawing.double()
        expected = ReferenceRasterizer().render(exact.splats, exact.cameras, exact.settings)
    for name in ("color", "alpha", "depth", "extra"):
        image, truth = getattr(found, name), getattr(expected, name)
        if truth is None:
            continue
        require(
            image is not None and image.shape == truth.shape,
            f"{what}: {name} has the shape {None if image is None else tuple(image.shape)}, "
            f"expected {tuple(truth.shape)}.",
            "Give every image that the settings ask for the shape [cameras, height, width, d].",
        )
        off = (image.cpu().double() - truth).abs().max().item() if truth.numel() else 0.0
        require(
            off <= 1e-2,
            f"{what}: the error of {name} is {off:.2g}.",
            "Compare with rasterizers/reference, pixel by pixel.",
        )


def _empty_scene(subject: Subject) -> None:
    entrant = _splatting(subject)
    for count in (0, 1):
        _check_against_reference(entrant, _ordinary(entrant, count), f"{count} splats")


def _image_sizes(subject: Subject) -> None:
    entrant = _splatting(subject)
    for width, height in SIZES:
        drawing = _ordinary(entrant, width=width, height=height)
        _check_against_reference(entrant, drawing, f"{width} x {height} pixels")


def _several_cameras(subject: Subject) -> None:
    entrant = _entrant(subject)
    drawing = _ordinary(entrant, views=3).to(entrant.device)
    render = entrant.rasterizer.render
    together = render(drawing.splats, drawing.cameras, drawing.settings)
    for view in range(3):
        alone = render(drawing.splats, drawing.cameras.select([view]), drawing.settings)
        off = (together.color[view] - alone.color[0]).abs().max().item()
        require(
            off <= 1e-5,
            f"view {view} of three differs by {off:.2g} from a render of its own.",
            "Render every camera of a call with its own pose and intrinsics.",
        )


def _determinism(subject: Subject) -> None:
    entrant = _entrant(subject)
    if entrant.capabilities.determinism is not Determinism.BITWISE:
        raise NotApplicable("it claims no determinism")
    drawing = _ordinary(entrant, 40, 48, 36).to(entrant.device)
    before, drawn = torch.get_num_threads(), []
    try:
        for threads in (*entrant.threads, entrant.threads[0]):
            torch.set_num_threads(threads)
            drawn.append(draw_everything(entrant.rasterizer, drawing))
    finally:
        torch.set_num_threads(before)
    require(
        all(same_bits(drawn[0], other) for other in drawn[1:]),
        "a second render has different bits.",
        "Sum in a fixed order with any number of threads, or claim Determinism.NONE.",
    )


def _gradients(subject: Subject) -> None:
    entrant = _entrant(subject)
    able = entrant.capabilities
    if Feature.GRADIENT not in able.features:
        raise NotApplicable("it claims no gradients")
    if able.profile:
        raise NotApplicable("its cut-offs cannot be switched off, and images jump there")
    drawing = _ordinary(entrant)
    drawing = replace(
        drawing,
        settings=replace(
            drawing.settings, profile=DEFAULT.without_cutoffs(), statistics=frozenset()
        ),
    ).to(entrant.device)
    analytic = draw_everything(entrant.rasterizer, drawing)
    dtype = drawing.splats.means.dtype
    names = [*drawing.splats.tensors()]
    names += ["world_to_camera"] if Feature.POSE_GRADIENT in drawing.gradients else []
    for name in names:
        slope, moved = _finite_difference(entrant.rasterizer, drawing, name, STEP[dtype])
        found = (analytic[f"gradient of {name}"].double() * moved).sum().item()
        scale = max(abs(slope), analytic[f"gradient of {name}"].double().norm().item(), 1e-6)
        require(
            abs(found - slope) <= SLOPE[dtype] * scale,
            f"the derivative by {name} along a random direction is {found:.6g}; finite differences "
            f"give {slope:.6g}.",
            "Compare the backward pass with autograd of rasterizers/reference.",
        )


def _finite_difference(
    rasterizer: Rasterizer, drawing: Drawing, name: str, step: float
) -> tuple[float, Tensor]:
    """The derivative of a loss along a random direction of one input, and the direction."""
    generator = torch.Generator().manual_seed(3)
    cameras = drawing.cameras
    given = cameras.world_to_camera if name == "world_to_camera" else drawing.splats.tensors()[name]
    direction = torch.randn(given.shape, generator=generator, dtype=torch.float64)
    if name == "world_to_camera":
        direction[:, 3] = 0
    direction /= direction.norm()

    def loss(sign: int) -> float:
        moved = given + (sign * step * direction).to(given)
        if name == "world_to_camera":
            splats, views = drawing.splats, replace(cameras, world_to_camera=moved)
        else:
            splats, views = _with(drawing.splats, name, moved), cameras
        with torch.no_grad():
            output = rasterizer.render(splats, views, drawing.settings)
            double = replace(
                output,
                color=output.color.double(),
                alpha=output.alpha.double(),
                depth=None if output.depth is None else output.depth.double(),
                extra=None if output.extra is None else output.extra.double(),
            )
            return mixed(double).item()

    return (loss(1) - loss(-1)) / (2 * step), direction


def _with(splats: Splats, name: str, values: Tensor) -> Splats:
    """Splats with other values of one tensor."""
    named = iter(splats.tensors())
    return splats.map(lambda tensor: values if next(named) == name else tensor)


def _trains(subject: Subject) -> None:
    entrant = _entrant(subject)
    if not {Feature.GRADIENT, Feature.SH} <= entrant.capabilities.features:
        raise NotApplicable("it claims no gradients, or no spherical harmonics")
    run = trial(subject, "trains", {"rasterizer": subject.name, "device": entrant.device.type})
    watched = Losses()
    run.trainer([watched]).fit()
    first, last = sum(watched.losses[:5]), sum(watched.losses[-5:])
    require(
        last < first,
        f"over 20 steps of method 3dgs the loss goes from {first / 5:.4f} to {last / 5:.4f}.",
        "Check the gradients.",
    )


PROMISES = (
    Promise("claims-agree", "Configuration and rasterizer claim the same capabilities.", _claims),
    Promise("empty-scene", "Images of no splat and of one agree with the reference.", _empty_scene),
    Promise("image-sizes", "Images of any size agree with the reference.", _image_sizes),
    Promise(
        "several-cameras",
        "Several cameras in one call give the images of single calls.",
        _several_cameras,
    ),
    Promise(
        "determinism-as-claimed",
        "A rasterizer that claims bitwise determinism renders the same bits again.",
        _determinism,
    ),
    Promise(
        "gradients-by-finite-differences",
        "Gradients of all inputs agree with finite differences of the images.",
        _gradients,
    ),
    *(
        Promise(
            f"extremes-of-{section.value}",
            f"A sample of the cases of gsfw stress on {section.value} passes, without features "
            "that the backend does not claim.",
            partial(_section, section),
        )
        for section in Section
        if section not in (Section.SIZE, Section.TIME)
    ),
    Promise("trains", "Method 3dgs learns with it in 20 steps.", _trains),
)
