"""Small parts of every kind, registered as a plugin would register them, for settings to choose."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

from gsfw.core.capabilities import Capabilities, Feature, Needs
from gsfw.core.config import (
    DataManagerConfig,
    Detection,
    MethodConfig,
    RasterizerConfig,
    SamplerConfig,
    StrategyConfig,
)
from gsfw.core.step_settings import steps_field
from gsfw.plugins.discovery import Discovery, PluginSource
from gsfw.plugins.registry import Registry
from gsfw.plugins.specs import Spec, hookimpl


@dataclass
class Grow(StrategyConfig):
    every: int = steps_field(100, floor=50)
    """Steps between growing."""
    until: int = steps_field(15_000)
    """No growing after this step."""

    def refiners(self, scene):
        raise NotImplementedError


@dataclass
class Move(Grow):
    recommended: ClassVar[Mapping[str, Any]] = {"antialias": True}

    cap: int = 1000
    """Most splats there may be."""


@dataclass
class Demo(MethodConfig):
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "default": {},
        "fast": {"steps": 6000, "optim.sparse": True, "strategy.every": 10},
    }

    shape: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Size along x, y, z."""
    limit: float | None = None
    """Largest scale; none for no limit."""
    mode: Literal["soft", "hard"] = "soft"
    """How edges look."""

    def build(self):
        raise NotImplementedError


@dataclass
class Moving(Demo):
    strategy: StrategyConfig | None = field(default_factory=lambda: Move(cap=77))


class Base(RasterizerConfig):
    able: ClassVar[Capabilities]

    def capabilities(self):
        return self.able

    def build(self, device):
        raise NotImplementedError


ALL = frozenset(Feature)


@dataclass
class Slow(Base):
    able = Capabilities(devices=frozenset({"cpu", "cuda"}), features=ALL)
    tile: int = 16
    """Width of a tile, in pixels."""


@dataclass
class Fast(Base):
    able = Capabilities(
        devices=frozenset({"cpu"}), features=ALL - {Feature.ANTIALIAS}, preference=10
    )


@dataclass
class Gone(Base):
    able = Capabilities(unavailable="it needs a machine of another kind.", preference=99)


@dataclass
class Uniform(SamplerConfig):
    def build(self, views, seed, steps):
        raise NotImplementedError


@dataclass
class Source(DataManagerConfig):
    file: ClassVar[str] = ""
    priority: ClassVar[int] = 0

    @classmethod
    def detect(cls, path: Path):
        there = bool(cls.file) and (path / cls.file).exists()
        found = cls.file if there else "a hint" if (path / "hint").exists() else ""
        return Detection(there, cls.file, found, cls.priority)

    def build(self, request):
        raise NotImplementedError


@dataclass
class Apples(Source):
    file = "apples.txt"


@dataclass
class Pears(Source):
    recommended: ClassVar[Mapping[str, Any]] = {"background": "white", "steps": 3000}
    file = "pears.txt"
    priority = 5


@dataclass
class Synthetic(Source):
    def needs(self):
        return Needs(channels=3)


class FakePlugin:
    """What a package would register."""

    def spec(self, name: str, kind: type) -> Spec:
        return Spec(name, f"the {name}", f"{__name__}:{kind.__name__}")

    @hookimpl
    def gsfw_methods(self):
        return [self.spec("demo", Demo), self.spec("moving", Moving)]

    @hookimpl
    def gsfw_strategies(self):
        return [self.spec("adc", Grow), self.spec("mcmc", Move)]

    @hookimpl
    def gsfw_rasterizers(self):
        return [self.spec("slow", Slow), self.spec("fast", Fast), self.spec("gone", Gone)]

    @hookimpl
    def gsfw_datamanagers(self):
        kinds = {"apples": Apples, "pears": Pears, "synthetic": Synthetic}
        return [self.spec(name, kind) for name, kind in kinds.items()]

    @hookimpl
    def gsfw_samplers(self):
        return [self.spec("uniform", Uniform)]


def registry_of(*plugins: object) -> Registry:
    """A registry of these plugins and nothing else; each is of the package pkgN 1.0."""
    discovery = Discovery()
    for number, plugin in enumerate(plugins):
        discovery.add(plugin, PluginSource(f"plugin{number}", f"pkg{number}", "1.0"))
    return Registry(discovery)


def fake_registry() -> Registry:
    """The parts of this file."""
    return registry_of(FakePlugin())
