"""Mapping: where the cameras stood, computed from the matches of a database."""

from __future__ import annotations

import shutil
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import readable_write_errors
from gsfw.core.progress import Advance, stage
from gsfw.preparation.mapping.global_mapping import run_global
from gsfw.preparation.mapping.incremental_mapping import (
    RELAXED,
    USUAL,
    Models,
    largest_first,
    run_incremental,
)
from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.mapping.merging import adjusted, is_as_precise, merge_models
from gsfw.preparation.mapping.observations import cut_loose
from gsfw.preparation.native import names_by_number, opened_database, readable_native_errors

if TYPE_CHECKING:
    from pycolmap import Reconstruction

TASK = "compute camera poses"
FEW = 0.5
"""Least part of the images in a model; below it, mapping is tried again."""

JOINED = "joined-"
"""Begins the names of models after mapping was continued."""


@dataclass(frozen=True)
class Mapping:
    """Models of a capture."""

    models: tuple[Path, ...] = ()
    """Folders in COLMAP's layout, the largest first; none where nothing could be computed."""
    sizes: tuple[int, ...] = ()
    """Number of images with a pose in each model."""
    merged: int = 0
    """Number of models that were joined to the largest."""
    seconds: float = 0.0
    how: str = ""
    """Description of the mapping, as a clause."""

    def document(self) -> dict[str, Any]:
        """Plain data, in which models are named as in their folder."""
        return {
            "models": [path.name for path in self.models],
            "sizes": list(self.sizes),
            "merged": self.merged,
            "seconds": self.seconds,
            "how": self.how,
        }

    @staticmethod
    def of(document: dict[str, Any], folder: Path) -> Mapping:
        """The mapping that was written as plain data.

        Args:
            document: what ``document`` gave.
            folder: where the models are.
        """
        return Mapping(
            models=tuple(folder / name for name in document["models"]),
            sizes=tuple(document["sizes"]),
            merged=document["merged"],
            seconds=document["seconds"],
            how=document["how"],
        )


def map_cameras(database: Path, folder: Path, rule: MappingRule) -> Mapping:
    """Compute poses and points of as many images as possible.

    With one thread the same database gives the same bits; with more, sums are done in another
    order each time, and figures differ in their last digits.

    Args:
        database: COLMAP's, with features and verified matches; it is not changed.
        folder: for the models, and for them alone; what an earlier call left there is replaced.
        rule: how to do it.

    Returns:
        The models; none, without an error, where nothing can be reconstructed.

    Raises:
        DataError: there is no such database, or COLMAP failed on it.
        OutputError: the folder cannot be written to.
    """
    start = time.perf_counter()
    total = count_images(database)
    with _trial(folder, database) as trial, stage("cameras", total) as advance:
        if rule.mapper == "global":
            models, how = _global(database, trial, rule)
        else:
            models, how = _incremental(database, trial, rule, total, advance)
        models, merged = _finished(models, database, trial, rule)
        advance(_covered(models))
        paths = _published(models, trial, folder)
    seconds = time.perf_counter() - start
    return Mapping(paths, _sizes(models), merged, seconds, how)


def continue_mapping(
    database: Path,
    folder: Path,
    mapping: Mapping,
    rule: MappingRule,
    without: Collection[str] = (),
) -> Mapping:
    """Add to the largest model what relaxed thresholds let in, and join the others to it.

    This is for after more pairs of images have been matched: see ``bridge_pairs``.

    Args:
        database: as for ``map_cameras``, with the new matches.
        folder: the one of the models; new ones are written beside the old, which stay.
        mapping: of which the largest model grows; where there is none, all begins anew.
        rule: how to do it; growing is incremental in any case.
        without: names of images that are not worth a pose that rests on little.

    Returns:
        The new models; of the same images as the old where nothing could be added.

    Raises:
        DataError, OutputError: as for ``map_cameras``.
    """
    from pycolmap import Reconstruction

    if not mapping.models:
        return map_cameras(database, folder, rule)
    began = time.perf_counter()
    total = count_images(database)
    with _trial(folder, database) as trial, stage("cameras", total) as advance:
        before = [Reconstruction(path) for path in mapping.models]
        known = before[0].num_reg_images()
        registered = _up_to(database, total, advance, known)
        among = _names_but(database, without)
        start = mapping.models[0]
        grown = run_incremental(database, trial, rule, RELAXED, registered, start, among)
        largest = next((model for model in grown if _is_better(model, before[:1])), before[0])
        models, merged = _finished([largest, *before[1:]], database, trial, rule)
        advance(_covered(models))
        paths = _published(models, trial, folder, JOINED)
    sizes = _sizes(models)
    seconds = mapping.seconds + time.perf_counter() - began
    how = f"{mapping.how}, continued with relaxed thresholds (+{sizes[0] - known} images)"
    return Mapping(paths, sizes, mapping.merged + merged, seconds, how)


