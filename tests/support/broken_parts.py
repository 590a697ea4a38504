"""Parts that each break one promise of the conformance kit, for the tests that it is noticed."""

import random
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import torch

from gsfw.core.batch import Batch
from gsfw.core.callback import Callback
from gsfw.core.capabilities import Feature
from gsfw.core.column import Column
from gsfw.core.config import Detection, RasterizerConfig, SamplerConfig, StrategyConfig
from gsfw.core.datamanager import WrappedDataManager
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.exchange import Exporter
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.resolution import MIN_SIDE
from gsfw.core.metrics import Metric, Psnr
from gsfw.core.operators import Operators
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.refiner import Refiner
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.plugins.registry import SLOTS
from gsfw.plugins.specs import Spec, hookimpl
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.samplers.uniform import UniformConfig

BROKEN: dict[tuple[str, str], type] = {}
"""Each broken part by its kind and the promise that it breaks."""


OTHERS: dict[str, type] = {}
"""Methods by name whose fault is seen by whichever promise is checked first."""


def breaks(slot: str, promise: str):
    def note(kind):
        BROKEN[slot, promise] = kind
        return kind

    return note


class Plugin:
    """Registers all broken parts, by the promises that they break."""


def _hook(slot: str):
    def specs(self):
        named = {f"breaks-{promise}": kind for (of, promise), kind in BROKEN.items() if of == slot}
        named |= OTHERS if slot == "method" else {}
        return [
            Spec(name, "Faulty", f"{__name__}:{kind.__qualname__}") for name, kind in named.items()
        ]

    return hookimpl(specs)


for _slot, _name in SLOTS.items():
    setattr(Plugin, _name, _hook(_slot))


# Every kind.


@breaks("metric", "fits-its-contract")
class OldCall(Metric):
    def __call__(self, rendered, target):
        return 0.0


@breaks("sampler", "settings-round-trip")
@dataclass
class OddDefault(UniformConfig):
    share: int = 0.5  # type: ignore[assignment]
    """A share."""


@breaks("sampler", "settings-are-documented")
@dataclass
class Undocumented(UniformConfig):
    share: float = 0.5


@breaks("sampler", "bad-values-are-refused")
@dataclass
class Unchecked(UniformConfig):
    every: int = 3
    """Divides something."""

    def build(self, views, seed, steps):
        assert steps // self.every
        return super().build(views, seed, steps)


# Metrics.


@breaks("metric", "honours-valid")
class IgnoresValid(Metric):
    def __call__(self, rendered, target, valid):
        return float((rendered - target).abs().mean())


@breaks("metric", "equal-images-are-finite")
class Unbounded(Metric):
    def __call__(self, rendered, target, valid):
        off = ((rendered - target) ** 2)[slice(None) if valid is None else valid[..., 0]]
        return float(-torch.log10(off.mean()))


@breaks("metric", "figures-are-numbers")
class NotANumber(Metric):
    def __call__(self, rendered, target, valid):
        return float((rendered.std() - target.std()) / target.std())


@breaks("metric", "changes-no-image")
class InPlace(Psnr):
    def __call__(self, rendered, target, valid):
        return super().__call__(rendered.clamp_(0, 1), target, valid)


# Samplers.


class _Changed(UniformConfig):
    """A uniform sampler with a fault."""

    def build(self, views, seed, steps):
        return self.change(super().build(views, seed, steps), len(views))


@breaks("sampler", "seed-decides")
@dataclass
class Random(_Changed):
    def change(self, sampler, count):
        sampler.next = lambda: (int(torch.randint(count, ())),)
        return sampler


@breaks("sampler", "state-is-complete")
@dataclass
class Forgetful(_Changed):
    def change(self, sampler, count):
        sampler.load_state_dict = lambda state: None
        return sampler


