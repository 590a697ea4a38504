"""Rasterizers that break a promise."""

from dataclasses import dataclass, replace
from typing import ClassVar

from gsfw.core.capabilities import Feature
from gsfw.core.config import RasterizerConfig
from gsfw.core.rasterizer import Rasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from support.broken_parts.registry import breaks


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
