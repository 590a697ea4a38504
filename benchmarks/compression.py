"""Bytes for each Gaussian against the PSNR that a file of a run loses, format by format.

    OMP_NUM_THREADS=1 python benchmarks/compression.py RUN

prints a table of docs/results/compression.md: every format that holds the model and can be read
back, and compressed model files whose steps are searched for losses of 0.1, 0.3 and 0.5 dB on the
run's held-out views.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.core.datamanager import Split
from gsfw.core.errors import UserError
from gsfw.formats.model_file import ModelFileExporter
from gsfw.plugins.registry import installed
from gsfw.studies.tradeoff.file_round_trip import FileRoundTrip, round_trips
from gsfw.studies.tradeoff.finished_model import FinishedModel
from gsfw.studies.tradeoff.subject import Subject

LOSSES = (0.1, 0.3, 0.5)
"""In dB, for which steps are searched."""
TURNS = 8
"""Halvings of the range of steps: the last is within 2 % of the next."""
LEAST, LARGEST = 0.1, 20.0
"""Range of steps."""
VIEWS = 16


@dataclass(frozen=True)
class Row:
    """A row of the table."""

    name: str
    num_bytes: int
    lost: float
    """In dB; negative for a gain."""
    seconds: float
    """To write the file."""


@dataclass(frozen=True)
class Bench:
    """A run, and what its unchanged model reaches."""

    model: FinishedModel
    usual: float
    """PSNR of the held-out views in dB."""

    @staticmethod
    def of(run: str) -> Bench:
        """Restore a run."""
        found, registry = find_run(run, print), installed()
        restored = restore_run(found, registry)
        model = FinishedModel(restored, registry, run, VIEWS, found.model_file is not None)
        return Bench(model, psnr(model, model.subject))

    def row(self, trip: FileRoundTrip, name: str = "") -> Row:
        """Write, read and render a format of gsfw."""
        subject = self.model.subject
        start = time.perf_counter()
        num_bytes = trip.size(subject)
        seconds = time.perf_counter() - start
        lost = self.usual - psnr(self.model, trip.read_back(subject))
        return Row(name or trip.name, num_bytes, lost, seconds)

    def compressed(self, step: float) -> FileRoundTrip:
        """Compressed model files with a factor of steps."""
        options = {"precision": "compressed", "step": step}
        return FileRoundTrip("gsfw", ModelFileExporter(**options), options, self.model)

    def for_loss(self, loss: float) -> Row:
        """The smallest compressed file that loses at most so many dB."""
        low, high = math.log(LEAST), math.log(LARGEST)
        for _ in range(TURNS):
            middle = (low + high) / 2
            within = self.row(self.compressed(math.exp(middle))).lost <= loss
            low, high = (middle, high) if within else (low, middle)
        step = math.exp(low)
        return self.row(self.compressed(step), f"gsfw compressed, step {step:.2f}")


def psnr(model: FinishedModel, subject: Subject) -> float:
    """Mean PSNR of the held-out views in dB, under the run's own protocol."""
    metric, values = model.parts.metrics["psnr"], []
    for view, camera in zip(model.views, model.cameras, strict=True):
        (batch,) = model.parts.data.load(Split.EVAL, [view], model.device)
        background = subject.settings.background
        assert background is not None
        valid = None if batch.valid is None else batch.valid[0]
        (splats,) = subject.splats_by_camera([camera])
        image = subject.image(splats, camera)
        values.append(metric(image, batch.target(background)[0], valid))
    return sum(values) / len(values)


def rows(bench: Bench) -> Iterator[Row]:
    """All rows of the table."""
    for trip in round_trips(bench.model):
        with suppress(UserError, ValueError):  # No importer reads some formats.
            yield bench.row(trip)
    yield from (bench.for_loss(loss) for loss in LOSSES)


def table(run: str) -> Iterator[str]:
    """Lines of the table of a run."""
    bench = Bench.of(run)
    count = bench.model.subject.num_gaussians()
    yield f"{count:,} Gaussians, {bench.usual:.2f} dB\n"
    yield "| file | bytes | bytes per Gaussian | lost (dB) | seconds to write |"
    yield "| --- | ---: | ---: | ---: | ---: |"
    for row in rows(bench):
        sizes = f"{row.num_bytes:,} | {row.num_bytes / count:.2f}"
        yield f"| {row.name} | {sizes} | {row.lost:.3f} | {row.seconds:.1f} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run")
    for line in table(parser.parse_args().run):
        print(line, flush=True)  # noqa: T201