def _names_but(database: Path, without: Collection[str]) -> list[str]:
    """Names of all images of a database but some."""
    with opened_database(database, "read the images") as opened:
        return [name for name in names_by_number(opened).values() if name not in without]


def count_images(database: Path) -> int:
    """Number of images in a database.

    Raises:
        DataError: there is no such database, or it is damaged.
    """
    if not database.is_file():
        raise DataError(
            f"{database} is missing: it holds the features and matches of the images.",
            "Run the same command with a new out=DIR, so that they are computed anew.",
        )
    with opened_database(database, "read the images") as opened:
        return int(opened.num_images())


@contextmanager
def _trial(folder: Path, database: Path) -> Iterator[Path]:
    """A folder for what is not finished, empty at the start and gone at the end."""
    trial = folder / "unfinished"
    with readable_write_errors(folder):
        shutil.rmtree(trial, ignore_errors=True)
        trial.mkdir(parents=True)
        try:
            with readable_native_errors(TASK, database):
                yield trial
        finally:
            shutil.rmtree(trial, ignore_errors=True)


def _global(database: Path, trial: Path, rule: MappingRule) -> tuple[Models, str]:
    """Models by global mapping, in which images that nothing holds are placed anew."""
    models = run_global(database, trial, rule)
    how = "global mapping (GLOMAP)"
    loose = cut_loose(models[0]) if models else 0
    if not loose:
        return models, how
    held = trial / "held"
    held.mkdir()
    models[0].write(held)
    grown = run_incremental(database, trial, rule, USUAL, start_from=held)
    how = f"{how}, with {loose} images placed anew by incremental mapping"
    # COLMAP goes on with the model that it is given, and begins others with what that lacks.
    return grown, how


def _incremental(
    database: Path, trial: Path, rule: MappingRule, total: int, advance: Advance
) -> tuple[Models, str]:
    """Models by usual thresholds; where these give few, by relaxed ones if that is better."""
    registered = _up_to(database, total, advance)
    models = run_incremental(database, trial, rule, USUAL, registered)
    how = "incremental mapping (COLMAP)"
    if _covered(models) >= FEW * total:
        return models, how
    advance(0)
    relaxed = run_incremental(database, trial, rule, RELAXED, registered)
    if _covered(relaxed) > _covered(models) and _is_better(relaxed[0], models[:1]):
        return relaxed, f"{how}, relaxed thresholds ({_covered(models)} images by usual ones)"
    return models, f"{how}, relaxed thresholds tried without success"


def _up_to(database: Path, total: int, advance: Advance, known: int = 0) -> Advance:
    """Tells of images besides those that are known; never of more than there are.

    COLMAP counts frames, which are panoramas where images are views of them.
    """
    with opened_database(database, "read the images") as opened:
        each = total / max(1, opened.num_frames())
    return lambda count: advance(min(known + round(count * each), total))


def _is_better(model: Reconstruction, others: Models) -> bool:
    """True if a model has no fewer images than any other, and fits no worse."""
    return all(
        model.num_reg_images() >= other.num_reg_images()
        and is_as_precise(model, other.compute_mean_reprojection_error())
        for other in others
    )


def _finished(models: Models, database: Path, trial: Path, rule: MappingRule) -> tuple[Models, int]:
    """Models joined where possible, with principal points where asked; and how many joined."""
    models, merged = merge_models(models, database, trial, rule)
    if rule.refine_principal_point:
        # Last, since COLMAP finds a model more surely while they stay in the middle.
        models = [adjusted(model, rule, principal_point=True) for model in models]
    return largest_first(models), merged


def _published(models: Models, trial: Path, folder: Path, prefix: str = "") -> tuple[Path, ...]:
    """Write models, named by their ranks, in the place of old ones of such names."""
    made = trial / "made"
    names = [f"{prefix}{rank}" for rank in range(len(models))]
    for name, model in zip(names, models, strict=True):
        (made / name).mkdir(parents=True)
        model.write(made / name)
    for old in folder.iterdir():
        if old.name.startswith(prefix) and old.name.removeprefix(JOINED).isdecimal():
            shutil.rmtree(old)
    return tuple((made / name).rename(folder / name) for name in names)


def _sizes(models: Models) -> tuple[int, ...]:
    return tuple(model.num_reg_images() for model in models)


def _covered(models: Models) -> int:
    """Number of images that are in any model."""
    return len(set().union(*(model.reg_image_ids() for model in models)))
