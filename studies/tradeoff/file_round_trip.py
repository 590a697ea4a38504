"""FileRoundTrip: a model written to a file and read back."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from gsfw.core.errors import DataError
from gsfw.core.exchange import Exporter, Holds
from gsfw.core.maths.frame import transform_splats
from gsfw.core.scene import Scene
from gsfw.core.splats import Sh, Splats
from gsfw.formats.model_file import read_model_file
from gsfw.plugins.loading import load, load_all
from gsfw.plugins.rebuild import load_state
from gsfw.plugins.restore import Restored
from gsfw.plugins.snapshot import snapshot
from gsfw.studies.tradeoff.finished_model import FinishedModel
from gsfw.studies.tradeoff.subject import Subject

PLY = "ply"
"""Default format of gsfw export."""


@dataclass(frozen=True)
class FileRoundTrip:
    """Files of one format of a run."""

    form: str
    """Name of the format."""
    exporter: Exporter
    options: Mapping[str, Any]
    """Options of the exporter; none for its usual files."""
    model: FinishedModel

    @property
    def name(self) -> str:
        """The format with its options: "gsfw precision=compressed step=2"."""
        return " ".join([self.form, *(f"{key}={_text(v)}" for key, v in self.options.items())])

    @property
    def command(self) -> tuple[str, ...]:
        """Verb and settings that write the file."""
        options = (f"format.{key}={_text(value)}" for key, value in self.options.items())
        return ("export", f"format={self.form}", *options)

    @property
    def holds_the_model(self) -> bool:
        """True if it holds the model at all times, as it was trained."""
        return self.exporter.holds is Holds.MODEL

    def read_back(self, subject: Subject) -> Subject:
        """The model as a file holds it.

        Raises:
            DataError: no importer reads the file.
            ValueError: the format cannot hold the model.
        """
        with tempfile.TemporaryDirectory() as folder:
            path = self.write(subject, Path(folder))
            if self.holds_the_model:
                stored = read_model_file(path)
                model = deepcopy(subject.model)
                load_state(model, stored, path)
                return replace(subject, model=model)
            importers = load_all("importer", self.model.registry)
            kind = next((kind for kind in importers.values() if kind.recognises(path)), None)
            if kind is None:
                raise DataError(f"no importer reads {self.form}")
            splats = kind().read(path).splats
        return replace(subject, read=_in_scene(splats, self._scene, subject))

    def size(self, subject: Subject) -> int:
        """Bytes of the file, as it lies on the disk.

        Raises:
            ValueError: the format cannot hold the model.
        """
        with tempfile.TemporaryDirectory() as folder:
            return self.write(subject, Path(folder)).stat().st_size

    def write(self, subject: Subject, folder: Path) -> Path:
        """Write the file into a folder.

        Raises:
            ValueError: the format cannot hold the model.
        """
        path = folder / f"model{self.exporter.suffix}"
        if self.holds_the_model:
            self.exporter.write(path, self.model.source)
        else:
            antialias = self.model.restored.composition.plan.settings.antialias
            taken = snapshot(subject.model, self._scene, antialias, edit=_all(subject))
            self.exporter.write(path, taken)
        return path

    @property
    def _scene(self) -> Scene:
        return self.model.restored.composition.scene


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _all(subject: Subject) -> Callable[[Splats], Splats]:
    """The edits of a subject, one after the other."""

    def edit(splats: Splats) -> Splats:
        for one in subject.edits:
            splats = one(splats, None)
        return splats

    return edit


def _in_scene(splats: Splats, scene: Scene, subject: Subject) -> Splats:
    """Splats of the world of the data, moved to the scene frame and the subject's device."""
    moved = transform_splats(splats, scene.world_from_scene.inverse())
    like = next(iter(subject.model.columns().values())).values
    return moved.map(lambda tensor: tensor.to(like.device, torch.float32).contiguous())


def round_trips(model: FinishedModel) -> list[FileRoundTrip]:
    """Round trips for every format that can hold the model; of a moving one, at all times.

    Formats of splats that no importer of the same name reads, such as pages, are left out.
    """
    trips, readable = [], model.registry.slot("importer")
    for name, spec in model.registry.slot("exporter").items():
        kind: type[Exporter] = load("exporter", spec)
        usual = kind()
        is_splats_again = usual.is_readable and not usual.is_folder
        if usual.holds in (Holds.TRACKS, Holds.MOTION) or not is_splats_again:
            continue
        still = model.is_still and name in readable and _has_sh(model.restored)
        if usual.holds is Holds.MODEL or still:
            trips.append(FileRoundTrip(name, usual, {}, model))
            trips += [
                FileRoundTrip(name, kind(**options), options, model) for options in kind.levels
            ]
    return trips


def _has_sh(restored: Restored) -> bool:
    """True if files of splats can hold its colours."""
    with torch.no_grad():
        return isinstance(restored.composition.parts.model.splats().colors, Sh)
