"""Per-view maps of a data set: folders named by the user, and the maps of all frames."""

from __future__ import annotations

import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from gsfw.core.batch import Resampling
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.words import listed
from gsfw.datamanagers.fitted_map import FittedMap, ImageFit
from gsfw.datamanagers.frames import Frame, Recording
from gsfw.datamanagers.map_file import DEPTH, MAP_EXTENSIONS, MILLIMETRE, MapFile, MapHeader


@dataclass(frozen=True)
class MapFolder:
    """A folder of files that are named like the images, each a map of one view."""

    name: str
    folder: str
    """Relative to the data set, or absolute."""
    rule: Resampling
    unit: float | None = None
    """Factor of the stored numbers. ``None``: for depth 0.001 where they are whole numbers, for
    the mean of images 1/255 or 1/65535, which leads to [0, 1]; else 1."""

    @staticmethod
    def parse(text: str) -> MapFolder:
        """Read an item of ``datamanager.maps``: NAME:FOLDER, NAME:FOLDER:RULE[:UNIT].

        Raises:
            ConfigError: it is none of these.
        """
        name, _, rest = text.partition(":")
        parts, rules = rest.split(":"), [rule.value for rule in Resampling]
        rule, unit = "", None
        if len(parts) > 2 and parts[-2] in rules:
            rule, unit = parts[-2:]
            parts = parts[:-2]
        elif len(parts) > 1 and parts[-1] in rules:
            rule = parts.pop()
        folder = ":".join(parts)  # Drives of Windows have a colon.
        try:
            factor = None if unit is None else float(unit)
        except ValueError:
            factor = -1.0
        fits = re.fullmatch(r"[A-Za-z_][\w-]*", name) and folder and not folder.endswith(":")
        if not fits or (factor is not None and not 0 < factor < np.inf):
            raise ConfigError(
                f"datamanager.maps={text}: expected NAME:FOLDER, NAME:FOLDER:RULE or "
                "NAME:FOLDER:RULE:UNIT.",
                f"RULE is one of {', '.join(rules)}; UNIT is a factor, such as 0.001 for depths "
                "in millimetres.",
            )
        usual = Resampling.DEPTH if name == DEPTH else Resampling.MEAN
        return MapFolder(name, folder, Resampling(rule) if rule else usual, factor)

    def add_to(self, recording: Recording) -> Recording:
        """The recording whose frames have the map's files.

        Raises:
            DataError: there is no such folder, no file belongs to an image, or a file is damaged.
        """
        folder = recording.root / self.folder
        if not folder.is_dir():
            raise DataError(
                f"datamanager.maps={self.name}:{self.folder}: there is no folder {folder}.",
                "Give the folder of the map's files, relative to the data set.",
            )
        there = {item.relative_to(folder).as_posix() for item in folder.rglob("*")}
        found = [
            next((name for name in _file_names(frame) if name in there), None)
            for frame in recording.frames
        ]
        if not any(found):
            raise DataError(
                f"{folder} contains no map of any image (looked for "
                f"{' or '.join(_file_names(recording.frames[0])[:3])} and so on).",
                _readable(there),
            )
        with ThreadPoolExecutor() as threads:
            files = list(threads.map(lambda name: name and self._file(folder / name), found))
        frames = [
            replace(frame, maps={**frame.maps, self.name: file}) if file else frame
            for frame, file in zip(recording.frames, files, strict=True)
        ]
        return replace(recording, frames=tuple(frames))

    def _file(self, path: Path) -> MapFile:
        file = MapFile(path, self.rule)
        return replace(file, unit=self._default_unit(file) if self.unit is None else self.unit)

    def _default_unit(self, file: MapFile) -> float:
        stored = file.header().stored
        whole = stored.kind in "biu"
        if self.rule is Resampling.DEPTH:
            return MILLIMETRE if whole else 1.0
        if self.rule is Resampling.MEAN and whole and file.is_image:
            return 1 / (2 ** (8 * stored.itemsize) - 1)
        return 1.0


def _file_names(frame: Frame) -> list[str]:
    """File names of a frame's map: NAME.npy, NAME.jpg.npy, and so on."""
    return [
        name
        for own in frame.short_names
        for extension in MAP_EXTENSIONS
        for name in (own.with_suffix(extension).as_posix(), f"{own.as_posix()}{extension}")
    ]