@breaks("sampler", "all-views-are-seen")
@dataclass
class Partial(_Changed):
    def change(self, sampler, count):
        found = sampler.next
        sampler.next = lambda: tuple(min(view, count - 2) for view in found())
        return sampler


@breaks("sampler", "peek-changes-nothing")
@dataclass
class Advancing(_Changed):
    def change(self, sampler, count):
        sampler.peek = lambda number: sampler.next()
        return sampler


# Exporters and importers.


@breaks("exporter", "writes-what-it-holds")
class NoSuffix(PlyExporter):
    suffix = "ply"


@breaks("exporter", "round-trips")
class Faded(PlyExporter):
    def write(self, path, source):
        content = source.splat_file()
        splats = replace(content.splats, opacities=content.splats.opacities * 0.5)
        super().write(path, replace(content, splats=splats))


@breaks("exporter", "writes-the-world")
class Moved(PlyExporter):
    def write(self, path, source):
        content = source.splat_file()
        splats = replace(content.splats, means=content.splats.means + 1)
        super().write(path, replace(content, splats=splats))


@breaks("exporter", "full-disk-leaves-the-old-file")
class NotAtomic(Exporter):
    suffix = ".txt"

    def write(self, path, source):
        path.write_text(str(source.splat_file().splats.means.tolist()))


@breaks("exporter", "refuses-what-is-not-finite")
class Trusting(NotAtomic):
    pass


@breaks("importer", "reads-splats")
class SinglePrecision(PlyImporter):
    def read(self, path):
        content = super().read(path)
        return replace(content, splats=content.splats.map(lambda tensor: tensor.float()))


@breaks("importer", "damaged-files-are-refused")
class Raw(PlyImporter):
    def read(self, path):
        try:
            return super().read(path)
        except DataError as error:
            raise IndexError("list index out of range") from error


@breaks("importer", "changed-bytes-end-in-words")
class AlsoRaw(Raw):
    pass


@breaks("importer", "recognises-never-raises")
class Curious(PlyImporter):
    @classmethod
    def recognises(cls, path):
        return path.read_bytes()[:3] == b"ply"


# Verbs and operators.


def silent(arguments):
    return 0


def careless(arguments):
    sys.stdout.write("help of this verb" if "--help" in arguments else "")
    return 0


BROKEN["command", "shows-help"] = silent  # type: ignore[assignment]
BROKEN["command", "mistakes-are-messages"] = careless  # type: ignore[assignment]


@breaks("operators", "losses-agree")
class NoMask(Operators):
    def l1_dssim(self, rendered, target, valid=None):
        return super().l1_dssim(rendered, target)


@breaks("operators", "adam-agrees")
class NoGate(Operators):
    def adam_(self, values, gradient, moments, rate, settings, finite, rows=None):
        super().adam_(values, gradient.nan_to_num(), moments, rate, settings, ~finite | finite)


# Rasterizers.


@dataclass
class _Reference(RasterizerConfig):
    """The reference with a fault, claimed to be whole."""

    kind: ClassVar[type[Rasterizer]]

    def capabilities(self):
        return self.kind.capabilities()

    def build(self, device):
        return self.kind()


class _Faulty(Rasterizer):
    def __init__(self):
        self.renders = 0

    @classmethod
    def capabilities(cls):
        return ReferenceRasterizer.capabilities()

    def _render(self, splats, cameras, settings):
        self.renders += 1
        found = ReferenceRasterizer()._render(splats, cameras, settings)
        return self.spoil(found, splats, cameras)


def _rasterizer(promise: str, spoil, **members):
    kind = type(f"Faulty_{promise.replace('-', '_')}", (_Faulty,), {"spoil": spoil, **members})
    name = f"Config_{promise.replace('-', '_')}"
    config = dataclass(
        type(name, (_Reference,), {"kind": kind, "__module__": __name__, "__doc__": "Faulty."})
    )
    globals()[name] = breaks("rasterizer", promise)(config)


