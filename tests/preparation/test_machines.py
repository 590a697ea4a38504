"""Features and matches by jobs of other machines: the same as on this one."""

import shutil
import socket
import sqlite3
from contextlib import closing
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import pycolmap
import pytest
from support import captured
from support.here_executor import EndedJob, HereExecutor
from support.ray_cluster import cluster  # noqa: F401 - a fixture
from support.watched_stages import WatchedStages

from gsfw.core.errors import UnavailableError
from gsfw.core.progress import shown_by
from gsfw.jobs.job import Resources
from gsfw.jobs.outcome import Outcome
from gsfw.jobs.ray.executor import RayExecutor
from gsfw.jobs.ray.remote_job import RemoteJob
from gsfw.preparation import feature_search, matching
from gsfw.preparation.database_part import part_of
from gsfw.preparation.features import FeatureSettings, extract_features
from gsfw.preparation.image_set import ImageSet
from gsfw.preparation.machines import CUT_OFF, Machines
from gsfw.preparation.matching import match_more, match_pairs
from gsfw.preparation.pairs import PairPlan

COUNT = 5
BROKEN = "photo_003.png"
SETTINGS = FeatureSettings(max_size=240, count=600, jobs=1)
ONE = Resources(cpus=1.0, gpus=0.0)


@pytest.fixture
def executor() -> HereExecutor:
    return HereExecutor()


@pytest.fixture
def machines(executor) -> Machines:
    return Machines(executor, ONE)


@pytest.fixture(scope="module")
def images(tmp_path_factory) -> ImageSet:
    """Photos of a scene, one of which does not decode, and one with spaces in its name."""
    pycolmap.logging.minloglevel = 2
    folder = tmp_path_factory.mktemp("photos")
    views = captured.photos(captured.arc(COUNT, step=8.0, width=240, height=180))
    paths = list(captured.write(folder, views))
    paths[1] = paths[1].rename(folder / "in the  garden.png")
    found = captured.image_set(paths)
    (folder / BROKEN).write_bytes((folder / BROKEN).read_bytes()[:900])
    return found


@pytest.fixture(scope="module")
def found(images, tmp_path_factory) -> Path:
    """The database that this process makes of features alone."""
    path = tmp_path_factory.mktemp("found") / "d.db"
    extract_features(path, images, captured.one_group(images, 250.0), SETTINGS)
    return path


@pytest.fixture(scope="module")
def matched(found, images, tmp_path_factory) -> Path:
    """The same with matches."""
    path = Path(shutil.copy(found, tmp_path_factory.mktemp("matched") / "d.db"))
    match_pairs(path, every_pair(images), 1)
    return path


def every_pair(images: ImageSet) -> PairPlan:
    return PairPlan(tuple(combinations(images.by_name, 2)), "")


def rows(database: Path) -> dict[str, list]:
    """All that a database holds, to the bit."""
    with closing(sqlite3.connect(database)) as opened:
        named = opened.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        tables = [name for (name,) in named if not name.startswith("sqlite_")]
        return {
            table: sorted(opened.execute(f"SELECT * FROM {table}"), key=repr) for table in tables
        }


@pytest.mark.slow
def test_jobs_find_the_features_that_this_process_finds(
    found, images, machines, executor, tmp_path, monkeypatch
):
    monkeypatch.setattr(feature_search, "JOB_IMAGES", 2)
    groups = captured.one_group(images, 250.0)
    watched = WatchedStages()
    with shown_by(watched.show):
        reports = extract_features(tmp_path / "d.db", images, groups, SETTINGS, machines)
    assert rows(tmp_path / "d.db") == rows(found)
    assert reports == extract_features(found, images, groups, SETTINGS)
    assert reports[BROKEN].failure
    assert watched.done == list(range(COUNT + 1))
    assert [len(job.reads) for job in executor.jobs] == [2, 2, 1]
    assert executor.jobs[0].reads == tuple(image.path for image in images.images[:2])


@pytest.mark.slow
def test_jobs_match_and_verify_as_this_process_does(
    found, matched, images, machines, executor, tmp_path, monkeypatch
):
    monkeypatch.setattr(matching, "JOB_PAIRS", 2)
    database = Path(shutil.copy(found, tmp_path / "d.db"))
    watched = WatchedStages()
    with shown_by(watched.show):
        match_pairs(database, every_pair(images), 1, machines=machines)
    assert rows(database) == rows(matched)
    assert len(rows(database)["two_view_geometries"]) == 6
    assert (watched.done, len(executor.jobs)) == ([0, 2, 4, 6], 3)
    assert [path.name for path in tmp_path.iterdir()] == ["d.db"]


def test_jobs_match_more_thoroughly_as_this_process_does(matched, images, machines, tmp_path):
    here, there = (Path(shutil.copy(matched, tmp_path / name)) for name in ("a.db", "b.db"))
    pairs = every_pair(images).pairs[:2]
    match_more(here, pairs, 1)
    match_more(there, pairs, 1, machines)
    assert rows(here) == rows(there) != rows(matched)


