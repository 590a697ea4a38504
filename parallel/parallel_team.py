"""Parallel team: agreement of the processes of a group, whatever they divide."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import torch

from gsfw.core.errors import ConfigError, TrainingError
from gsfw.core.loop.determinism import differences, environment
from gsfw.core.loop.training_parts import TrainingParts
from gsfw.core.model import PrimitiveModel
from gsfw.core.refiner import Refiner
from gsfw.core.table import SplatTable
from gsfw.core.team import Team, Value
from gsfw.parallel.environment import leave
from gsfw.parallel.group import Group


class ParallelTeam(Team):
    """The processes of a group, each of which renders views or images in part."""

    splits_views = True

    def __init__(self, group: Group) -> None:
        """Start the first step of the processes of a group."""
        self._group = group
        self.size, self.rank = group.size, group.rank

    def check(self, parts: TrainingParts) -> None:
        """Refuse refiners that watch the graph of each view, and machines that are not alike."""
        for refiner in parts.refiners:
            if type(refiner).before_backward is not Refiner.before_backward:
                raise ConfigError(
                    f"processes={self.size}: {type(refiner).__name__} ({refiner.name}) watches the "
                    "backward pass of every view, and the processes divide views or images.",
                    "Train with processes=0 shards=0, or without this part (strategy=adc, "
                    "strategy=mcmc, sh=uniform, static=none).",
                )
        here = environment(parts.device, parts.rasterizer.capabilities().details)
        for rank, (there, model) in enumerate(self.gathered((here, _digest(parts.model)))):
            unlike = differences(there, here)
            if unlike or model != _digest(parts.model):
                raise ConfigError(
                    f"process {rank} computes other bits than process {self.rank}: "
                    f"{'; '.join(unlike) or 'its model differs at the start'}.",
                    "Train on machines of one kind, with as many threads in each process.",
                )

    def stops(self, wanted: bool, table: SplatTable, generator: torch.Generator) -> bool:
        """True if any process wants to stop; checks that rows and random numbers agree."""
        drawn = int(generator.get_state().long().sum())
        state = torch.tensor([wanted, len(table), table.row_edits, drawn], dtype=torch.int64)
        found = self._group.all_gather(state.to(self._group.device)).cpu()
        if not torch.equal(found[:, 1:], found[:1, 1:].expand(self.size, 3)):
            if not self.leads:
                leave()
            rows = ", ".join(str(count) for count in found[:, 1].tolist())
            raise TrainingError(
                f"the processes disagree on the rows of the model ({rows}): a refiner has decided "
                "by something that only one of them has.",
                "Train with processes=0, or without the strategy or method of a plugin.",
            )
        return bool(found[:, 0].any())

    def gathered(self, value: Value) -> list[Value]:
        """A value of each process."""
        return self._group.gathered(value)

    def summary(self) -> Mapping[str, int]:
        """Number of processes, and the bytes that this one has sent to others."""
        return {"processes": self.size, "bytes_sent": self._group.bytes_sent}


def _digest(model: PrimitiveModel) -> str:
    """A fingerprint of the bits of a model."""
    found = hashlib.sha256()
    for tensor in model.state_dict().values():
        found.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return found.hexdigest()
