"""Compose: checks that the chosen parts fit together, then builds a run from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch

from gsfw.core.background import parse_background
from gsfw.core.callback import Callback, RunInfo
from gsfw.core.capabilities import Feature, Needs
from gsfw.core.config import (
    AUTO,
    NO_BUDGET,
    MethodConfig,
    RasterizerConfig,
    SamplerConfig,
    StrategyConfig,
)
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.errors import ConfigError
from gsfw.core.loop.corrections import CaptureCorrections
from gsfw.core.loop.distractors import PROTOCOL, Distractors
from gsfw.core.loop.exposures import Exposures
from gsfw.core.loop.goal import Goal
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.loop.pose_refinement import PoseRefinement
from gsfw.core.loop.refined_capture import RefinedCapture
from gsfw.core.loop.resolution import FULL_SIZE, ResolutionSchedule, measured
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.timekeeper import Timekeeper
from gsfw.core.loop.trainer import Trainer
from gsfw.core.loop.training_parts import TrainingParts, TrainingPlan
from gsfw.core.method import Method
from gsfw.core.model import DensifiableModel, PrimitiveModel
from gsfw.core.numerics import PROFILES
from gsfw.core.progress import stage
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.refinement.budget import with_budget
from gsfw.core.refinement.refiners import Refiners, checked_refiners
from gsfw.core.render_settings import RenderSettings, Validation
from gsfw.core.returns import checked_settings, untrained_notes
from gsfw.core.sampler import Sampler
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.core.table import SplatTable
from gsfw.core.team import Team
from gsfw.core.temporal_metrics.over_time import TIME_PROTOCOL
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.data_fit import check_data, check_rasterizer
from gsfw.plugins.devices import find_device, unused_gpu
from gsfw.plugins.initial_splats import check_initial, read_initial
from gsfw.plugins.loading import check_built, choose_operators, make_metrics
from gsfw.plugins.memory_fit import MemoryFit
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import Registry, registered_as
from gsfw.plugins.settings import Settings
from gsfw.plugins.start import FoundPoints, find_points, start_of


@dataclass(frozen=True)
class Composition:
    """A run that is built, but not started."""

    settings: Settings
    parts: TrainingParts
    plan: TrainingPlan
    remarks: tuple[str, ...] = ()
    """Notes on the start; preferred rasterizers that cannot run, and the causes; the cause of an
    unused GPU."""
    found: FoundPoints | None = None
    """The points that it starts from, for other runs on the capture."""

    @property
    def scene(self) -> Scene:
        """The facts about the capture."""
        return self.parts.data.scene

    def protocol(self, split: Split = Split.EVAL) -> dict[str, Any]:
        """Measurement protocol of the figures of this run."""
        config = self.settings.config
        views = self.parts.data.views(split)
        sizes = sorted({(camera.width, camera.height) for camera in views.cameras})
        background = self.plan.settings.background
        assert background is not None
        return {
            "split": split.value,
            "held_out": self.parts.data.views(Split.EVAL).origin,
            "views": len(views),
            "image_sizes": [list(size) for size in sizes],
            "downscale": config.downscale,
            "downscale_filter": "area",
            "background": background.tolist(),
            "numerics": config.profile,
            "psnr": "per image on values clamped to [0, 1], then the mean",
            "ssim": "11x11 Gaussian window, sigma 1.5, zero padding",
            "color_corrected_psnr": "as psnr, after a least-squares affine map of each image's "
            "rendered colours to its photo's",
            "checkpoint": "last",
            **(TIME_PROTOCOL if self.scene.is_dynamic else {}),
            **self.parts.corrections.protocol(),
            **(PROTOCOL if self.parts.distractors is not None else {}),
        }

    def shared_by(self, team: Team) -> Composition:
        """The same run for a team of processes.

        Raises:
            ConfigError: a part does not work with several processes.
        """
        team.check(self.parts)
        return replace(self, parts=team.share(self.parts))

    @cached_property
    def resolution(self) -> ResolutionSchedule:
        """Schedule of training image sizes; decodes some images, so only training reads it."""
        config, background = self.settings.config, self.plan.settings.background
        if config.resolution_schedule != AUTO:
            return FULL_SIZE
        assert background is not None
        return measured(self.parts.data, background, config.resolution_steps)

    def notes(self) -> tuple[str, ...]:
        """Notes for the user before training starts."""
        config = self.settings.config
        notes = (
            *self.settings.notes,
            *self.parts.data.notes(),
            *self.parts.method.notes(self.scene),
            *self.remarks,
        )
        if config.resolution_schedule == AUTO:
            notes += (self.resolution.note(config.resolution_steps),)
        if config.random_background and not self.scene.has_alpha:
            notes += ("random_background=true changes nothing: the images have no alpha.",)
        return notes

    def trainer(
        self,
        folder: RunFolder,
        callbacks: Sequence[Callback] = (),
        first_step: int = 0,
        timekeeper: Timekeeper | None = None,
    ) -> Trainer:
        """Build the training loop of these parts, before its first step.

        Args:
            folder: of the run.
            callbacks: watch the run.
            first_step: 0, or the step from which the run goes on.
            timekeeper: keeps the run within its time; ``None`` for runs of a number of steps.
        """
        plan = replace(self.plan, resolution=self.resolution)
        info = self.info(folder.path, first_step)
        goal = None if timekeeper is None else self._goal()
        return Trainer(self.parts, plan, folder, info, callbacks, timekeeper, goal)

    def _goal(self) -> Goal | None:
        """The quality that ends the run; ``None`` if nothing but its time does."""
        until = self.settings.config.until
        return None if not until else Goal(None if until == AUTO else float(until))

    def info(self, folder: Path, first_step: int = 0) -> RunInfo:
        """The facts about the run in a folder; decodes some images."""
        return RunInfo(
            folder=folder,
            method=self.settings.method.name,
            scene=self.scene.name,
            steps=self.plan.steps,
            first_step=first_step,
            settings=self.settings.flat(),
            protocol=self.protocol(),
            notes=self.notes(),
            views=len(self.parts.data.views(Split.TRAIN)),
            step_costs=self.settings.config.step_costs(),
            image_stages=self.resolution.stages,
            view_pixels=self.parts.data.views(Split.TRAIN).pixels,
        )


def check(settings: Settings, registry: Registry) -> None:
    """Check, before any data is read, that the chosen parts fit together on this machine.

    Raises:
        ConfigError: a need is not met; names its component, and the installed rasterizers that fit.
    """
    config = settings.config
    config.check()
    device = find_device(settings.config.device)
    needs = {
        f"{slot} {settings.choices[slot].name!r}": part.needs()
        for slot, part in (
            ("strategy", config.strategy),
            ("datamanager", config.datamanager),
            ("sampler", config.sampler),
        )
        if part is not None
    }
    needs[f"method {settings.method.name!r}"] = config.needs()
    if config.strategy is not None and str(config.strategy.budget) != NO_BUDGET:
        needs["strategy.budget"] = Needs(features=frozenset({Feature.CONTRIBUTION}))
    check_rasterizer(settings, registry, needs, device)
    check_initial(config.init, registry)


def _missed(settings: Settings, registry: Registry, device: torch.device) -> tuple[str, ...]:
    """Explain for each preferred rasterizer on this device why it cannot run."""
    able = rasterizer_capabilities(registry)
    chosen = settings.choices["rasterizer"].name
    missed = tuple(
        f"rasterizer {name} is faster than {chosen}, but {other.unavailable}"
        for name, other in able.items()
        if other.unavailable
        and device.type in other.devices
        and other.preference > able[chosen].preference
    )
    if device.type == "cpu" and "device" not in settings.given:
        return (*missed, *unused_gpu(able))
    return missed


def compose(
    settings: Settings,
    registry: Registry,
    restoring: bool = False,
    data: DataManager | None = None,
    found: FoundPoints | None = None,
    initial: Splats | None = None,
) -> Composition:
    """Check and build a run.

    Args:
        settings: settings of the run.
        registry: the installed parts.
        restoring: true if a checkpoint follows, so that initial splats are not needed.
        data: replaces the data set of the settings; ``None`` opens that one.
        found: points of the capture, where they are known; others are found if they are needed.
        initial: splats of ``init=FILE`` in the scene frame, float32; ``None`` reads them.

    Raises:
        ConfigError: the parts, or the scene, do not fit together.
        DataError: the data set cannot be used.
        NotEnoughMemoryError: a training does not fit into the memory that there is.
    """
    if restoring and settings.config.init not in (AUTO, "points", "random"):
        settings = replace(settings, config=replace(settings.config, init=AUTO))
    check(settings, registry)
    device = find_device(settings.config.device)
    method = settings.config.build()
    check_built("method", settings.method, method, Method)
    method.registered_as = registered_as(settings.method)
    data = open_data(settings) if data is None else data
    check_built("datamanager", settings.choices["datamanager"], data, DataManager)
    check_data(settings, registry, data, method)
    corrections = make_corrections(settings.config, data).to(device)
    data = data if corrections.poses is None else RefinedCapture(data, corrections.poses)
    found = FoundPoints() if restoring else find_points(settings, registry, data, found)
    start = start_of(settings, data.scene, found)
    fit = MemoryFit(settings, data, device, is_new=not restoring and initial is None)
    with stage("building the model"):
        if initial is None:
            initial = read_initial(settings.config.init, registry, start.scene)
        fit.check_start(method, start.scene, initial)
        begun = (start.scene, initial)
        parts = _parts(settings, registry, method, data, begun, corrections, device)
    fit.check_model(parts.model)
    _check_parts(settings, parts)
    remarks = (*start.notes, *fit.notes(), *_missed(settings, registry, device))
    plan = training_plan(settings, data.scene, device)
    plan = replace(plan, settings=checked_settings(method, plan.settings, None))
    return Composition(settings, parts, plan, (*remarks, *untrained_notes(parts.model)), found)


def _check_parts(settings: Settings, parts: TrainingParts) -> None:
    """Check that the parts of third parties take the calls of gsfw."""
    for slot, kind in (("sampler", Sampler), ("rasterizer", Rasterizer)):
        check_built(slot, settings.choices[slot], getattr(parts, slot), kind)
    for refiner in parts.refiners:
        check_built("strategy", settings.choices["strategy"], refiner)
        check_built("method", settings.method, refiner)


def _parts(
    settings: Settings,
    registry: Registry,
    method: Method,
    data: DataManager,
    begun: tuple[Scene, Splats | None],
    corrections: CaptureCorrections,
    device: torch.device,
) -> TrainingParts:
    """Build the parts of a training loop that starts from a scene, and splats if there are any."""
    config, (scene, initial) = settings.config, begun
    operators = choose_operators(registry, device)
    seeded = torch.Generator().manual_seed(config.seed)
    model = method.build_model(scene, operators, seeded, initial)
    check_built("method", settings.method, model, PrimitiveModel)
    model = model.to(device)
    method.begin(scene, data.views(Split.TRAIN), model)
    model.eval()  # Steps alone are in training mode.
    check_rows(model)
    groups = corrections.parameter_groups()
    optimizer = Optimizer(model, operators, config.optim.settings(config.steps), groups)
    assert isinstance(config.sampler, SamplerConfig)
    assert isinstance(config.rasterizer, RasterizerConfig)
    return TrainingParts(
        method=method,
        model=model,
        optimizer=optimizer,
        table=SplatTable(model, optimizer),
        refiners=make_refiners(config, method, scene, model),
        sampler=config.sampler.build(data.views(Split.TRAIN), config.seed, config.steps),
        data=data,
        rasterizer=config.rasterizer.build(device),
        operators=operators,
        metrics=make_metrics(registry, operators),
        generator=torch.Generator(device=device).manual_seed(config.seed + 1),
        device=device,
        corrections=corrections,
        distractors=Distractors(config.distractors_start) if config.ignore_distractors else None,
    )


def make_refiners(
    config: MethodConfig, method: Method, scene: Scene, model: PrimitiveModel
) -> Refiners:
    """Build all refiners, in order: the budget, the strategy, the method.

    Raises:
        ConfigError: the model cannot be densified, or settings are out of range.
    """
    strategy = config.strategy
    assert isinstance(strategy, StrategyConfig)
    if strategy.needs().densifiable and not isinstance(model, DensifiableModel):
        raise ConfigError(
            f"the strategy splits, clones or relocates rows, and {type(model).__name__} is no "
            "DensifiableModel: it does not say how.",
            "Use strategy=none, or let the model derive from gsfw.api.DensifiableModel.",
        )
    source = f"{method.registered_as or type(method).__name__}: refiners"
    own = checked_refiners(source, method.refiners(scene, model))
    return Refiners([*with_budget(strategy, scene), *own])


def check_rows(model: PrimitiveModel) -> None:
    """Check that all columns of a model have a row for each splat.

    Raises:
        ConfigError: one has another number of rows than the first.
    """
    columns = model.columns()
    first = next(iter(columns), "")
    for name, column in columns.items():
        if column.num_rows != model.num_rows:
            raise ConfigError(
                f"column {name!r} of {type(model).__name__} has {column.num_rows} rows, expected "
                f"{model.num_rows} as {first!r} has.",
                "Give every column one row for each splat: extra_columns(scene, count) returns "
                "columns of count rows.",
            )


def make_corrections(config: MethodConfig, data: DataManager) -> CaptureCorrections:
    """Build the trained corrections of the capture, before the first step."""
    names, optim = data.views(Split.TRAIN).names, config.optim
    return CaptureCorrections(
        Exposures(names, optim.exposure_rate()) if config.exposure else None,
        PoseRefinement(data, optim.poses_rate()) if config.refine_poses else None,
    )


def training_plan(settings: Settings, scene: Scene, device: torch.device) -> TrainingPlan:
    """Length and schedule of a run."""
    config = settings.config
    background = parse_background(config.background, scene.has_alpha)
    return TrainingPlan(
        steps=config.steps,
        log_every=config.log_every,
        eval_every=config.eval_every,
        eval_views=config.eval_views,
        checkpoint_every=config.checkpoint_every,
        settings=RenderSettings(
            background=torch.tensor(background, device=device),
            antialias=config.antialias,
            validation=Validation(config.validation),
            profile=PROFILES[config.profile],
        ),
        random_background=config.random_background and scene.has_alpha,
        max_skipped=config.max_skipped,
        records_steps=config.graph == "auto",
        pace=config.pace,
        checks_memory=config.check_memory,
        held_back=config.held_back,
    )
