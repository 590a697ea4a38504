"""A run whose steps are recorded on a tape, on the emulation of the CUDA kernels."""

import torch

from gsfw.core.loop.update import Update
from gsfw.kernels.cuda.operators import CudaOperators
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer
from support.composed_runs import composed, trainer_drawn_by
from support.tape import TapeLauncher, TapeRecorder

SETTINGS = {
    **{"steps": "40", "strategy": "adc"},
    **{"sh_degree": "1", "sh_degree_interval": "4", "log_every": "1000", "max_skipped": "1000"},
}
BUILT_IN = {
    **{"datamanager.views": "5", "datamanager.eval_views": "1", "datamanager.points": "60"},
    **{"datamanager.width": "40", "datamanager.height": "32"},
}


class Run:
    """A run whose images, losses and steps come from the CUDA kernels, on the emulation."""

    def __init__(self, folder, recorded: bool, **settings: str) -> None:
        given = SETTINGS | ({} if "data" in settings else BUILT_IN) | settings
        launcher, composition = TapeLauncher(), composed(given)
        operators = CudaOperators(launcher)
        for (
            module
        ) in composition.parts.model.modules():  # Made for the CPU, whose kernels are not recorded.
            if hasattr(module, "_operators"):
                module._operators = operators
        self.rasterizer = CudaRasterizer(launcher)
        self.trainer = trainer_drawn_by(folder, composition, self.rasterizer, operators)
        self.parts, self.optimizer = self.trainer.parts, self.trainer.parts.optimizer
        self.recorder = TapeRecorder(launcher, self.state)
        if recorded:
            self.trainer.updates = Update(self.parts, self.trainer._stopwatch, self.recorder)

    def state(self) -> list[torch.Tensor]:
        """All that a step changes."""
        updates, optimizer = self.trainer.updates, self.optimizer
        moments = [part for name in optimizer._moments for part in optimizer.moments(name)]
        held = [tensor for part in moments for tensor in (part.first, part.second, part.count)]
        held += [updates._skipped, updates._skipped_in_a_row, updates._graphs._misfits]
        columns = self.parts.model.columns().values()
        held += [column.values for column in columns if not column.trained]
        return [*self.optimizer.tensors(), *held, self.rasterizer._backend.rooms._needed]

    def steps(self, count: int) -> list[float]:
        """Do some steps; the loss of each."""
        losses = []
        for _ in range(count):
            rendered = self.trainer.updates.run
            found = []

            def run(*args, rendered=rendered, found=found):
                found.extend(rendered(*args))
                return found

            self.trainer.updates.run = run
            self.trainer._one_step()
            del self.trainer.updates.run
            losses.append(sum(float(value.detach()) for value in found[0].losses.values()))
        return losses

    def columns(self) -> dict[str, torch.Tensor]:
        return {name: c.values.detach() for name, c in self.parts.model.columns().items()}

    def corrections(self) -> dict[str, torch.Tensor]:
        found = self.parts.corrections.named_parameters()
        return {name: values.detach() for name, values in found}
