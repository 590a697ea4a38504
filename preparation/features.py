"""Features of all images: how many on what size, into COLMAP's database.

Other processes and machines may find them, and this process alone writes. What is finished stays
finished: a line of ``features.jsonl`` beside the database for each image.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from gsfw.core.errors import ConfigError
from gsfw.core.files.atomic import readable_write_errors, write_atomically
from gsfw.core.files.json_text import json_text, parsed_json
from gsfw.core.progress import stage
from gsfw.core.words import rough_duration
from gsfw.core.words import size as byte_size
from gsfw.preparation.blur import ImageBlur
from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.feature_database import FeatureDatabase
from gsfw.preparation.feature_search import find_all
from gsfw.preparation.image_quality import MEASURED_SIDE, ImageQuality
from gsfw.preparation.image_set import ImageSet
from gsfw.preparation.machines import Machines
from gsfw.preparation.sift import ImageFeatures, ImageTask

SIZES = ((1600, 4000), (1000, 2000))
"""Longest side and most features: for as long as it takes at most ``LONG``, else the last."""
LONG = 3600.0
"""Seconds for features and matches, beyond which less is looked for."""
LEAST_SIZE, LEAST_COUNT = 64, 50
"""Below, no image of anything has enough features to be matched."""
MOST_SIZE, MOST_COUNT = 100_000, 32_768
"""Beyond, there are no images; and COLMAP matches no more features (``max_num_matches``)."""
FILE_SECONDS = 0.05
"""Seconds of one core to decode a million pixels and shrink them."""
ENOUGH = 1000
"""Features of an image that need no finer ones. Fox's photos have 1,400 to 2,800 without those of
the enlarged image, which take three quarters of the time: cameras explain the tracks of all of
them as well (0.786 pixels; 0.782 where these very tracks made the cameras). Those of plush have 400
to 1,160: without finer ones half of the points are found, and splats are worse."""
MEGAPIXEL_SECONDS, FINEST_SECONDS = 0.45, 0.75
"""Seconds of one core to find features on a million of the remaining pixels, and the finest."""
MEGAPIXEL_FEATURES, FINEST_FEATURES = 2500.0, 3500.0
"""Features on a million of the remaining pixels, and the finest: in fox 2,200 and 3,600."""
PROCESS_BYTES, DECODED_BYTES, SEARCHED_BYTES = 320e6, 6, 320
"""Memory of a process that looks for the finest features: its own, for each pixel of the file, and
for each pixel that is left. Measured: 962 MB for 12 million pixels, 1150 MB for 48 million (both on
1600 x 1200), 2707 MB for 12 million on 3200 x 2400, of which 306 MB are its own."""
PAIR_SECONDS = 0.094
"""Seconds of one core to match 4000 features with 4000; grows with the square."""
MAPPING_SECONDS = 0.3
"""Seconds to compute the camera of an image: 15 for the 50 of fox on two cores, 32 for the 97 of
plush; sets of many hundred images take longer for each."""
EXHAUSTIVE = 200
"""Images up to which all pairs are counted in the estimate."""
NEIGHBORS = 30
"""Pairs for each image that are counted beyond."""


@dataclasses.dataclass(frozen=True)
class FeatureReport:
    """Facts on an image from the extraction of its features."""

    count: int
    """Features."""
    quality: ImageQuality
    blur_direction: float | None
    """Along which fine detail is missing most, in degrees from the x towards the y axis;
    ``None`` for an image without features."""
    blur_ratio: float
    """Fine detail along it, in parts of that across; 1 where there is no direction."""
    failure: str = ""
    """The reason why the image could not be decoded (it is not in the database); else empty."""
    enlarged: bool = True
    """True if the finest features were looked for, in the image at twice its size."""

    @staticmethod
    def of(document: Mapping[str, Any]) -> FeatureReport:
        """The report that ``dataclasses.asdict`` made plain data of.

        Raises:
            KeyError: there is something missing.
            TypeError: it is no such data.
        """
        quality = ImageQuality(**document["quality"])
        return FeatureReport(**{**document, "quality": quality})

    @property
    def blur(self) -> ImageBlur:
        """The measurements that tell whether the image is blurred."""
        return ImageBlur(self.quality, self.blur_direction, self.blur_ratio)


@dataclasses.dataclass(frozen=True)
class FeatureSettings:
    """Size of images and number of features in extraction."""

    max_size: int = 1600
    """Longest side in pixels; larger images are shrunk for it."""
    count: int = 4000
    """Most features; those of the largest scale are kept."""
    jobs: int = 1
    """Processes; the result does not depend on it."""
    thorough: bool = False
    """True to look for the finest features of all images, and not only of those that have fewer
    than ``ENOUGH`` others."""

    @staticmethod
    def for_machine(
        images: ImageSet,
        cores: int,
        size: int | None,
        count: int | None,
        thorough: bool = False,
        machines: Machines | None = None,
    ) -> tuple[FeatureSettings, str]:
        """Settings for a set and a machine, and the sentence that states them.

        Args:
            images: all of them.
            cores: of the machine.
            size: longest side, if the user chose it.
            count: most features, if the user chose it.
            thorough: whether the finest features of all images are wanted.
            machines: those that will do it; the time is theirs, and all else as without.

        Raises:
            ConfigError: as of ``check_wanted``.
            UnavailableError: no machine has the resources of a job.
        """
        check_wanted(size, count)
        choices = [
            FeatureSettings(size or usual_size, count or usual_count, thorough=thorough)
            for usual_size, usual_count in SIZES
        ]
        choices = [dataclasses.replace(one, jobs=one._jobs(images, cores)) for one in choices]
        chosen = next(
            (one for one in choices if sum(one.seconds(images, cores)) <= LONG), choices[-1]
        )
        return chosen, chosen._how(images, cores if machines is None else machines.cores, machines)

    def _how(self, images: ImageSet, cores: int, machines: Machines | None) -> str:
        """The sentence about settings and about the time that these cores take."""
        number = len(images.images)
        jobs = max(1, min(cores, number)) if machines is not None else self.jobs
        finding, matching = dataclasses.replace(self, jobs=jobs).seconds(images, cores)
        closely = ", the finest too," if self.thorough else ","
        with_what = f"{cores} core{'s' if cores > 1 else ''}"
        if machines is not None:
            with_what += " of the cluster"
        elif jobs < min(cores, number):
            with_what += (
                f" ({jobs} for features, as each needs {byte_size(self.process_bytes(images))})"
            )
        return (
            f"features: at most {self.count} in {_each(number)}, on up to "
            f"{self.max_size} pixels{closely} with {with_what}: about "
            f"{rough_duration(finding)}, then about {rough_duration(matching)} for matching and "
            f"{rough_duration(MAPPING_SECONDS * number)} for the cameras."
        )

    def _jobs(self, images: ImageSet, cores: int) -> int:
        """Number of processes that cores, images and free memory allow."""
        from gsfw.core.machine_memory import free_memory

        fitting = int(min(cores, free_memory() / self.process_bytes(images)))
        return max(1, min(fitting, len(images.images)))

    def process_bytes(self, images: ImageSet) -> int:
        """Memory of a process that looks for features of the largest image."""
        pixels, searched = 0.0, 0.0
        for header in (image.header for image in images.images):
            scale = min(1.0, self.max_size / max(header.width, header.height))
            pixels = max(pixels, header.width * header.height)
            searched = max(searched, header.width * header.height * scale**2)
        return round(PROCESS_BYTES + DECODED_BYTES * pixels + SEARCHED_BYTES * searched)

    def seconds(self, images: ImageSet, cores: int) -> tuple[float, float]:
        """About how long finding and matching take."""
        number = len(images.images)
        finding, features = 0.0, 0.0
        for image in images.images:
            width, height = image.header.width, image.header.height
            scale = min(1.0, self.max_size / max(width, height))
            pixels = width * height / 1e6
            finding += pixels * (FILE_SECONDS + scale**2 * (MEGAPIXEL_SECONDS + self._finest[0]))
            found = pixels * scale**2 * (MEGAPIXEL_FEATURES + self._finest[1])
            features += min(self.count, found) / number
        pairs = number * (number - 1) / 2 if number <= EXHAUSTIVE else number * NEIGHBORS
        matching = pairs * PAIR_SECONDS * (features / 4000) ** 2
        return finding / self.jobs, matching / cores

    @property
    def _finest(self) -> tuple[float, float]:
        """Seconds for the finest features of a million pixels, and their number."""
        return (FINEST_SECONDS, FINEST_FEATURES) if self.thorough else (0.0, 0.0)

    @property
    def enough(self) -> int:
        """Features of an image from which on no finer ones are looked for.

        More than there can be means that they are looked for in any case.
        """
        return self.count + 1 if self.thorough else min(ENOUGH, self.count)


def _each(number: int) -> str:
    return "the only image" if number == 1 else f"each of {number} images"


def check_wanted(size: int | None, count: int | None) -> None:
    """Check what the user chose.

    Raises:
        ConfigError: it is too little to find anything, or more than is possible.
    """
    for key, value, least, most in (
        ("feature_size", size, LEAST_SIZE, MOST_SIZE),
        ("features", count, LEAST_COUNT, MOST_COUNT),
    ):
        if value is not None and not least <= value <= most:
            raise ConfigError(
                f"{key}={value}: expected {least} to {most}.", "Leave it out to have it chosen."
            )


def extract_features(
    database: Path,
    images: ImageSet,
    groups: Sequence[CameraGroup],
    settings: FeatureSettings,
    machines: Machines | None = None,
) -> dict[str, FeatureReport]:
    """Find the features of all images that the database does not have yet.

    Args:
        database: COLMAP's file; made where there is none.
        images: all of them.
        groups: each image is in one.
        settings: those of the earlier calls on the same database.
        machines: those that look for features, instead of processes of this one.

    Returns:
        By name, in the order of the set. The database has all but those with a ``failure``.

    Raises:
        OutputError: the disk is full, or the folder cannot be written to.
        DataError: the file is no database of COLMAP.
        UnavailableError: a process was ended from outside, or a job has failed.
    """
    log = database.with_name("features.jsonl")
    total = len(images.images)
    with (
        FeatureDatabase(database, images, groups) as store,
        stage("features", total) as advance,
    ):
        reports = {
            name: report
            for name, report in _read_log(log).items()
            if name in images.by_name and (report.failure or store.has(name))
        }
        # Written anew, as its last line may be half a line.
        write_atomically(log, "".join(map(_line, reports.items())).encode())
        advance(len(reports))
        tasks = [task for task in _tasks(images, settings) if task.name not in reports]
        each = dataclasses.replace(settings, jobs=1).seconds(images, 1)[0] / max(1, total)
        # Closed at once, and not when the last reference to it goes: it holds processes.
        with closing(find_all(tasks, settings.jobs, each, machines)) as results:
            for found in results:
                if not found.failure and not store.has(found.name):
                    store.write(found)
                reports[found.name] = _report(found)
                with readable_write_errors(log), log.open("a", encoding="utf-8") as file:
                    file.write(_line((found.name, reports[found.name])))
                advance(len(reports))
    return {image.name: reports[image.name] for image in images.images}


def _tasks(images: ImageSet, settings: FeatureSettings) -> list[ImageTask]:
    longest = [max(p.header.width, p.header.height) for p in images.images]
    measured = min([MEASURED_SIDE, *longest])
    return [
        ImageTask(
            one.name,
            one.path.absolute(),  # Jobs on other machines work in other folders.
            one.header,
            settings.max_size,
            settings.count,
            measured,
            settings.enough,
            None if one.mask is None else one.mask.absolute(),
        )
        for one in images.images
    ]


def _report(found: ImageFeatures) -> FeatureReport:
    direction, ratio = found.blur
    count = len(found.keypoints)
    return FeatureReport(
        count,
        found.quality,
        direction if count else None,
        ratio,
        found.failure,
        found.enlarged,
    )


def _line(named: tuple[str, FeatureReport]) -> str:
    return json_text({"name": named[0], **dataclasses.asdict(named[1])}) + "\n"


def _read_log(log: Path) -> dict[str, FeatureReport]:
    reports: dict[str, FeatureReport] = {}
    if not log.exists():
        return reports
    for line in log.read_text("utf-8", errors="replace").splitlines():
        try:
            document = parsed_json(line)
            name = document.pop("name")
            reports[name] = FeatureReport.of(document)
        except (ValueError, TypeError, KeyError, AttributeError):
            continue
    return reports