def _dark_if_empty(self, found, splats, cameras):
    return replace(found, color=found.color + (0.5 if len(splats) < 2 else 0.0))


def _wrong_at_the_edge(self, found, splats, cameras):
    color = found.color.clone()
    color[:, :, cameras.width // 16 * 16 :] += 0.1 * (cameras.width > 16)
    return replace(found, color=color)


def _first_camera_for_all(self, found, splats, cameras):
    return replace(found, color=found.color[:1].expand_as(found.color))


def _other_bits(self, found, splats, cameras):
    return replace(found, color=found.color + 1e-9 * self.renders)


def _half_gradient(self, found, splats, cameras):
    return replace(found, color=0.5 * found.color + 0.5 * found.color.detach())


def _no_needles(self, found, splats, cameras):
    wide = splats.scales is not None and len(splats) and bool(splats.scales.amax() > 10)
    return replace(found, color=found.color * (0.9 if wide else 1.0))


def _unlearnable(self, found, splats, cameras):
    color = found.color
    if color.requires_grad:
        color.register_hook(lambda gradient: -gradient)
    return replace(found, color=color + 0)


_rasterizer("empty-scene", _dark_if_empty)
_rasterizer("image-sizes", _wrong_at_the_edge)
_rasterizer("several-cameras", _first_camera_for_all)
_rasterizer("determinism-as-claimed", _other_bits)
_rasterizer("gradients-by-finite-differences", _half_gradient)
_rasterizer("extremes-of-shape", _no_needles)
_rasterizer("trains", lambda self, found, splats, cameras: replace(
    found, color=-found.color + 2 * found.color.detach()
))  # fmt: skip


@breaks("rasterizer", "claims-agree")
@dataclass
class ClaimsMore(_Reference):
    kind: ClassVar[type[Rasterizer]] = ReferenceRasterizer

    def capabilities(self):
        able = self.kind.capabilities()
        return replace(able, features=able.features - {Feature.SH})


# Data managers.


@dataclass
class _Scene(SyntheticConfig):
    """The built-in scene at its smallest, with a fault."""

    views: int = 6
    """Training views."""
    eval_views: int = 2
    """Held-out views."""
    width: int = 24
    """Width."""
    height: int = 18
    """Height."""
    points: int = 80
    """Points."""

    def build(self, request):
        return type(self).wrapper(super().build(request))


def _data(promise: str, **members):
    wrapper = type("Faulty", (WrappedDataManager,), members)
    name = f"Data_{promise.replace('-', '_')}"
    config = dataclass(
        type(name, (_Scene,), {"wrapper": wrapper, "__module__": __name__, "__doc__": "Faulty."})
    )
    globals()[name] = breaks("datamanager", promise)(config)


def _with_images(change):
    def load(self, split, indices, device):
        return [change(batch) for batch in self.given.load(split, indices, device)]

    return load


def _skewed_views(self, split):
    views = self.given.views(split)
    cameras = [
        replace(camera, world_to_camera=camera.world_to_camera * 1.1) for camera in views.cameras
    ]
    return replace(views, cameras=tuple(cameras))


def _same_names(self, split):
    views = self.given.views(split)
    return replace(views, names=tuple(f"view_{n}" for n in range(len(views))))


def _random_image(batch: Batch) -> Batch:
    return replace(batch, images=torch.full_like(batch.images, random.random()))


_data("loads-the-same", load=_with_images(_random_image))
_data("views-are-sound", views=_skewed_views)
_data("batches-fit-their-views", load=_with_images(lambda b: replace(b, images=b.images * 255)))
_data("splits-are-disjoint", views=_same_names)
_data("masks-fit-their-images", load=_with_images(
    lambda b: replace(b, mask=torch.zeros_like(b.images[..., :1], dtype=torch.bool))
))  # fmt: skip


@breaks("datamanager", "recognises-its-format")
@dataclass
class Greedy(SyntheticConfig):
    @classmethod
    def detect(cls, path: Path) -> Detection:
        return Detection(True, "anything", "something")


@breaks("datamanager", "downscale-halves")
@dataclass
class NeverShrinks(_Scene):
    wrapper = WrappedDataManager

    def build(self, request):
        return super().build(replace(request, downscale=1.0))


@breaks("datamanager", "missing-data-is-named")
@dataclass
class AcceptsAnything(_Scene):
    wrapper = WrappedDataManager

    def build(self, request):
        return super().build(replace(request, path=None))


@breaks("datamanager", "damaged-files-are-named")
@dataclass
class ReadsText(_Scene):
    wrapper = WrappedDataManager

    def build(self, request):
        assert len((request.path / "poses.txt").read_text().split()) == 4
        return super().build(replace(request, path=None))


# Strategies, methods and callbacks: their runs train.


class _Refiner(Refiner):
    name = "faulty"

    def __init__(self, edit):
        self._edit = edit

    def refine(self, context):
        return {} if context.done % 10 else self._edit(context)


def _strategy(promise: str, edit):
    name = f"Strategy_{promise.replace('-', '_')}"

    def refiners(self, scene):
        return (_Refiner(edit),)

    members = {"refiners": refiners, "__module__": __name__, "__doc__": "Faulty."}
    globals()[name] = breaks("strategy", promise)(dataclass(type(name, (StrategyConfig,), members)))


def _clone(context):
    rows = torch.arange(3)
    context.table.append(context.model.clone_rows(rows))
    return {"cloned": 3}


def _by_hand(context):
    column = next(iter(context.model.columns().values()))
    with torch.no_grad():
        column.values[0] = torch.nan
    return {}


def _at_random(context):
    rows = torch.randperm(len(context.table))[:3]
    context.table.append(context.model.clone_rows(rows))
    return {"cloned": 3}


_strategy("runs-with-3dgs", _by_hand)
_strategy("several-batches", _by_hand)
_strategy("not-finite-steps", _by_hand)
_strategy("respects-max-rows", _clone)
_strategy("respects-may-grow", _clone)
_strategy("respects-hold", _clone)
_strategy("uses-the-given-generator", _at_random)


class _Counting(_Refiner):
    """Clones by a counter that is in no state."""

    def __init__(self):
        super().__init__(self._grow)
        self._calls = 0

    def _grow(self, context):
        self._calls += 1
        rows = torch.arange(self._calls)
        context.table.append(context.model.clone_rows(rows))
        return {"cloned": self._calls}


@breaks("strategy", "resumes-to-the-same-bits")
@dataclass
class Unsaved(StrategyConfig):
    """A strategy with a state that it does not save."""

    def refiners(self, scene):
        return (_Counting(),)


def _method(promise: str, model_members=None, **members):
    name = f"Method_{promise.replace('-', '_')}"
    model = type("FaultyModel", (StaticGaussians,), model_members or {})
    method = type("FaultyMethod", (StaticGaussiansMethod,), {"model_class": model, **members})

    def build(self):
        return method(self)

    made = {"build": build, "__module__": __name__, "__doc__": "Faulty."}
    globals()[name] = breaks("method", promise)(
        dataclass(type(name, (StaticGaussiansConfig,), made))
    )


def _detached(self, context):
    found = StaticGaussiansMethod.losses(self, context)
    return {name: -value + 2 * value.detach() for name, value in found.items()}


def _weighted_by_a_counter(self, context):
    self.calls = getattr(self, "calls", 0) + 1
    found = StaticGaussiansMethod.losses(self, context)
    return {name: value * (1 + 0.01 * self.calls) for name, value in found.items()}


def _noisy(self, context):
    found = StaticGaussiansMethod.losses(self, context)
    return {name: value * (1 + 0.1 * torch.rand(())) for name, value in found.items()}


def _drifting(self, time=None, cameras=None):
    splats = StaticGaussians.splats(self, time, cameras)
    return splats if time is None else replace(splats, means=splats.means + time)


def _half_of_the_columns(self, rows, generator=None):
    return dict(list(StaticGaussians.clone_rows(self, rows, generator).items())[:2])


def _changes_nothing(self, function):
    return ()


def _large_children(self, rows, copies, generator):
    return StaticGaussians.clone_rows(self, rows.repeat(copies))


def _needs_neighbours(self, scene, operators, generator, initial):
    assert len(scene.points) > 3, "neighbours"
    return StaticGaussiansMethod.build_model(self, scene, operators, generator, initial)


def _not_small(self, context):
    assert context.batch.cameras.width == 2 * MIN_SIDE, "the full size"
    return StaticGaussiansMethod.losses(self, context)


def _outside_state(self, time=None, cameras=None):
    splats = StaticGaussians.splats(self, time, cameras)
    self.shift = getattr(self, "shift", random.random())
    return replace(splats, means=splats.means + self.shift)


def _logits(self, time=None, cameras=None):
    splats = StaticGaussians.splats(self, time, cameras)
    return replace(splats, quats=splats.quats * 1.0, opacities=splats.opacities * 1.5)


def _with_another_argument(self, context, extra):
    return {}


_method("fits-its-contract", losses=_with_another_argument)
_method("learns", losses=_detached)
_method("resumes-to-the-same-bits", losses=_weighted_by_a_counter)
_method("uses-the-given-generator", losses=_noisy)
_method("times-are-honoured", {"splats": _drifting})
_method("edits-keep-columns", {"clone_rows": _half_of_the_columns})
_method("opacities-change-as-asked", {"change_opacities_": _changes_nothing})
_method("children-are-alike", {"split_rows": _large_children})
_method("runs-with-adc", {"split_rows": _half_of_the_columns, "clone_rows": _half_of_the_columns})
_method("one-gaussian", build_model=_needs_neighbours)
_method("runs-at-lower-resolution", losses=_not_small)
_method("model-file-renders-the-same", {"splats": _outside_state})
_method("export-renders-the-same", {"splats": _logits})


@dataclass
class NeedsFeatures(StaticGaussiansConfig):
    def build(self):
        return NeedsFeaturesMethod(self)


class NeedsFeaturesMethod(StaticGaussiansMethod):
    def build_model(self, scene, operators, generator, initial):
        raise ConfigError("the data has no map.")


@dataclass
class OneRowTooMany(StaticGaussiansConfig):
    def build(self):
        return OneRowTooManyMethod(self)


class OneRowTooManyMethod(StaticGaussiansMethod):
    def extra_columns(self, scene, count):
        return {"more": Column(torch.zeros(count + 1, 2), LearningRate(0.1))}


OTHERS |= {"needs-features": NeedsFeatures, "one-row-too-many": OneRowTooMany}


@breaks("method", "presets-resolve")
@dataclass
class OldPreset(StaticGaussiansConfig):
    presets: ClassVar = {"default": {}, "fast": {"there_is_no_such_key": 1}}


@breaks("callback", "takes-all-events")
class OldFigures(Callback):
    def on_evaluation(self, step, evaluation, control):
        assert evaluation.means["lpips"]


@breaks("callback", "changes-no-bits")
class ChangesTheModel(Callback):
    def on_start(self, run, control):
        self.model = run.model

    def on_tick(self, step, control):
        with torch.no_grad():
            next(iter(self.model.model.columns().values())).values.mul_(1.001)


@breaks("callback", "leaves-the-global-generator")
class Draws(Callback):
    def on_tick(self, step, control):
        torch.rand(())


@breaks("callback", "a-stop-works")
class NeedsAnEnd(Callback):
    def on_end(self, step, summary):
        assert summary["psnr"]


__all__ = ["BROKEN", "Plugin", "SamplerConfig"]
