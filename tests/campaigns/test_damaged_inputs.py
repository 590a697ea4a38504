"""The campaign of damaged inputs: every reader is in its list, and it finds planted defects."""

import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from campaign import ROOT
from damaged_inputs import outcome
from file_sets import FileSet, applied, damage
from guided_damage import Corpus, Coverage
from input_targets import WITHOUT_FILES, Target, targets
from sound_captures import CAPTURES
from support.damage import FOREIGN_NAMES
from support.reader_faults import CAN_STOP, fault
from support.readers_under_test import MODELS
from support.sampling import sampled
from trial import tried

from gsfw.core.errors import DataError, UserError
from gsfw.plugins.registry import installed

pytestmark = pytest.mark.unchecked


@pytest.fixture(scope="module")
def listed(tmp_path_factory):
    return {target.name: target for target in targets(tmp_path_factory.mktemp("listed") / "splats")}


def test_every_registered_reader_is_in_the_list(listed):
    expected = {f"data {name}" for name in installed().slot("datamanager")}
    expected -= {f"data {name}" for name in WITHOUT_FILES}
    expected |= {f"splats {name}" for name in [*installed().slot("importer"), MODELS]}
    assert expected <= listed.keys()
    assert [target.name for target in listed.values() if not target.write] == []


VIDEOS = {"data neural-3d-video", "data synchronised-videos", "video"}
NAMES = sorted(
    {f"data {name}" for name in CAPTURES} - VIDEOS
    | {"points", "image", "mask", "array", "calibration", "workload", "config", "run folder"}
    | {"checkpoint", "study", "results of a study", "camera path", "edits", "events"}
    | {"notes of a preparation", "frames of a film", "package of a plugin", "owner of a folder"}
)
"""Targets without the importers, which have short forms in tests/formats, and without videos."""


@pytest.mark.parametrize("name", sampled([(name,) for name in NAMES], range(0, len(NAMES), 8)))
def test_sound_files_are_read_and_few_damaged_ones_end_in_data_or_words(listed, tmp_path, name):
    target = listed[name]
    for files in target.sets(tmp_path / "sound"):
        files.write(tmp_path / "set")
        refusals = []
        for depth in (0, 1):
            try:
                found = target.read(tmp_path / "set" / files.entry, depth)
                assert target.check(found) == ""
            except UserError as error:
                refusals.append(error)
        assert len(refusals) < 2, refusals
    tally = tried(target, tmp_path / "short", range(40), seed=5)
    assert [str(finding) for finding in tally.findings] == []
    assert tally.executions == 40
    assert tally.lines > 5


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(VIDEOS))
def test_damaged_videos_end_in_images_or_words(listed, tmp_path, name):
    pytest.importorskip("av", reason="PyAV, which decodes videos, is not installed")
    tally = tried(listed[name], tmp_path, range(60), seed=5)
    assert [str(finding) for finding in tally.findings] == []


@pytest.mark.parametrize("name", sorted({f"data {name}" for name in CAPTURES} - VIDEOS))
def test_names_that_lead_elsewhere_end_in_data_or_words(listed, tmp_path, name):
    target = listed[name]
    for place, files in enumerate(target.sets(tmp_path / "sound")):
        folder = tmp_path / f"set-{place}"
        files.write(folder)
        image = next(Path(each).name for each in files.files if each.endswith((".png", ".jpg")))
        for file, content in files.files.items():
            for known in (image.encode(), Path(image).stem.encode()):
                if file.endswith((".png", ".jpg")) or known not in content:
                    continue
                for other in FOREIGN_NAMES:
                    (folder / file).write_bytes(content.replace(known, other))
                    read = partial(target.read, folder / files.entry, 1)
                    wrong = fault(read, 10**6, target.check)
                    assert wrong == "", (file, other[:20])
                (folder / file).write_bytes(content)


# Planted defects: a reader of each class of fault, which the campaign has to find.


def _count(path: Path) -> int:
    return int(json.loads(path.read_text())["count"])


def _raises(path, number):
    return [3, 4, 5][_count(path)]


def _allocates(path, number):
    return np.zeros(min(abs(_count(path)), 10**8), np.uint8).sum()


def _allocates_unseen(path, number):
    return torch.zeros(min(abs(_count(path)), 10**12)).sum()


def _hangs(path, number):
    content = path.read_bytes()
    while not content.endswith(b"}"):
        pass


def _not_finite(path, number):
    return float(_count(path)) * 1e300 * 1e300


def _says_nothing(path, number):
    raise DataError("bad")


def _write(folder: Path) -> str:
    (folder / "a.json").write_text('{"count": 1, "names": ["one.png", "two.png"]}')
    return "a.json"


