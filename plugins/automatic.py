"""Automatic choices: the recognised data format, and the device and rasterizer that fit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsfw.core.config import AUTO, Detection
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.files.mirror import local_place
from gsfw.core.files.prepared_folder import REPORT, is_begun
from gsfw.core.files.reading import is_file
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.words import listed, shell_argument
from gsfw.plugins.initial_splats import refuse_splats
from gsfw.plugins.loading import ask_all, load
from gsfw.plugins.registry import Registry, what_is_missing

USUAL_CHOICE = "the default of gsfw"
"""Cause of a choice that the method and the user leave open."""
BUILT_IN_SCENE = "synthetic"
"""The data manager that needs no file."""

MAX_NAMES_SHOWN = 12
"""Number of file names that describe a folder of unknown format."""


@dataclass(frozen=True)
class Choice:
    """An automatically chosen name."""

    name: str
    reason: str

    @property
    def source(self) -> str:
        """The text for ``Settings.sources``."""
        return f"chosen automatically: {self.reason}"


def choose_datamanager(data: str, registry: Registry, most: int | None = None) -> Choice:
    """Choose the data manager that recognises ``data``.

    Args:
        data: a path or an address; empty for the built-in scene.
        registry: the installed parts.
        most: bytes that images of an address may take on the disk; ``None`` for the usual.

    Raises:
        DataError: it is missing, empty, splats, or of no known format; names the expected files.
    """
    if not data:
        return Choice(BUILT_IN_SCENE, "no data= is given")
    path = local_place(data, most)
    with _readable(path):
        _check_exists(path)
        refuse_splats(path, registry)
        detections = ask_all("datamanager", registry, lambda kind: kind.detect(path))
    recognised = [name for name, seen in detections.items() if seen.recognised]
    if not recognised:
        refuse_run(path, f"data={path}", "data set")
        with _readable(path):
            _refuse_unprepared(path)
            raise DataError(*_unrecognised(path, detections))
    best = max(recognised, key=lambda name: detections[name].priority)
    others = [name for name in recognised if name != best]
    also = f" (preferred to {', '.join(others)})" if others else ""
    return Choice(best, f"found {detections[best].found}{also}")


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn a permission error of a folder into one clear message."""
    try:
        yield
    except OSError as error:
        raise DataError(
            f"data={path}: {error.filename or path} cannot be read: {error.strerror or error}.",
            "Give a folder that you may read, or have its permissions changed.",
        ) from error


def _check_exists(path: Path) -> None:
    if path.exists():
        if path.is_dir() and not any(path.iterdir()):
            raise DataError(
                f"data={path}: the folder is empty.",
                "Give the folder that holds the images and their cameras.",
            )
        return
    raise DataError(f"data={path}: there is no such file or folder.", what_is_missing(path))


def refuse_run(path: Path, named: str, wanted: str) -> None:
    """Refuse the folder of a run in place of images; anything else passes.

    Args:
        path: a file or folder.
        named: words of the user that name it.
        wanted: what it stands in place of.

    Raises:
        DataError: it is a run; names the data that it was trained on.
    """
    from gsfw.plugins.config_file import read_config  # It imports this module.

    config = RunFolder(path).config
    try:
        values = read_config(config, everything=True).values if config.is_file() else {}
    except (ConfigError, OSError):
        return
    if "datamanager" not in values and "method" not in values:
        return  # Another program's file.
    data, reader = values.get("data"), values.get("datamanager")
    raise DataError(
        f"{named}: this is a run of gsfw, and no {wanted}.",
        f"Give the data set that it was trained on: {data}"
        if data
        else f"It was trained on datamanager={reader}, without data.",
    )


def _refuse_unprepared(path: Path) -> None:
    """Refuse a folder of ``gsfw prepare`` that has no data set; anything else passes.

    Raises:
        DataError: it is such a folder.
    """
    if not is_begun(path):
        return
    if is_file(path / REPORT):
        raise DataError(
            f"data={path}: this result of gsfw prepare has no images with cameras.",
            f"If files were moved or deleted, repeat gsfw prepare. Else {path / REPORT} has the "
            "reason for each image: take more photos, and give all of them to gsfw prepare.",
        )
    raise DataError(
        f"data={path}: gsfw prepare has not finished this data set.",
        f"Repeat its command, which continues: gsfw prepare INPUT out={shell_argument(path)}",
    )


