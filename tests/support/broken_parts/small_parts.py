"""Metrics, samplers, exporters, importers, verbs and operators that break a promise."""

import sys
from dataclasses import dataclass, replace

import torch

from gsfw.core.errors import DataError
from gsfw.core.exchange import Exporter
from gsfw.core.metrics import Metric, Psnr
from gsfw.core.operators import Operators
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.samplers.uniform import UniformConfig
from support.broken_parts.registry import BROKEN, breaks

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
    def adam_(self, updates, settings, finite):
        bare = [replace(update, gradient=update.gradient.nan_to_num()) for update in updates]
        super().adam_(bare, settings, ~finite | finite)
