"""Promises of data managers: the same images every time, valid cameras, clear errors."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.config import replace_at
from gsfw.core.datamanager import DataManager, DataRequest, Split
from gsfw.core.errors import DataError, UserError
from gsfw.plugins.automatic import BUILT_IN_SCENE
from gsfw.testing.promise import BrokenPromise, NotApplicable, Promise, require
from gsfw.testing.subject import Subject
from gsfw.testing.trial import SCENE, difference

CPU = torch.device("cpu")
MOST_VIEWS = 4
"""Views of a split that are loaded."""
MOST_FILES = 12
"""Files of a data set that are damaged, one at a time."""
ORTHONORMAL = 1e-4
"""Largest entry of R R^T - 1 of a pose."""
FOLDER_SIZE = 200_000_000
"""Bytes of a data set above which no damaged copy is made."""


def _opened(subject: Subject, path: Path | None = None, **changes: object) -> DataManager:
    """The data set of the subject, or the built-in scene at its smallest.

    Raises:
        NotApplicable: it reads files, and there are none.
        UserError: it cannot be read.
    """
    config = subject.target()
    if subject.name == BUILT_IN_SCENE and subject.data is None:
        for key, value in SCENE.items():
            if key.startswith("datamanager."):
                config = replace_at(config, key.partition(".")[2], value)
    place = subject.data if path is None else path
    request = replace(DataRequest(place, eval_every_nth=3), **changes)  # type: ignore[arg-type]
    try:
        found: DataManager = config.build(request)
    except UserError:
        if place is None:
            raise NotApplicable("it reads files: name a data set with data=PATH") from None
        raise
    return found


def _loaded(data: DataManager, split: Split = Split.TRAIN) -> list[Batch]:
    """The first views, each in a batch of its own."""
    count = min(len(data.views(split)), MOST_VIEWS)
    return [batch for view in range(count) for batch in data.load(split, [view], CPU)]


def _tensors(batch: Batch) -> dict[str, object]:
    maps = {name: (item.values, item.known) for name, item in batch.maps.items()}
    return {
        "images": batch.images,
        "alpha": batch.alpha,
        "mask": batch.mask,
        "poses": batch.cameras.world_to_camera,
        "intrinsics": batch.cameras.intrinsics,
        "time": batch.cameras.time,
        **maps,
    }


def _recognises(subject: Subject) -> None:
    kind = subject.target
    for path in (subject.workspace, subject.workspace / "missing"):
        found = kind.detect(path)
        require(
            not found.recognised,
            f"detect recognises {path.name}, which has none of its files.",
            "Test for files that only this format has.",
        )
    if subject.data is not None:
        found = kind.detect(subject.data)
        require(
            found.recognised and bool(found.found) and bool(found.looked_for),
            f"detect of its own data gives {found}.",
            "Return Detection(True, looked_for, found).",
        )


def _loads_the_same(subject: Subject) -> None:
    first, second = (_opened(subject) for _ in range(2))
    batches = [list(map(_tensors, _loaded(data))) for data in (first, second, first)]
    for other in batches[1:]:
        found = difference(batches[0], other)
        require(
            not found,
            f"loaded again, {found}.",
            "Sort the names of files, draw nothing at random, and change no batch in place.",
        )
    names = [data.views(split).names for data in (first, second) for split in Split]
    require(names[:2] == names[2:], "views have another order.", "Sort the names of the views.")


def _views_are_sound(subject: Subject) -> None:
    data = _opened(subject)
    require(len(data.views(Split.TRAIN)) > 0, "there are no training views.", "Give views.")
    require(data.scene.extent > 0, f"the extent is {data.scene.extent}.", "It must be positive.")
    for split in Split:
        views = data.views(split)
        unique = len(set(views.names)) == len(views.names) == len(views.cameras)
        require(
            unique, f"names of {split.value} views repeat.", "Give every view a name of its own."
        )
        for name, camera in zip(views.names, views.cameras, strict=True):
            _check_pose(name, camera.world_to_camera[0])
            focal = camera.intrinsics[0].diagonal()[:2]
            require(
                bool((focal > 0).all()) and camera.width > 0 and camera.height > 0,
                f"{name}: focal lengths {focal.tolist()}, size {camera.width} x {camera.height}.",
                "Intrinsics are [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels.",
            )
            time = 0.0 if camera.time is None else float(camera.time[0])
            require(0 <= time <= 1, f"{name}: the time is {time}.", "Times are in [0, 1].")


def _check_pose(name: str, pose: Tensor) -> None:
    """Check that a pose is a rigid motion."""
    rotation = pose[:3, :3].double()
    off = (rotation @ rotation.T - torch.eye(3, dtype=torch.float64)).abs().max().item()
    require(
        off <= ORTHONORMAL and torch.det(rotation).item() > 0,
        f"{name}: the error of its rotation is {off:.2g} (determinant {torch.det(rotation):.3f}).",
        "world_to_camera is rigid, without scale or reflection, with OpenCV axes.",
    )


def _batches_fit_their_views(subject: Subject) -> None:
    data = _opened(subject)
    if not data.has_images:
        raise NotApplicable("it has no images")
    for split in Split:
        views = data.views(split)
        for batch in _loaded(data, split):
            camera = views.cameras[batch.views[0]]
            shape = (1, camera.height, camera.width, 3)
            name = views.names[batch.views[0]]
            require(
                tuple(batch.images.shape) == shape,
                f"{name}: the image has the shape {tuple(batch.images.shape)}, its view {shape}.",
                "Give the size of the loaded image in views().",
            )
            in_range = bool(((batch.images >= 0) & (batch.images <= 1)).all())
            require(in_range, f"{name}: a colour is outside [0, 1].", "Divide 8-bit values by 255.")
            found = difference(_flat_camera(batch.cameras), _flat_camera(camera))
            require(not found, f"{name}: in the batch, {found}.", "Give the camera of the view.")
            require(
                {n: m.values.shape[-1] for n, m in batch.maps.items()} == dict(views.maps),
                f"{name}: the batch has the maps {sorted(batch.maps)}, views() {dict(views.maps)}.",
                "Name every per-view map with its channels in Views.maps.",
            )


def _flat_camera(camera: object) -> dict[str, object]:
    return {name: value for name, value in vars(camera).items() if name != "camera_index"}


def _downscale_halves(subject: Subject) -> None:
    full, half = _opened(subject), _opened(subject, downscale=2.0)
    names = full.views(Split.TRAIN).names
    require(names == half.views(Split.TRAIN).names, "views differ.", "Only sizes may change.")
    pairs = zip(full.views(Split.TRAIN).cameras, half.views(Split.TRAIN).cameras, strict=True)
    for name, (one, other) in zip(names, pairs, strict=True):
        expected = one.resized(other.width, other.height).intrinsics
        sizes = [abs(other.width - one.width / 2), abs(other.height - one.height / 2)]
        require(
            max(sizes) <= 1 and torch.allclose(other.intrinsics, expected, rtol=0.02),
            f"{name}: {one.width} x {one.height} becomes {other.width} x {other.height} with "
            f"intrinsics {other.intrinsics[0].tolist()}.",
            "Shrink images by request.downscale, and intrinsics by the ratio of the sizes.",
        )
    if full.has_images:
        for whole, shrunk in zip(_loaded(full), _loaded(half), strict=True):
            apart = (whole.images.mean() - shrunk.images.mean()).abs().item()
            require(
                shrunk.images.shape[1:3] == (shrunk.cameras.height, shrunk.cameras.width)
                and apart < 0.05,
                f"the shrunk image has the shape {tuple(shrunk.images.shape)}, and its mean is off "
                f"by {apart:.2g}.",
                "Average areas of pixels, as WrappedDataManager and Capture do.",
            )


def _splits_are_disjoint(subject: Subject) -> None:
    if subject.name == BUILT_IN_SCENE:
        raise NotApplicable("it has views of its own for both splits")
    data = _opened(subject)
    train, held_out = (set(data.views(split).names) for split in Split)
    require(
        not train & held_out,
        f"{sorted(train & held_out)[:3]} are training views and held out.",
        "Choose the views of a split by request.eval_every_nth, eval_by and eval_names.",
    )
    every = _opened(subject, eval_every_nth=0).views(Split.TRAIN)
    own = not held_out or len(every) == len(train)
    require(
        own or len(every) == len(train) + len(held_out),
        f"{len(every)} views without held-out ones, {len(train)} and {len(held_out)} with them.",
        "With eval_every_nth=0 all views are for training, unless the format has its own split.",
    )


def _masks_are_applied(subject: Subject) -> None:
    data = _opened(subject)
    masked = [batch for batch in _loaded(data) if batch.mask is not None] if data.has_images else []
    if not masked:
        raise NotApplicable("the data set has no masks")
    for batch in masked:
        assert batch.mask is not None
        require(
            batch.mask.dtype == torch.bool and batch.mask.shape[1:3] == batch.images.shape[1:3],
            f"a mask has the type {batch.mask.dtype} and the shape {tuple(batch.mask.shape)}.",
            "A mask is a bool of the size of its image; true where a pixel is valid.",
        )
        require(bool(batch.mask.any()), "a mask is false everywhere.", "True is for valid pixels.")


def _missing_data_is_named(subject: Subject) -> None:
    missing = subject.workspace / "there-is-no-such-data"
    _ends_in_words(lambda: _opened(subject, missing), "a path that does not exist")
    empty = subject.workspace / "empty"
    empty.mkdir(exist_ok=True)
    _ends_in_words(lambda: _opened(subject, empty), "an empty folder")


def _ends_in_words(act: Callable[[], object], what: str) -> None:
    try:
        act()
    except UserError:
        return
    except Exception as error:
        raise BrokenPromise(
            f"{what} raises {type(error).__name__}: {error}.",
            "Raise DataError with the cause, the place and the remedy.",
        ) from error
    raise BrokenPromise(f"{what} is accepted.", "Raise DataError: there is nothing to train on.")


def _damaged_files_are_named(subject: Subject) -> None:
    if subject.data is None:
        raise NotApplicable("there are no files: name a data set with data=PATH")
    source = subject.data if subject.data.is_dir() else subject.data.parent
    files = sorted(path for path in source.rglob("*") if path.is_file() and path.stat().st_size)
    if sum(path.stat().st_size for path in files) > FOLDER_SIZE:
        raise NotApplicable("the data set is too large for damaged copies")
    copy = subject.workspace / "damaged"
    for path in files[:: max(len(files) // MOST_FILES, 1)]:
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(source, copy)
        victim = copy / path.relative_to(source)
        victim.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        place = copy if subject.data.is_dir() else copy / subject.data.name
        try:
            data = _opened(subject, place)
            _loaded(data)
            _loaded(data, Split.EVAL)
        except DataError as error:
            named = victim.stem in str(error) or victim.name in str(error)
            require(
                named,
                f"half of {victim.name} gives a message that does not name it: {error}",
                "Name the file in the message.",
            )
        except Exception as error:
            happened = f"half of {victim.name} raises {type(error).__name__}: {error}."
            advice = "Raise DataError with the cause, the file and the remedy."
            raise BrokenPromise(happened, advice) from error
    shutil.rmtree(copy, ignore_errors=True)


PROMISES = (
    Promise("recognises-its-format", "detect is true only for its own files.", _recognises),
    Promise(
        "loads-the-same", "It loads the same images every time, in one order.", _loads_the_same
    ),
    Promise(
        "views-are-sound",
        "Names are unique, poses rigid, focal lengths positive, times in [0, 1].",
        _views_are_sound,
    ),
    Promise(
        "batches-fit-their-views",
        "Images, cameras and maps of a batch agree with views().",
        _batches_fit_their_views,
    ),
    Promise("downscale-halves", "downscale=2 halves images and intrinsics.", _downscale_halves),
    Promise("splits-are-disjoint", "No view is in both splits.", _splits_are_disjoint),
    Promise("masks-fit-their-images", "Masks have the size of their images.", _masks_are_applied),
    Promise(
        "missing-data-is-named", "Missing data is refused with a message.", _missing_data_is_named
    ),
    Promise(
        "damaged-files-are-named",
        "A truncated file is refused with a DataError that names it, or does no harm.",
        _damaged_files_are_named,
    ),
)
