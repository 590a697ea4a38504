"""Optimizer: Adam over columns and parameter groups, each at its own learning rate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from gsfw.core.column import Column, Layout
from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import Cooldown, LearningRate
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate, Operators
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.returns import checked_groups


@dataclass(frozen=True)
class OptimizerSettings:
    """Constants of Adam, and the treatment of rows that no view of a step has seen."""

    adam: AdamSettings = AdamSettings()  # noqa: RUF009 - frozen
    sparse: bool = False
    """False: plain Adam, in which unseen rows still move by their momentum.
    True: such rows and their moments do not change at all (dense columns only)."""
    rate_factor: float = 1.0
    """Factor of all learning rates."""
    cooldown: Cooldown = Cooldown()  # noqa: RUF009 - frozen
    """Another factor of all learning rates, at the end of the run."""

    @staticmethod
    def scaled(factor: float, sparse: bool = False) -> OptimizerSettings:
        """Settings for steps of ``factor`` times more views than the rates are made for.

        Rates grow with the root of the factor, and the decay rates of the moments are raised to its
        power (Malladi et al. 2022 for Adam; Zhao et al. 2024, Grendel-GS, for splats).
        """
        usual = AdamSettings()
        adam = replace(usual, beta1=usual.beta1**factor, beta2=usual.beta2**factor)
        return OptimizerSettings(adam, sparse, math.sqrt(factor))


class Optimizer:
    """Adam over a model's columns and parameter groups.

    Bands above the active SH degree have never had a gradient, so skipping them changes nothing.
    """

    def __init__(
        self,
        model: PrimitiveModel,
        operators: Operators,
        settings: OptimizerSettings,
        others: Sequence[ParameterGroup] = (),
    ) -> None:
        """Start with fresh moments.

        Args:
            model: its columns and groups are optimized.
            operators: operators of the run's device.
            settings: constants of Adam, and the treatment of unseen rows.
            others: further groups that are not the model's (corrections of the capture).

        Raises:
            ConfigError: the model's groups have a wrong form.
        """
        checked_groups(f"{type(model).__name__}.parameter_groups", model)
        self._model = model
        self._others = tuple(others)
        self._operators = operators
        self.settings = settings
        self._frozen: set[str] = set()
        # Made when they are first needed: a run that only renders has none, and a process that
        # trains a part of the rows has those of its part.
        self._moments: dict[str, list[AdamMoments]] = {}

    @property
    def sparse(self) -> bool:
        """True if only rows that a view of the step has seen are updated."""
        return self.settings.sparse

    def _tensors(self) -> dict[str, list[Tensor]]:
        columns: dict[str, list[Tensor]] = {
            name: [column.values]
            for name, column in self._model.columns().items()
            if column.trained
        }
        groups: dict[str, list[Tensor]] = {
            group.name: [*group.parameters] for group in self._groups()
        }
        return columns | groups

    def _groups(self) -> tuple[ParameterGroup, ...]:
        return (*self._model.parameter_groups(), *self._others)

    def schedules(self) -> dict[str, LearningRate]:
        """Course of the learning rate of every column and group, before factors of all."""
        return {
            name: column.learning_rate
            for name, column in self._model.columns().items()
            if column.learning_rate is not None
        } | {group.name: group.learning_rate for group in self._groups()}

    def learning_rates(self, step: int) -> dict[str, float]:
        """Learning rate of every column and group at ``step``; 0 if frozen."""
        factor = self.settings.rate_factor * self.settings.cooldown.factor(step)
        return {
            name: 0.0 if name in self._frozen else factor * rate.at(step)
            for name, rate in self.schedules().items()
        }

    def tensors(self) -> list[Tensor]:
        """All optimized tensors, in the same order in every step."""
        return [tensor for group in self._tensors().values() for tensor in group]

    def places(self) -> tuple[object, ...]:
        """A value that differs once columns or moments have other memory, or others are stepped."""
        columns, groups = self._model.columns(), self._groups()
        names = [name for name, column in columns.items() if column.trained]
        names += [group.name for group in groups]
        moments = [state for name in names for state in self.moments(name)]
        held = [column.values for column in columns.values()]
        held += [column.offsets for column in columns.values() if column.offsets is not None]
        held += [tensor for group in groups for tensor in group.parameters]
        held += [part for state in moments for part in (state.first, state.second, state.count)]
        places = tuple((tensor.data_ptr(), tensor.numel()) for tensor in held)
        return places, tuple(sorted(self._frozen)), self._model.active_bands()

    def group_tensors(self) -> list[Tensor]:
        """The optimized tensors that belong to no row, in the same order in every step."""
        return [tensor for group in self._groups() for tensor in group.parameters]

    def gradients(self) -> list[Tensor]:
        """All current gradients."""
        return [tensor.grad for tensor in self.tensors() if tensor.grad is not None]

    def zero_gradients(self) -> None:
        """Delete all gradients."""
        for tensor in self.tensors():
            tensor.grad = None

    @torch.no_grad()
    def step(
        self,
        step: int,
        finite: Bool[Tensor, ""],
        visible: Bool[Tensor, " n"] | None = None,
        device_rates: Float64[Tensor, " g"] | None = None,
    ) -> None:
        """Update every parameter that has a gradient.

        Args:
            step: counted from 0; sets the learning rates.
            finite: when false, nothing changes.
            visible: rows that some view of this step saw; used when ``sparse`` is set.
            device_rates: rates to read on the device in place of those of ``step``, in the order
                of ``learning_rates``; for a step that is recorded and repeated.
        """
        rates: Mapping[str, float | Tensor] = self.learning_rates(step)
        if device_rates is not None:
            rates = dict(zip(rates, device_rates.unbind(), strict=True))
        # The host waits here for a GPU's count of these rows, in every step: the cost of sparse.
        rows = visible.nonzero()[:, 0] if self.settings.sparse and visible is not None else None
        updates: list[AdamUpdate] = []
        for name, column in self._model.columns().items():
            if column.trained and name not in self._frozen:
                moments = self.moments(name)[0]
                updates += self._column_updates(column, moments, rates[name], finite, rows)
        for group in self._groups():
            if group.name not in self._frozen:
                updates += self._group_updates(group, rates[group.name], finite)
        self._operators.adam_(updates, self.settings.adam, finite)

    def _column_updates(
        self,
        column: Column,
        moments: AdamMoments,
        rate: float | Tensor,
        finite: Tensor,
        rows: Tensor | None,
    ) -> list[AdamUpdate]:
        """The update of a column, or none."""
        values, gradient = column.values, column.values.grad
        bands = self._model.active_bands() if column.bands else None
        if bands == 0:  # Plain Adam would have counted a step with a gradient of zero.
            moments.count += finite
            return []
        if gradient is None:
            return []
        if column.layout is not Layout.DENSE:
            return [AdamUpdate(values, gradient, moments, rate)]
        if bands is not None and bands < values.shape[1]:
            values, gradient = values[:, :bands], gradient[:, :bands]
            moments = AdamMoments(
                moments.first[:, :bands], moments.second[:, :bands], moments.count
            )
        return [AdamUpdate(values, gradient, moments, rate, rows)]

    def _group_updates(
        self, group: ParameterGroup, rate: float | Tensor, finite: Tensor
    ) -> list[AdamUpdate]:
        """The updates of the tensors of a group that have a gradient; applies weight decay."""
        updates = []
        for tensor, moments in zip(group.parameters, self.moments(group.name), strict=True):
            if tensor.grad is None:
                continue
            if group.weight_decay:
                decay = rate * group.weight_decay
                if isinstance(decay, Tensor):  # It rounds as a number of the host does.
                    decay = decay.to(tensor.dtype)
                tensor.mul_(1.0 - finite.to(tensor.dtype) * decay)
            updates.append(AdamUpdate(tensor, tensor.grad, moments, rate))
        return updates

    def moments(self, name: str) -> list[AdamMoments]:
        """Adam's stored state of a column or group; zeros before its first step."""
        if name not in self._moments:
            tensors = self._tensors()[name]
            self._moments[name] = [AdamMoments.zeros_like(tensor) for tensor in tensors]
        return self._moments[name]

    def replace_moments(self, name: str, moments: list[AdamMoments]) -> None:
        """Replace Adam's state after rows were edited; for ``SplatTable``."""
        self._moments[name] = moments

    def num_bytes(self) -> int:
        """Bytes of the moments of all columns and groups, two for each number."""
        return sum(2 * tensor.nbytes for tensor in self.tensors())

    def reset(self, names: Iterable[str]) -> None:
        """Start these columns or groups with fresh moments and step counts.

        Raises:
            ConfigError: there is no such column or group.
        """
        for name in self._known(names):
            self._moments.pop(name, None)

    def freeze(self, names: Iterable[str]) -> None:
        """Stop the optimization of these columns or groups.

        Raises:
            ConfigError: there is no such column or group.
        """
        self._frozen.update(self._known(names))

    def _known(self, names: Iterable[str]) -> list[str]:
        """The same names, which have to be those of columns or groups."""
        known = [*self._model.columns(), *(group.name for group in self._groups())]
        names = [names] if isinstance(names, str) else list(names)
        for name in names:
            if name not in known:
                raise ConfigError(
                    f"the optimizer was asked to freeze or reset {name!r}, which is no column and "
                    "no parameter group of the model.",
                    f"There are {', '.join(known)}.",
                )
        return names

    def state_dict(self) -> dict[str, Any]:
        """Tensors and plain data."""
        moments = {
            name: [
                {"first": m.first, "second": m.second, "count": m.count} for m in self.moments(name)
            ]
            for name in self._tensors()
        }
        return {"moments": moments, "frozen": sorted(self._frozen)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``; the model must have been loaded first."""
        tensors = self._tensors()
        self._frozen = set(state["frozen"])
        self._moments = {
            name: [
                AdamMoments(
                    saved["first"].to(tensor).clone(),
                    saved["second"].to(tensor).clone(),
                    saved["count"].to(tensor.device).clone(),
                )
                for saved, tensor in zip(state["moments"][name], group, strict=True)
            ]
            for name, group in tensors.items()
        }
