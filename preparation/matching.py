"""Matches between images: features that look alike, then those that one geometry explains.

Verification draws random samples from a fixed seed for each pair, so that results do not depend on
the number of threads, nor on which pairs were matched before, nor on the machine that a pair was
matched on.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from gsfw.core.progress import stage
from gsfw.preparation.cancellation import cancellable
from gsfw.preparation.database_part import add_matches, matches_of, part_of
from gsfw.preparation.disk import check_room
from gsfw.preparation.machines import Machines
from gsfw.preparation.match_list import Pair, listable_names, restore_names, write_match_list
from gsfw.preparation.native import names_by_number, opened_database, readable_native_errors
from gsfw.preparation.pairs import PairPlan

if TYPE_CHECKING:
    from pycolmap import CancellationToken, Database, TwoViewGeometryOptions

    from gsfw.jobs.job import Job

TILE = 10
"""Pairs are matched in tiles of so many by so many images, for each of which COLMAP reads
features once."""
BLOCK = 100
"""Pairs between two looks at the progress, which is also what an interruption may lose."""
JOB_PAIRS = 400
"""Pairs of a job for each of its threads: up to 40 seconds, and up to 50 images (30 MB) if all
pairs are matched."""
SEED = 0


def match_pairs(
    database: Path,
    plan: PairPlan,
    jobs: int,
    guided: bool = False,
    machines: Machines | None = None,
) -> None:
    """Match and verify the planned pairs that the database does not have yet.

    Args:
        database: with features; matches go into it.
        plan: pairs with an image that is not in the database are left out.
        jobs: threads.
        guided: search again along epipolar lines where a geometry was found, which takes up to
            twice as long.
        machines: those that match, instead of threads of this one.

    Raises:
        DataError: COLMAP cannot work with the database.
        OutputError: the disk is nearly full.
        UnavailableError: a job on a machine has failed.
    """
    import pycolmap

    _match_list(database).unlink(missing_ok=True)  # Of a process that was killed.
    check_room(database)
    with readable_native_errors("match features", database):
        with pycolmap.Database.open(database) as opened:
            restore_names(opened)
            numbers = _numbers(opened)
            pairs = _tiled(plan.pairs, numbers)
            missing = [pair for pair in pairs if not _is_done(opened, numbers, pair)]
        done = len(pairs) - len(missing)
        with stage("matches", len(pairs)) as advance, listable_names(database):
            advance(done)
            if machines is None:
                matched = _match_here(database, missing, jobs, guided)
            else:
                matched = _match_there(database, missing, numbers, machines, guided)
            with closing(matched):
                for number in matched:
                    done += number
                    advance(done)


def match_more(
    database: Path, pairs: Iterable[Pair], jobs: int, machines: Machines | None = None
) -> None:
    """Match some pairs anew and more thoroughly, with ``guided``: those that would join models.

    Raises:
        DataError: COLMAP cannot work with the database.
    """
    import pycolmap

    plan = PairPlan(tuple(pairs), "")
    with (
        opened_database(database, "match features") as opened,
        pycolmap.DatabaseTransaction(opened),
    ):
        numbers = _numbers(opened)
        for first, second in _tiled(plan.pairs, numbers):
            opened.delete_matches(numbers[first], numbers[second])
            opened.delete_two_view_geometry(numbers[first], numbers[second])
    match_pairs(database, plan, jobs, guided=True, machines=machines)


def forget_matches(database: Path) -> None:
    """Remove all matches, and keep the features; no database is fine, too.

    Raises:
        DataError: COLMAP cannot work with the database.
    """
    if not database.exists():
        return
    with opened_database(database, "remove matches") as opened:
        restore_names(opened)
        opened.clear_matches()
        opened.clear_two_view_geometries()


def verification() -> TwoViewGeometryOptions:
    """COLMAP's two-view geometry, with a fixed seed."""
    import pycolmap

    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = SEED
    return options


def _match_here(
    database: Path, pairs: Sequence[Pair], jobs: int, guided: bool
) -> Generator[int, None, None]:
    """Match on this machine; yields the number of pairs of each block that is done."""
    for first in range(0, len(pairs), BLOCK):
        block = pairs[first : first + BLOCK]
        check_room(database)
        _match(database, block, jobs, guided)
        yield len(block)


def _match_there(
    database: Path,
    pairs: Sequence[Pair],
    numbers: Mapping[str, int],
    machines: Machines,
    guided: bool,
) -> Generator[int, None, None]:
    """Match on other machines; yields the number of pairs of each job that has ended."""

    def job(part: Sequence[Pair]) -> Job:
        features = part_of(database, {numbers[name] for pair in part for name in pair})
        name = f"matches of {len(part)} pair{'s' if part[1:] else ''}"
        return machines.job(name, _match_part, features, part, machines.threads, guided)

    with closing(machines.values(map(job, machines.parts(pairs, JOB_PAIRS)))) as parts:
        for number, found in parts:
            add_matches(database, found)
            yield number


def _match_part(
    features: bytes, pairs: Sequence[Pair], jobs: int, guided: bool
) -> tuple[int, bytes]:
    """Match the pairs of a job on its machine; their number, and a database of the matches."""
    with TemporaryDirectory(prefix="gsfw-matches-") as folder:
        database = Path(folder) / "part.db"
        check_room(database, 2 * len(features))
        database.write_bytes(features)
        with readable_native_errors("match features", database):
            _match(database, pairs, jobs, guided)
        return len(pairs), matches_of(database)


def _match_list(database: Path) -> Path:
    """The list of pairs that COLMAP reads while it matches."""
    return database.with_name(f"{database.stem}_pairs.txt")


def _match(database: Path, pairs: Sequence[Pair], jobs: int, guided: bool) -> None:
    import pycolmap

    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    matching.num_threads = jobs
    matching.guided_matching = guided
    listed = _match_list(database)
    try:
        pairing = pycolmap.ImportedPairingOptions()
        pairing.match_list_path = listed
        write_match_list(listed, pairs)

        def match(token: CancellationToken) -> None:
            pycolmap.match_image_pairs(
                database,
                matching_options=matching,
                pairing_options=pairing,
                verification_options=verification(),
                device=pycolmap.Device.cpu,
                cancellation_token=token,
            )

        cancellable(match)
    finally:
        listed.unlink(missing_ok=True)


def _numbers(database: Database) -> dict[str, int]:
    return {name: number for number, name in names_by_number(database).items()}


def _is_done(database: Database, numbers: dict[str, int], pair: Pair) -> bool:
    first, second = (numbers[name] for name in pair)
    return bool(
        database.exists_matches(first, second) and database.exists_two_view_geometry(first, second)
    )


def _tiled(pairs: Iterable[Pair], numbers: dict[str, int]) -> list[Pair]:
    """Each pair of two images of the database once, in tiles."""
    chosen = {
        (first, second) if numbers[first] < numbers[second] else (second, first)
        for first, second in pairs
        if first != second and first in numbers and second in numbers
    }

    def place(pair: Pair) -> tuple[int, int, int, int]:
        first, second = (numbers[name] for name in pair)
        return first // TILE, second // TILE, first, second

    return sorted(chosen, key=place)