def _unrecognised(path: Path, detections: dict[str, Detection]) -> tuple[str, str]:
    """Message and advice: what was found instead, or else what was looked for."""
    said = f"data={path}: this is not a data set that can be read here."
    formats = {name: seen.looked_for for name, seen in detections.items() if seen.looked_for}
    explained = dict.fromkeys(seen.found for seen in detections.values() if seen.found)
    if explained:
        return " ".join([said, *(f"Found {found}." for found in explained)]), (
            f"Formats that have cameras: {', '.join(formats)}. If it is one of them, name it: "
            "datamanager=NAME says what is wrong with it."
        )
    lines = [f"{said} Looked for:", *(f"  {name}: {sign}" for name, sign in formats.items())]
    if path.is_dir():
        names = sorted(f"{item.name}/" if item.is_dir() else item.name for item in path.iterdir())
        lines.append(f"The folder holds: {listed(names, MAX_NAMES_SHOWN)}.")
    advice = "If it is one of these formats, name it: datamanager=NAME says what is wrong with it."
    return "\n".join(lines), advice


def choose_device(
    device: str, rasterizer: str, registry: Registry, needs: dict[str, Any]
) -> tuple[Choice | None, Choice | None]:
    """Choose the device and the rasterizer of a run; ``None`` for each that is not ``auto``.

    If none fits, the rasterizer with the fewest unmet needs is chosen: a later check names
    them.

    Raises:
        ConfigError: no rasterizer is installed, or none of splatting's rule.
    """
    import torch

    from gsfw.core.capabilities import fitting, of_splatting

    able = rasterizer_capabilities(registry)
    if not able:
        raise ConfigError("no rasterizer is installed.", "See gsfw doctor.")
    named, able = able, of_splatting(able) if rasterizer == AUTO else {rasterizer: able[rasterizer]}
    if not able:
        raise ConfigError(
            "rasterizer=auto: every installed rasterizer has a rule of its own, not splatting's.",
            f"Name one: rasterizer={min(named)}",
        )
    chosen_device = None
    if device == AUTO:
        if not torch.cuda.is_available():
            chosen_device = Choice("cpu", "torch sees no GPU here")
        else:
            chosen_device = _gpu_or_cpu(
                fitting(needs, able, "cuda"), fitting(needs, able, "cpu"), able
            )
        device = chosen_device.name
    if rasterizer != AUTO:
        return chosen_device, None
    kind = device.partition(":")[0]
    fits = fitting(needs, able, kind)
    if fits:
        return chosen_device, Choice(fits[0], f"the fastest that fits on {kind}")
    missing = {
        name: sum(len(item.lacking(need, kind)) for need in needs.values())
        for name, item in able.items()
    }
    least = min(missing, key=lambda name: missing[name])
    return chosen_device, Choice(
        least, f"no rasterizer on {kind} has all that is needed; this lacks least"
    )


def _gpu_or_cpu(on_gpu: list[str], on_cpu: list[str], able: dict[str, Any]) -> Choice:
    """Choose the device of the preferred fitting rasterizer; a GPU rather than the CPU."""
    if not on_gpu:
        return Choice("cpu", "there is a GPU, but no installed rasterizer fits there")
    if on_cpu and able[on_cpu[0]].preference > able[on_gpu[0]].preference:
        # Where the fast backend of the GPU cannot run, the reference could, but slowly.
        return Choice(
            "cpu",
            f"there is a GPU, but rasterizer {on_cpu[0]} is preferred to {on_gpu[0]}, "
            "the best that fits there",
        )
    return Choice("cuda", f"torch sees a GPU, and rasterizer {on_gpu[0]} runs on it")


def choose_profile(rasterizer: str, registry: Registry) -> Choice:
    """Choose the numerics profile of a run that ``rasterizer`` renders."""
    from gsfw.core.numerics import DEFAULT

    own = rasterizer_capabilities(registry)[rasterizer].profile
    if own:
        return Choice(own, f"the only one that rasterizer {rasterizer} draws with")
    return Choice(DEFAULT.name, USUAL_CHOICE)


def rasterizer_capabilities(registry: Registry) -> dict[str, Any]:
    """Abilities of every installed rasterizer on this machine, with default settings, by name."""
    from gsfw.core.capabilities import Capabilities

    able: dict[str, Capabilities] = {}
    for name, spec in registry.slot("rasterizer").items():
        try:
            able[name] = load("rasterizer", spec)().capabilities()
        except ConfigError as error:
            able[name] = Capabilities(unavailable=error.message)
        except Exception as error:
            registry.skip("rasterizer", spec, error)
            able[name] = Capabilities(unavailable=f"it failed with {type(error).__name__}: {error}")
    return able