def planted(read, check=lambda _: ""):
    def careful(path, number):
        try:
            return read(path, number)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            if isinstance(error, DataError):
                raise
            raise DataError(f"{path} is damaged: {type(error).__name__}.") from error

    return Target("planted", careful, [_write], 1, check)


@pytest.mark.parametrize(
    ("read", "words"),
    [
        (_raises, "IndexError"),
        (_allocates, "it allocated 100 MB"),
        (_allocates_unseen, "RuntimeError"),
        (_not_finite, "it is not finite"),
        (_says_nothing, "its message is 'bad'"),
    ],
)
def test_a_planted_defect_is_found_and_its_files_are_kept(tmp_path, read, words):
    def check(value):
        return "it is not finite" if isinstance(value, float) and not np.isfinite(value) else ""

    tally = tried(planted(read, check), tmp_path / "run", range(700), 1, tmp_path / "kept")
    finding = next(each for each in tally.findings if words in each.fault)
    kept = Path(finding.place)
    assert (kept / "FAULT.txt").read_text().startswith("planted, _write, seed 1, execution ")


@pytest.mark.slow
def test_the_same_seed_has_the_same_findings(tmp_path):
    first, second = (
        [each.execution for each in tried(planted(_raises), tmp_path / n, range(700), 1).findings]
        for n in ("first", "second")
    )
    assert first == second != []


@pytest.mark.slow
@pytest.mark.skipif(not CAN_STOP, reason="the system has no alarm that stops a reader")
def test_a_planted_hang_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr("trial.fault", lambda *given: fault(*given, seconds=0.05))
    tally = tried(planted(_hangs), tmp_path, range(40), 1)
    assert any("it goes on for more than 0.05 s" in each.fault for each in tally.findings)


CRASH = """
import ctypes, json, sys
from pathlib import Path
sys.path[:0] = [{root!r} + "/campaigns"]
import damaged_inputs
from gsfw.core.errors import DataError

def write(folder):
    (folder / "a.json").write_text('[1, 2, 3]')
    return "a.json"

def read(path, number):
    if number in (20, 30):
        ctypes.string_at(0)
    if number == 40:
        import threading
        threading.Event().wait()
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{{path}} is damaged: {{error}}") from error

damaged_inputs.PATIENCE = 2.0
target = damaged_inputs.Target("planted", read, [write], 1)
folder, keep = Path(sys.argv[1]), Path(sys.argv[2])
tally = damaged_inputs.isolated(target, folder, 60, 0, keep)
print(json.dumps([tally.executions, [[f.execution, f.fault, f.place] for f in tally.findings]]))
"""


@pytest.mark.slow
def test_a_planted_crash_and_a_planted_wait_are_findings_and_not_the_end(tmp_path):
    if not hasattr(os, "fork"):
        pytest.skip("processes are started by fork, which this system lacks")
    code, places = CRASH.format(root=str(ROOT)), [str(tmp_path / "run"), str(tmp_path / "kept")]
    command = [sys.executable, "-c", code, *places]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    executions, findings = json.loads(done.stdout)
    assert executions == 60
    faults = {number: fault for number, fault, _ in findings}
    assert faults[20] == faults[30] == "the process ended by SIGSEGV"
    assert faults[40] == "the process ended by SIGKILL"
    assert all(Path(place).is_dir() for _, _, place in findings)


def test_a_file_that_leads_to_new_lines_is_changed_further(tmp_path):
    coverage, (files,) = Coverage(), planted(_raises).sets(tmp_path / "sound")
    with coverage.noted():
        fault(lambda: 0, 0, lambda _: "")
    corpus = Corpus(files)
    assert all(name == "a.json" for name in files.damageable)
    kept = damage(files, "a.json", files.files["a.json"], 3)
    corpus.keep(kept)
    assert corpus.kept == [("a.json", kept.content)]


@pytest.mark.parametrize("seed", range(60))
def test_a_change_is_undone_after_it(tmp_path, seed):
    files = FileSet("a", {"a.json": b'{"name": "one.png"}', "b/c": b"text"})
    files.write(tmp_path)
    for name in files.files:
        change = damage(files, name, files.files[name], seed)
        assert change == damage(files, name, files.files[name], seed)
        with applied(tmp_path, files, change):
            if change.content is not None:
                assert (tmp_path / name).read_bytes() == change.content
        assert FileSet.of("a", tmp_path).files == files.files


def test_a_finding_breaks_its_promise(tmp_path):
    sound = tried(planted(_count), tmp_path / "a", range(20), 1)
    assert [promise.holds for promise in outcome([sound]).promises] == [True, True]
    broken = tried(planted(_raises), tmp_path / "b", range(400), 1)
    found = outcome([sound, broken])
    assert [promise.holds for promise in found.promises] == [False, True]
    assert "420 executions of 2 readers" in found.promises[0].figure
    assert found.failures[0].startswith("planted, _write, seed 1, execution ")