@pytest.mark.slow
def test_what_is_there_is_not_done_again_after_an_interruption(
    found, matched, images, machines, executor, tmp_path, monkeypatch
):
    monkeypatch.setattr(feature_search, "JOB_IMAGES", 1)
    monkeypatch.setattr(matching, "JOB_PAIRS", 1)
    groups, database = captured.one_group(images, 250.0), tmp_path / "d.db"
    with pytest.raises(KeyboardInterrupt), shown_by(WatchedStages(2).show):
        extract_features(database, images, groups, SETTINGS, machines)
    executor.jobs.clear()
    extract_features(database, images, groups, SETTINGS, machines)
    assert len(executor.jobs) == COUNT - 2
    with pytest.raises(KeyboardInterrupt), shown_by(WatchedStages(4).show):
        match_pairs(database, every_pair(images), 1, machines=machines)
    executor.jobs.clear()
    match_pairs(database, every_pair(images), 1, machines=machines)
    assert len(executor.jobs) == 2
    assert rows(database) == rows(matched)


def test_a_part_has_the_images_of_its_pairs_and_no_matches(matched, tmp_path):
    path = tmp_path / "part.db"
    path.write_bytes(part_of(matched, {1, 5}))
    part, whole = rows(path), rows(matched)
    for table in ("images", "keypoints", "descriptors", "frames"):
        assert part[table] == [row for row in whole[table] if row[0] in {1, 5}]
    assert part["cameras"] == whole["cameras"]
    assert part["matches"] == part["two_view_geometries"] == []


@pytest.mark.parametrize(
    ("places", "threads", "sizes"),
    [(2, 1.0, [3, 3, 3, 1]), (3, 1.0, [4, 4, 2]), (1, 2.0, [5, 5]), (100, 1.0, [1] * 10)],
)
def test_work_is_cut_for_all_places_and_not_too_coarsely(places, threads, sizes):
    machines = Machines(HereExecutor(places), Resources(cpus=threads))
    assert [len(part) for part in machines.parts(range(10), 4)] == sizes


def test_parts_are_made_when_they_are_needed(machines):
    made = []

    def jobs():
        for number in range(5):
            made.append(number)
            yield machines.job("one", abs, number)

    for value in machines.values(jobs()):
        assert len(made) <= value + 4  # Two at work, and one that comes next.
    assert made == list(range(5))


def test_another_pycolmap_there_is_refused(images, machines, tmp_path, monkeypatch):
    job = machines.job("one", abs, -1)
    version = pycolmap.__version__
    monkeypatch.setattr(pycolmap, "__version__", "1.0")  # There, as the job is made already.
    with pytest.raises(UnavailableError) as caught:
        list(machines.values([job]))
    assert str(caught.value) == (
        f"one: pycolmap is 1.0 on {socket.gethostname()}, and {version} here.\n"
        f"Install the same version on every machine: pip install 'pycolmap=={version}'"
    )


def test_a_job_that_was_cut_off_says_how_to_go_on(machines, monkeypatch):
    killed = Outcome(False, 1.0, error="the run was ended from outside by SIGKILL.", resumable=True)
    monkeypatch.setattr(EndedJob, "poll", lambda self: killed)
    with pytest.raises(UnavailableError) as caught:
        list(machines.values([machines.job("features of 3 images", abs, 1)]))
    assert str(caught.value) == f"features of 3 images: {killed.error}\n{CUT_OFF}"


def test_the_estimated_time_is_that_of_the_cluster_and_the_settings_are_not(images):
    machines = Machines(HereExecutor(3), Resources(cpus=2.0))
    here, _ = FeatureSettings.for_machine(images, 2, None, None)
    there, how = FeatureSettings.for_machine(images, 2, None, None, machines=machines)
    assert there == here
    assert "with 6 cores of the cluster: about" in how


@pytest.fixture
def sent(cluster, monkeypatch) -> list[RemoteJob]:  # noqa: F811
    """Jobs as they are sent to machines; one of two machines dies when it has got its first."""
    from ray._private.state import actors

    jobs: list[RemoteJob] = []
    (mortal,) = (node for node in cluster.list_all_nodes() if not node.head)
    send = RemoteJob._send

    def watched(job: RemoteJob) -> None:
        send(job)
        jobs.append(job)
        place = actors(job._actor._actor_id.hex())["Address"]["NodeID"]
        if place == mortal.node_id:
            cluster.remove_node(mortal, allow_graceful=False)

    monkeypatch.setattr(RemoteJob, "_send", watched)
    return jobs


@pytest.mark.slow
def test_a_machine_that_dies_costs_its_job_and_changes_nothing(
    cluster,  # noqa: F811
    sent,
    matched,
    images,
    tmp_path,
    monkeypatch,
):
    monkeypatch.setattr(feature_search, "JOB_IMAGES", 3)
    groups, database = captured.one_group(images, 250.0), tmp_path / "d.db"
    absent = replace(images.images[0], name="z.png", path=tmp_path / "absent.png")
    more = replace(images, images=(*images.images, absent))
    with RayExecutor(cluster.address) as executor:
        machines = Machines(executor, ONE)
        assert machines.cores == 2
        extract_features(database, images, groups, SETTINGS, machines)
        assert sorted(sent.count(job) for job in set(sent)) == [1, 2]
        match_pairs(database, every_pair(images), 1, machines=machines)
        with pytest.raises(UnavailableError) as caught:
            extract_features(database, more, captured.one_group(more), SETTINGS, machines)
    assert len(sent) == 4
    assert rows(database) == rows(matched)
    host = socket.gethostname()
    assert str(caught.value) == (
        f"features of 1 image: {host} does not see {absent.path}.\n"
        "Data has to be at the same path on every machine, as on a shared disk."
    )
