"""Configuration: plain dataclasses, one per choice; their fields are the command line's keys."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from gsfw.core.errors import ConfigError
from gsfw.core.hold_out import HoldOutBy
from gsfw.core.optim_config import OptimConfig
from gsfw.core.ranges import check_ranges, number
from gsfw.core.step_settings import steps_field

if TYPE_CHECKING:
    import torch

    from gsfw.core.callback import Callback
    from gsfw.core.capabilities import Capabilities, Needs
    from gsfw.core.datamanager import DataManager, DataRequest, Views
    from gsfw.core.method import Method
    from gsfw.core.rasterizer import Rasterizer
    from gsfw.core.refiner import Refiner
    from gsfw.core.sampler import Sampler
    from gsfw.core.scene import Scene

Config = TypeVar("Config")

MAX_SEED = 2**62 - 1
"""Largest seed: generators take 64-bit seeds, and some seeds are counted up from this one."""

AUTO = "auto"
"""Value of a setting that gsfw chooses itself."""
DENSE = "dense"
"""Value of ``init`` for points that stereo finds in the images."""
NO_BUDGET = "none"
"""The choice of no budget: the strategy alone limits the number of Gaussians."""
INIT_WORDS = (AUTO, "points", "random", DENSE)
"""Values of ``init`` that are not a file."""


def replace_at(config: Config, key: str, value: object) -> Config:
    """Copy ``config`` with a new value of the setting at a dotted key."""
    head, _, rest = key.partition(".")
    if rest:
        value = replace_at(getattr(config, head), rest, value)
    return replace(config, **{head: value})  # type: ignore[type-var]


@dataclass
class SlotConfig:
    """Settings of one choice (a strategy, a rasterizer, ...)."""

    renamed: ClassVar[Mapping[str, str]] = {}
    """Renamed settings: old name -> new name, so that old files and runs can be read.

    Groups may be renamed too; an empty new name marks a setting that has no effect any more.
    A value is renamed as "mode=old" -> "mode=new", under the current name of its setting.
    """
    acts_with: ClassVar[Mapping[str, str]] = {}
    """Conditions without which settings change nothing (``core.dependencies``)."""
    recommended: ClassVar[Mapping[str, Any]] = {}
    """Recommended settings of the run for this choice, by dotted key. The user's settings win, and
    parts that the method chooses itself, such as its sampler."""

    def recommendations(self) -> Mapping[str, Any]:
        """``recommended``, unless they depend on the values of this choice."""
        return self.recommended

    def needs(self) -> Needs:
        """The needs of this choice from the rasterizer."""
        from gsfw.core.capabilities import Needs

        return Needs()

    def check(self) -> None:
        """Check settings against each other, before any data is read.

        Raises:
            ConfigError: settings contradict each other.
        """


@dataclass
class StrategyConfig(SlotConfig, ABC):
    """Settings of a density strategy, chosen as ``strategy=NAME``, and of its budget."""

    acts_with: ClassVar[Mapping[str, str]] = {
        "budget_share": "budget=auto",
        "budget_every": "budget!=none",
    }

    budget: str = NO_BUDGET
    """Final number of Gaussians: none, auto (by the scene), a number, or megabytes as in 20MB."""
    budget_share: float = number(0.025, above=0, below=1)
    """Under budget=auto, each round prunes rows that sum to less than this part of the total."""
    budget_every: int = steps_field(1500, at_least=1, floor=50)
    """Under a budget, steps between rounds of pruning, in which the remaining rows compensate."""

    @abstractmethod
    def refiners(self, scene: Scene) -> tuple[Refiner, ...]:
        """Build the refiners of the strategy, in the order in which they edit rows.

        Raises:
            ConfigError: settings are out of range or contradict each other.
        """


@dataclass
class SamplerConfig(SlotConfig, ABC):
    """Settings of a view sampler, chosen as ``sampler=NAME``."""

    in_time_order: ClassVar[bool] = False
    """True if no step shows an earlier time than the step before it, as tracking needs it."""

    @abstractmethod
    def build(self, views: Views, seed: int, steps: int) -> Sampler:
        """Build the sampler of the training views.

        Args:
            views: the training split.
            seed: seed of the run; the only source of randomness.
            steps: length of the run.

        Raises:
            ConfigError: these views cannot be sampled in this way (no times, for instance).
        """


@dataclass
class RasterizerConfig(SlotConfig, ABC):
    """Settings of a rasterizer, chosen as ``rasterizer=NAME``."""

    @abstractmethod
    def capabilities(self) -> Capabilities:
        """Abilities of the rasterizer on this machine; builds nothing."""

    @abstractmethod
    def build(self, device: torch.device) -> Rasterizer:
        """Build the rasterizer.

        Raises:
            UnavailableError: it cannot run here.
        """


@dataclass(frozen=True)
class Detection:
    """Result of checking a folder or file for a data set of some format."""

    recognised: bool
    """True if this is a data set of the format."""
    looked_for: str
    """The sign of the format, as a phrase: "sparse/0/cameras.bin"."""
    found: str = ""
    """The sign that was found, as a phrase; empty if none was."""
    priority: int = 0
    """Priority among several formats that recognise the same folder; the highest wins."""


@dataclass
class DataManagerConfig(SlotConfig, ABC):
    """Settings of a source of data, chosen as ``datamanager=NAME`` or by what ``data`` holds."""

    @classmethod
    @abstractmethod
    def detect(cls, path: Path) -> Detection:
        """Check ``path`` for this format by file names only; reads no images."""

    @abstractmethod
    def build(self, request: DataRequest) -> DataManager:
        """Read cameras and points, and check the headers of the images.

        Raises:
            DataError: the data cannot be used; names the cause and the place.
        """


@dataclass
class CallbackConfig(ABC):
    """Settings of a callback, which are typed as ``callbacks.NAME.KEY=VALUE``."""

    acts_with: ClassVar[Mapping[str, str]] = {"": "enabled=true"}
    """Conditions without which settings change nothing (``core.dependencies``)."""

    enabled: bool = True
    """True to use the callback."""

    @abstractmethod
    def build(self) -> Callback:
        """Build the callback of one run."""

    def check(self) -> None:  # noqa: B027 - most have nothing to check.
        """Raise an error if the callback cannot work on this machine; before anything is loaded."""


@dataclass
class CallbackConfigs:
    """Settings of every callback; the settings of a run derive from it, with one field for each."""


@dataclass
class MethodConfig(ABC):
    """Settings that every run has; a method derives from them and may change the defaults.

    A field whose type is a slot's config (``strategy``, ``rasterizer``, ``datamanager``,
    ``sampler``) is chosen by name among the registered ones; ``None`` means ``auto``.
    """

    renamed: ClassVar[Mapping[str, str]] = {"init=stereo": "init=dense"}
    """Renamed settings, as in ``SlotConfig``; those of derived classes are added."""
    acts_with: ClassVar[Mapping[str, str]] = {
        "dense_points": "init=dense",
        "eval_views": "eval_every>0",
        "resolution_steps": "resolution_schedule=auto",
        "distractors_start": "ignore_distractors=true",
        "optim.exposure_lr": "exposure=true",
        "optim.exposure_lr_final": "exposure=true",
        "optim.exposure_start": "exposure=true",
        "optim.poses_lr": "refine_poses=true",
        "optim.poses_lr_final": "refine_poses=true",
        "optim.poses_start": "refine_poses=true",
        "optim.corrections_lr_steps": "exposure=true or refine_poses=true",
    }
    """Conditions without which settings change nothing (``core.dependencies``)."""
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {"default": {}}
    """Settings by dotted key, for ``preset=NAME``; each builds on the one named "default". Those of
    ``datamanager.*`` hold for the built-in scene only, such as its motion."""

    data: str = ""
    """Data set: a folder or file. Empty: the built-in scene, which needs none."""
    out: str = ""
    """Folder of the run. Empty: runs/SCENE/METHOD/TIME."""
    steps: int = number(30_000, at_least=1)
    """Training steps. Schedules follow in proportion, unless rescale=false."""
    minutes: float = number(0.0, at_least=0, below=math.inf)
    """Minutes of gsfw train from start to end, in which the run plans its steps; default: any."""
    until: str = ""
    """End at this PSNR in dB of training views set aside; auto: when more steps gain little."""
    held_back: int = number(0, at_least=0)
    """Training views that a run with until= sets aside until its last part."""
    pace: tuple[str, ...] = ()
    """Recorded decisions of a run with minutes= or until=, as UPDATE:PACE, to repeat it."""
    rescale: bool = True
    """Rescale every schedule without a value of its own by steps=N."""
    seed: int = number(42, at_least=0, at_most=MAX_SEED)
    """Seed of every generator; on the CPU the same seed gives the same bits."""
    device: str = AUTO
    """Device of the training: auto, cpu, cuda or cuda:N."""
    processes: int = number(0, at_least=0)
    """Processes that share the views of a step; 0: one. 1 gives the bits of any larger number."""
    shards: int = number(0, at_least=0)
    """Shards into which processes divide the Gaussians; 0: every process has all of them."""
    init: str = AUTO
    """Initial splats: auto (points if any), points, random, dense (from the images), or a file."""
    dense_points: int = number(0, at_least=0)
    """Maximum number of points of init=dense; 0: half as many as a training view has pixels."""
    sky: bool = False
    """Begin with a sphere of splats far behind everything, where views agree (outdoor captures)."""
    downscale: float = number(1.0, at_least=1, below=math.inf)
    """Shrink images by this factor (area filter); 2 halves the width and the height."""
    background: str = AUTO
    """Colour behind everything: white, black or r,g,b. auto: white where images have alpha."""
    random_background: bool = False
    """Use a random background at every step, so that empty space stays empty (needs alpha)."""
    checkpoint_every: int = steps_field(5000, floor=100)
    """Steps between checkpoints; 0: only at the end."""
    eval_every: int = steps_field(5000, floor=100)
    """Steps between evaluations on the held-out views; 0: only at the end."""
    eval_views: int = number(30, at_least=0)
    """Held-out views of evaluations before the last, evenly spread; 0: all."""
    log_every: int = number(10, at_least=1)
    """Steps between two logged steps."""
    holdout_every: int = number(8, at_least=0)
    """One image of n is held out, unless the data brings its own split; 0: none."""
    holdout_by: str = HoldOutBy.AUTO.value
    """How: name (every n-th by name), spread (over space), camera (whole cameras). auto: by name;
    whole panoramas; where several cameras film, whole ones; never what no other view shows, or the
    first time."""
    holdout: tuple[str, ...] = ()
    """Names of the images to hold out, instead of every n-th."""
    cache_mb: int = number(2048, at_least=0)
    """Memory of decoded images, in megabytes; where it is short, a quarter of it unless given."""
    data_cache_mb: int = number(4096, at_least=0)
    """Disk space for images of data=ADDRESS (https://...), in megabytes."""
    gpu_cache_mb: int = number(2048, at_least=0)
    """GPU memory for decoded images, in megabytes; 0: each use copies them."""
    check_memory: bool = True
    """Refuse a run whose start needs more memory than there is; false: train anyway."""
    graph: str = AUTO
    """auto: record steps on a GPU as CUDA graphs, which saves time of the host; off: do not."""
    resolution_schedule: str = "none"
    """Size of training images: none (full), or auto (small until they lack detail; faster)."""
    resolution_steps: int = steps_field(9000)
    """Step from which images are full under resolution_schedule=auto; 60 % of adc's growth."""
    exposure: bool = False
    """Learn the colour difference of each training image (gains, offsets), not of held-out ones."""
    ignore_distractors: bool = False
    """Leave out of each image what the others contradict: people, cars, hands (still scenes)."""
    distractors_start: int = steps_field(3000)
    """Steps that learn from whole images first under ignore_distractors=true."""
    refine_poses: bool = False
    """Learn small motions of the training cameras, for poses that are not quite right."""
    antialias: bool = False
    """Mip-Splatting's 2D filter: opacity decreases with the dilation of a splat."""
    profile: str = AUTO
    """Constants and cut-offs of renders: default, or gsplat-1.5. auto: the rasterizer's own."""
    validation: str = "cheap"
    """Checks of rasterizer inputs in the loop: cheap or full."""
    max_skipped: int = number(20, at_least=1)
    """Steps in a row that may be skipped because they were not finite before the run stops."""
    report: bool = True
    """Write report.html, a self-contained page, at the end of a completed run."""
    optim: OptimConfig = field(default_factory=OptimConfig)
    rasterizer: RasterizerConfig | None = None
    strategy: StrategyConfig | None = None
    datamanager: DataManagerConfig | None = None
    sampler: SamplerConfig | None = None
    callbacks: CallbackConfigs = field(default_factory=CallbackConfigs)

    @abstractmethod
    def build(self) -> Method:
        """Build the method.

        Raises:
            ConfigError: settings contradict each other.
        """

    def step_costs(self) -> tuple[tuple[int, float], ...]:
        """First step, from 0, and relative time of a step of each phase; for the remaining time."""
        return ((0, 1.0),)

    def needs(self) -> Needs:
        """The needs of the method itself from the rasterizer."""
        from gsfw.core.capabilities import Feature, Needs

        features = {Feature.GRADIENT, Feature.SH}
        features |= {Feature.ANTIALIAS} if self.antialias else set()
        features |= {Feature.POSE_GRADIENT} if self.refine_poses else set()
        profile = "" if self.profile == AUTO else self.profile
        return Needs(features=frozenset(features), profile=profile)

    def check(self) -> None:
        """Check the ranges of all values, and the settings that every run has.

        Raises:
            ConfigError: a value is wrong; names the key, the expected and the given value.
        """
        from gsfw.core.background import parse_background
        from gsfw.core.numerics import PROFILES

        check_ranges(self)
        parse_background(self.background)
        self._check_resolution()
        for part in (self.strategy, self.rasterizer, self.datamanager, self.sampler):
            if part is not None:
                part.check()
        known = {
            "holdout_by": [kind.value for kind in HoldOutBy],
            "graph": [AUTO, "off"],
            "validation": ["cheap", "full"],
            "profile": [AUTO, *PROFILES],
        }
        for key, words in known.items():
            if getattr(self, key) not in words:
                expected = f"{', '.join(words[:-1])} or {words[-1]}"
                raise ConfigError(f"{key}={getattr(self, key)}: expected {expected}.")

    def _check_resolution(self) -> None:
        schedule = self.resolution_schedule
        if schedule not in ("none", AUTO):
            raise ConfigError(f"resolution_schedule={schedule}: expected none or auto.")
        if schedule == AUTO and self.resolution_steps >= self.steps:
            raise ConfigError(
                f"resolution_steps={self.resolution_steps}: expected less than steps={self.steps}, "
                "so that training ends on full-size images.",
                "Leave it out: it then follows from steps (not with rescale=false). Or give less.",
            )