def _readable(there: set[str]) -> str:
    """Advice on the files that are in a folder of maps instead."""
    others = sorted({Path(name).suffix.lower() for name in there} - {*MAP_EXTENSIONS, ""})
    advice = "Name maps like their images"
    if others:
        readable = ", ".join(MAP_EXTENSIONS)
        advice += f", and convert {', '.join(others)} files: {readable} can be read"
    return f"{advice}."


class ViewMaps:
    """The maps of all frames of a data set: which there are, their memory, their numbers."""

    def __init__(self, recording: Recording, frames: Sequence[Frame]) -> None:
        """Read the headers of all files; decodes nothing.

        Args:
            recording: the data set, for messages.
            frames: of the data set, in the order of their numbers.

        Raises:
            DataError: a file is damaged or does not fit its image, a map has other channels or
                another rule in some views, or is missing and its rule is not depth.
        """
        self._frames = frames
        names = list(dict.fromkeys(name for frame in frames for name in frame.maps))
        self._rules = {name: self._only_rule(name) for name in names}
        with ThreadPoolExecutor() as threads:
            self._headers = list(threads.map(_headers_of, frames))
        self.channels = {name: self._check(name, recording) for name in names}
        """Number of channels of each map, by name."""

    def notes(self) -> tuple[str, ...]:
        """The maps of a data set."""
        return tuple(self._note(name) for name in self.channels)

    def bytes(self, index: int, fit: ImageFit) -> int:
        """Memory of a frame's fitted maps."""
        width, height = fit.final
        total = 0
        for name, channels in self.channels.items():
            header = self._headers[index].get(name)
            if header is None:
                total += 4 * channels
            else:
                columns, rows = fit.map_size(header.width, header.height)
                total += rows * columns * channels * header.loaded.itemsize
            total += width * height
        return total

    def load(
        self, index: int, fit: ImageFit, inside: Bool[np.ndarray, "h w"] | None, scale: float
    ) -> dict[str, FittedMap]:
        """The fitted maps of a frame.

        Args:
            index: of the frame.
            fit: of its image.
            inside: True where the fitted image's pixels are inside its mask; ``None``: all.
            scale: scene units in a unit of the data's world, for depths.

        Raises:
            DataError: a file does not decode.
        """
        found = {}
        for name, channels in self.channels.items():
            file, rule = self._frames[index].maps.get(name), self._rules[name]
            if file is None:
                found[name] = FittedMap.unknown(channels, rule, *fit.final)
                continue
            values = file.read()
            if rule is Resampling.DEPTH:
                values = values * np.float32(scale)
            found[name] = FittedMap.of(values, rule, fit, inside)
        return found

    def _only_rule(self, name: str) -> Resampling:
        rules = {frame.maps[name].rule for frame in self._frames if name in frame.maps}
        if len(rules) > 1:
            raise DataError(f"the per-view map {name!r} has several resampling rules.")
        return rules.pop()

    def _check(self, name: str, recording: Recording) -> int:
        """The number of channels of a map that fits together over all views."""
        lacking = [frame.name for frame in self._frames if name not in frame.maps]
        if lacking and self._rules[name] is not Resampling.DEPTH:
            raise DataError(
                f"{recording.path}: {len(lacking)} of {len(self._frames)} views have no map "
                f"{name!r}: {listed(lacking)}.",
                "Add their files, or files of nan (unknown); only depths may be missing.",
            )
        first: MapHeader | None = None
        for frame, headers in zip(self._frames, self._headers, strict=True):
            header = headers.get(name)
            if header is None:
                continue
            first = first or header
            if header.channels != first.channels:
                raise DataError(
                    f"{frame.maps[name].path} has {header.channels} channels, other files of the "
                    f"map {name!r} have {first.channels}.",
                    "Every view needs the same number of channels.",
                )
        assert first is not None
        return first.channels

    def _note(self, name: str) -> str:
        count = sum(name in frame.maps for frame in self._frames)
        channels = self.channels[name]
        note = f"per-view map {name}: {channels} channel{'s' * (channels != 1)}, "
        note += f"resampled by {self._rules[name].value}"
        return note + (f", in {count} of {len(self._frames)} views" * (count < len(self._frames)))


def _headers_of(frame: Frame) -> dict[str, MapHeader]:
    return {name: file.header(frame.header) for name, file in frame.maps.items()}
