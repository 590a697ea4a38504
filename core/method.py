"""Method: a model and its training."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Mapping
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.context import StepContext, ViewContext
from gsfw.core.datamanager import Views
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.refiner import Refiner
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats


class Method(ABC):
    """A model and its training: losses, phases, and requirements on the scene.

    ``build_model`` and ``losses`` are required. The order of calls in a run: ``check_scene``,
    ``build_model``, ``begin``, ``refiners``, ``notes``; in each step ``prepare`` and
    ``render_settings``, and for each batch ``losses``; ``step_metrics`` after logged steps,
    ``view_metrics`` and ``view_images`` in evaluations; ``report`` at the end.
    """

    registered_as: str = ""
    """Its registered name and package in messages: "method 'mine' (gsfw-mine 0.1)"."""

    def check_scene(self, scene: Scene) -> None:  # noqa: B027
        """Refuse a scene that this method cannot train on.

        Raises:
            ConfigError: the scene lacks data that the method needs; names the data and the remedy.
        """

    def notes(self, scene: Scene) -> tuple[str, ...]:
        """Notes for the user before training, such as the cost of random initialisation."""
        return ()

    @abstractmethod
    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> PrimitiveModel:
        """The model before its first step, on the CPU.

        Args:
            scene: the facts about the capture.
            operators: for nearest neighbours.
            generator: on the CPU; the only source of randomness.
            initial: splats to start from (``init=FILE``), in the scene frame; ``None`` otherwise.
        """

    def begin(  # noqa: B027
        self, scene: Scene, views: Views, model: PrimitiveModel
    ) -> None:
        """Receive the training views, once, before the first step or after a resume.

        Args:
            scene: the capture.
            views: names, cameras (with intrinsics), times and maps of the training views, in the
                order in which ``Batch.views`` counts them.
            model: as built; a resumed state is not loaded yet. May get further columns here: the
                optimizer is made afterwards.

        Raises:
            ConfigError: the views have no data that this method needs; names it.
        """

    def refiners(self, scene: Scene, model: PrimitiveModel) -> tuple[Refiner, ...]:
        """The method's own refiners; they edit rows after those of the strategy."""
        return ()

    def render_settings(self, settings: RenderSettings, step: int | None) -> RenderSettings:
        """The settings to render with at a step.

        Args:
            settings: settings of the run.
            step: counted from 0; ``None`` for evaluation and rendering of the finished model.
        """
        return settings

    @abstractmethod
    def losses(self, context: StepContext) -> Mapping[str, Tensor]:
        """Weighted scalars whose sum is minimised, by name."""

    def prepare(  # noqa: B027
        self, step: int, model: PrimitiveModel, optimizer: Optimizer, time: float | None
    ) -> None:
        """Run before each step: SH degree, phase changes, freezing, forward initialisation.

        Args:
            step: counted from 0.
            model: may change its values, not its rows.
            optimizer: freezes parameters, or resets their moments.
            time: time of the step's first view, in [0, 1]; ``None`` for a static capture.
        """

    def graph_key(self, step: int) -> Hashable | None:
        """The state that a step depends on besides its batch, its background and the parameters.

        Steps with equal keys launch the same work: on a GPU it is then recorded once and repeated,
        which saves most of the host's time. Called after ``prepare``. A key promises that the
        method and its model read nothing else that changes (numbers of steps, own random numbers,
        learning rates that ``prepare`` replaces), and neither wait for the GPU nor move anything to
        it. ``prepare`` may do both, and write what changes to a tensor that stays. The key does not
        hold for a derived class that has other ``losses``, ``render_settings``, ``prepare`` or
        ``build_model``.

        Args:
            step: counted from 0.

        Returns:
            The key; ``None`` if steps have to be run one by one.
        """
        return None

    def step_metrics(self, context: StepContext) -> Mapping[str, float]:
        """The method's own figures of a logged step that are no loss, by name.

        Such as the weight of a term, or the mean of a column. Called after the step, without
        gradients, and only in the process that leads; nothing may be changed.

        Args:
            context: the first batch of the step, rendered before the update.
        """
        return {}

    def view_metrics(self, context: ViewContext) -> Mapping[str, float]:
        """The method's own metrics of one held-out view, by name, such as a depth error."""
        return {}

    def view_images(self, context: ViewContext) -> Mapping[str, Float[Tensor, "h w 3"]]:
        """The method's own images of a view in [0, 1], by name; reports show them, too."""
        return {}

    def report(self) -> Mapping[str, Any]:
        """Results of the finished run for ``requirements.json``, as plain data."""
        return {}

    def state_dict(self) -> dict[str, Any]:
        """Tensors and plain data; the state of ``prepare`` besides the step."""
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:  # noqa: B027
        """Continue from ``state``."""
