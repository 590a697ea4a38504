"""Trajectory: pose of every row at the finished times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from gsfw.core.column import Column, Layout, Rows
from gsfw.core.maths.rotations import from_integers, same_half, to_integers


@dataclass(frozen=True)
class Pose:
    """The parameters of every row that change with time."""

    means: Float[Tensor, "n 3"]
    quats: Float[Tensor, "n 4"]
    """Quaternions of any norm; unit if they were stored."""
    colors: Float[Tensor, "n 1 3"] | None
    """Constant SH coefficients; ``None`` when they do not change."""


class Trajectory(nn.Module):
    """The finished times in compact stacks, and the current time.

    20 bytes for each row and time: positions in float32, quaternions in 16-bit integers; 6 more
    if colours change, in float16 (the released code of Luiten et al. has 40).
    """

    times: Tensor

    def __init__(self, pose: Pose) -> None:
        """Start without a finished time; ``pose`` has the rows and the changing parameters."""
        super().__init__()
        self._times: list[float] = []
        self.register_buffer("times", torch.zeros(0, dtype=torch.float64))
        stacks = {
            name: Column(values[None, :][:0], layout=Layout.STACKED)
            for name, values in _stored(pose).items()
        }
        self.stacks = nn.ModuleDict(stacks)

    def columns(self) -> Mapping[str, Column]:
        """The stacks as columns, for edits of rows; no optimizer changes them."""
        return {name: self._stack(name) for name in self.stacks}

    def _stack(self, name: str) -> Column:
        column = self.stacks[name]
        assert isinstance(column, Column)
        return column

    @property
    def current(self) -> float | None:
        """The current time; ``None`` before the first."""
        return self._times[-1] if self._times else None

    @property
    def num_finished(self) -> int:
        """Number of stored times."""
        return max(len(self._times) - 1, 0)

    def begin(self, time: float) -> None:
        """Make ``time`` the current one; it follows the earlier ones."""
        self._set_times([*self._times, time])

    def _set_times(self, times: list[float]) -> None:
        self._times = times
        self.times = torch.tensor(times, dtype=torch.float64, device=self.times.device)

    def num_bytes(self) -> int:
        """Bytes of the stacks."""
        return sum(column.values.nbytes for column in self.columns().values())

    @torch.no_grad()
    def store(self, pose: Pose) -> None:
        """Finish the current time with its final pose."""
        for name, values in _stored(pose).items():
            stack = self._stack(name)
            stack.assign(Rows(torch.cat([stack.values, values[None].to(stack.values)])))

    def stored(self, index: int | Int[Tensor, ""], like: Tensor) -> Pose:
        """The pose of a finished time, in the type of ``like``."""
        columns = self.columns()
        chosen = {name: _at(column.values, index) for name, column in columns.items()}
        colors = chosen.get("past_colors")
        return Pose(
            chosen["past_means"].to(like),
            from_integers(chosen["past_quats"], like),
            None if colors is None else colors.to(like),
        )

    def at_rest(self, pose: Pose) -> dict[str, Rows]:
        """Rows for the stacks with the constant pose ``pose``."""
        count = self.num_finished
        return {
            name: Rows(values[None].repeat(count, *[1] * values.dim()))
            for name, values in _stored(pose).items()
        }

    def at(self, time: Float[Tensor, ""], current: Pose) -> Pose:
        """The pose at ``time``, between the two times beside it; differentiable in ``current``.

        Times before the first and after the current one are clamped. Quaternions are interpolated
        linearly, on the same great circle as slerp; colours linearly. The host does not wait for
        ``time``.
        """
        last = len(self._times) - 1
        if last < 1:
            return current
        after = torch.searchsorted(self.times, time.to(self.times)).clamp(1, last)
        # Not times[after]: torch would read the single index.
        first, second = self.times.index_select(0, torch.stack([after - 1, after])).unbind(0)
        share = ((time.to(self.times) - first) / (second - first)).clamp(0.0, 1.0)
        start = self.stored(after - 1, current.means)
        end = _chosen(after == last, current, self.stored(after.clamp(max=last - 1), current.means))
        share = share.to(current.means)
        colors = None
        if start.colors is not None and end.colors is not None:
            colors = torch.lerp(start.colors, end.colors, share)
        return Pose(
            torch.lerp(start.means, end.means, share),
            torch.lerp(same_half(start.quats, end.quats), end.quats, share),
            colors,
        )

    def _load_from_state_dict(
        self,
        state_dict: Mapping[str, Any],
        prefix: str,
        *args: Any,  # noqa: ANN401
    ) -> None:
        """Accept any number of times: a checkpoint keeps its own."""
        times = state_dict.get(prefix + "times")
        if times is not None:
            self._set_times(times.tolist())
        super()._load_from_state_dict(state_dict, prefix, *args)


def _stored(pose: Pose) -> dict[str, Tensor]:
    """The stored form of a pose, by column name."""
    values = {
        "past_means": pose.means.detach().float(),
        "past_quats": to_integers(pose.quats.detach()),
    }
    if pose.colors is not None:
        values["past_colors"] = pose.colors.detach().half()
    return values


def _at(stack: Tensor, index: int | Tensor) -> Tensor:
    return stack[index] if isinstance(index, int) else stack.index_select(0, index[None])[0]


def _chosen(first: Tensor, one: Pose, other: Pose) -> Pose:
    """``one`` where ``first`` is true, else ``other``."""
    colors = None
    if one.colors is not None and other.colors is not None:
        colors = torch.where(first, one.colors, other.colors)
    return Pose(
        torch.where(first, one.means, other.means),
        torch.where(first, one.quats, other.quats),
        colors,
    )
