"""gsfw's own parts keep the promises of the conformance kit, as those of plugins have to."""

import pytest
from support.small_captures import ring, write_colmap, write_images, write_transforms

from gsfw.plugins.registry import SLOTS, installed
from gsfw.plugins.specs import PROJECT
from gsfw.testing import Verdict, find_subject, promises

pytestmark = pytest.mark.unchecked

CHEAP = ("metric", "sampler", "operators", "exporter", "importer")
"""Kinds whose promises take no time."""

PAIRS = "runs-with-"
"""Promises of pairs of a strategy and a method: those of strategies are checked."""


def parts():
    return [
        pytest.param(slot, name, marks=[] if slot in CHEAP else [pytest.mark.slow])
        for slot in SLOTS
        for name, spec in installed().slot(slot).items()
        if spec.distribution == PROJECT and (slot, name) != ("callback", "viewer")
    ]


def broken_of(subject):
    """The broken promises of a part."""
    checked = [
        promise
        for promise in promises(subject.slot)
        if not (subject.slot == "method" and promise.name.startswith(PAIRS))
    ]
    found = [promise.check(subject) for promise in checked]
    assert any(outcome.verdict is Verdict.KEPT for outcome in found)
    return [str(outcome) for outcome in found if outcome.verdict is Verdict.BROKEN]


@pytest.mark.parametrize(("slot", "name"), parts())
def test_a_part_keeps_its_promises(slot, name):
    assert not broken_of(find_subject(slot, name))


def colmap(folder):
    capture = ring(6)
    write_images(folder / "images", capture)
    return write_colmap(folder / "sparse" / "0", capture).parents[1]


def transforms(folder):
    capture = ring(6)
    write_images(folder, capture)
    return write_transforms(folder / "transforms.json", capture).parent


@pytest.mark.slow
@pytest.mark.parametrize(("name", "make"), [("colmap", colmap), ("transforms", transforms)])
def test_a_data_manager_of_files_keeps_its_promises(name, make, tmp_path):
    assert not broken_of(find_subject("datamanager", name, data=make(tmp_path / "data")))
