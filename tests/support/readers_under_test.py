"""Readers under test: every importer, and the reader of model files, with sound files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import torch

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Exporter, ExportSource, Holds, Importer, Motion, MotionFile
from gsfw.formats.model_file import ModelFileExporter, Precision, read_model_file
from gsfw.plugins.loading import load_all
from gsfw.plugins.registry import installed
from gsfw.testing.sources import splat_file
from support.foreign_files import CHUNK, foreign_files
from support.gaussian_models import gaussians, moving

COUNT = 5
"""Splats of most sound files."""
MODELS = "gsfw"
"""Name of the reader of model files."""


@dataclass(frozen=True)
class Sound:
    """A sound file of a format."""

    label: str
    suffix: str
    content: bytes
    count: int = COUNT
    """Its splats."""
    beside: Mapping[str, bytes] = field(default_factory=dict)
    """Files that belong to it, by their names."""

    def write(self, folder: Path, name: str) -> Path:
        """Write it under a name without suffix, with what belongs to it."""
        if self.beside:
            folder = folder / self.label
            folder.mkdir(exist_ok=True)
        for other, content in self.beside.items():
            if not (folder / other).exists():
                (folder / other).write_bytes(content)
        path = folder / f"{name}{self.suffix}"
        path.write_bytes(self.content)
        return path


class ModelFiles(Importer):
    """Model files, read as importers read splats."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        return path.suffix == ModelFileExporter.suffix

    def read(self, path: Path) -> Any:
        return read_model_file(path)


@dataclass(frozen=True)
class Reader:
    """An importer with its sound files."""

    name: str
    kind: type[Importer]
    sound: tuple[Sound, ...]


def readers(folder: Path) -> dict[str, Reader]:
    """Every importer with the sound files that it recognises, by name."""
    importers: dict[str, type[Importer]] = {**load_all("importer", installed()), MODELS: ModelFiles}
    found: dict[str, list[Sound]] = {name: [] for name in importers}
    foreign = ((_label(path), path) for path in foreign_files(folder))
    for label, path in chain(_written(folder), _models(folder), foreign):
        for name, kind in importers.items():
            if kind.recognises(path):
                suffix = path.name[path.name.index(".") :]
                count = CHUNK if path.name.startswith("chunk.") else COUNT
                sound = Sound(label, suffix, path.read_bytes(), count, _beside(path))
                found[name].append(sound)
    return {name: Reader(name, importers[name], tuple(files)) for name, files in found.items()}


def _label(path: Path) -> str:
    """The name of a file; of a description, that of its folder."""
    return path.name.split(".")[0] if path.stem != "meta" else path.parent.name


def _beside(path: Path) -> dict[str, bytes]:
    """The files that the JSON of a file names."""
    if path.suffix not in (".json", ".gltf"):
        return {}
    text = path.read_text()
    others = (other for other in path.parent.iterdir() if other.is_file() and other != path)
    return {other.name: other.read_bytes() for other in others if f'"{other.name}"' in text}


def _models(folder: Path) -> Iterator[tuple[str, Path]]:
    """Model files in every precision, of a still and of a moving model."""
    for name, model in (("still", gaussians(COUNT)), ("moving", moving(COUNT))):
        for precision in Precision:
            path = folder / f"{name}-{precision.value}.gsfw"
            ModelFileExporter(precision=precision.value).write(path, model)
            yield path.stem, path


def _written(folder: Path) -> Iterator[tuple[str, Path]]:
    """Small files of every format of splats, with each value of each option."""
    exporters: dict[str, type[Exporter]] = load_all("exporter", installed())
    for form, kind in exporters.items():
        # Points, for example, are written for other programs, and are splats no more.
        holds_splats = kind.holds in (Holds.SPLATS, Holds.MOTION)
        if not holds_splats or kind.is_folder or not kind.is_readable:
            continue
        for number, exporter in enumerate(_variants(kind)):
            path = folder / f"{form}-{number}{kind.suffix}"
            exporter.write(path, _content_for(kind.holds, 0 if number == 1 else 1))
            yield f"{form}-{number}", path


def _content_for(holds: Holds, degree: int) -> ExportSource:
    """Five splats; they move where a format holds motion."""
    content = splat_file(COUNT, degree)
    if holds is not Holds.MOTION:
        return content
    still = Motion.none(COUNT)
    motion = replace(still, width=torch.full_like(still.width, 0.4), path=still.path + 0.1)
    return MotionFile(content, motion, (0.0, 1.0), frames=3)


def _variants(kind: type[Exporter]) -> list[Exporter]:
    """The exporter with its defaults, and with other values of one option at a time."""
    made = kind()
    found = [made, made]  # The second one writes splats without view dependence.
    if is_dataclass(made):
        hints = get_type_hints(kind)
        for item in fields(made):
            for value in _values(hints[item.name]):
                try:
                    other: Any = replace(made, **{item.name: value})
                except (ConfigError, ValueError):
                    continue
                found += [other] if other not in found else []
    return found


def _values(kind: Any) -> Sequence[object]:
    if get_origin(kind) is Literal:
        return get_args(kind)
    return {bool: (False, True), int: range(6)}.get(kind, ())
