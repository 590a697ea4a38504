"""No network: every verb works on a machine without a network, and reaches for nobody.

Each use is made on something real: photos become a data set, which is checked, cut and trained; the
run is resumed, evaluated, drawn, shown, exported, converted and edited.
"""

from __future__ import annotations

import importlib
import json
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from campaign import ROOT, Campaign, Detail, Outcome, Promise
from without_network import Watched, has_strace, refusal, run_offline

SCENE = (
    *("device=cpu", "datamanager.views=8", "datamanager.width=32", "datamanager.height=24"),
    *("datamanager.points=100", "datamanager.eval_views=2", "eval_every=0"),
)
"""The built-in scene, small."""
STUDY = """
title: Offline
settings: {steps: 3, device: cpu, report: false, datamanager.views: 8, datamanager.width: 32,
  datamanager.height: 24, datamanager.points: 100, datamanager.eval_views: 2}
seeds: [1]
rows: {plain: {method: 3dgs}}
scenes: {balls: {}}
columns: [psnr]
"""
TABLE = ("axes=antialias", "repeats=1", "views=1")
CASES = ("rasterizer=reference", "dtype=float32", "only=shape/discs")
BLOCKS = ("steps=3", "coarse.steps=3", "coarse.points=100", "report=false")

OF_RAY = "executor=ray"
"""The word that asks for Ray. Its own processes ask the address at which clouds tell a machine
where it runs (169.254.169.254, metadata.google.internal), though its usage statistics are off.
Without other interfaces it listens on loopback in any case: a test asks it where there are some."""

USES: tuple[tuple[str, ...], ...] = (
    ("train", "method=3dgs", *SCENE, "steps=4", "checkpoint_every=2", "out=run"),
    ("resume", "run", "steps=6"),
    ("eval", "run"),
    ("render", "run"),
    ("report", "run"),
    ("view", "run"),
    ("open", "run"),
    ("export", "run", "format=html", "out=page.html"),
    ("export", "run", "format=ply", "out=a.ply"),
    ("convert", "a.ply", "a.spz"),
    ("edit", "a.ply", "scale=2", "out=b.ply"),
    ("info", "a.ply"),
    ("runs",),
    ("config", "show", "method=3dgs"),
    ("plugins",),
    ("doctor",),
    ("completion", "bash"),
    ("new", "strategy", "my-strategy"),
    ("stress", *CASES),
    ("bench", "rasterizer=reference", "repeats=1", "workload=random:50"),
    ("partition", "street", "out=cut", "blocks=2"),
    ("blocks", "cut", *BLOCKS),
    ("study", "study.yaml", "out=study"),
    ("tradeoff", "run", *TABLE),
    ("prepare", "photos", "out=prepared", "jobs=1"),
    ("check", "prepared"),
    ("train", "data=prepared", "method=3dgs", "device=cpu", "steps=3", "out=of-photos"),
    ("runs", "compare", "run", "of-photos"),
    ("train", "method=3dgs", *SCENE, "steps=4", "processes=2", "shards=2", "out=two"),
    ("study", "study.yaml", OF_RAY, "ray.address=local", "out=on-ray"),
)
"""Uses in their order: later ones take what earlier ones have made."""
NEEDS: Mapping[str, str] = {"view": "viser", "open": "viser", OF_RAY: "ray"}
"""Packages that are not installed with gsfw, by a word that needs them."""


@dataclass(frozen=True)
class Used:
    """A use of a verb, and what came of it."""

    words: Sequence[str]
    code: int
    said: str


def make_inputs(folder: Path) -> None:
    """Write photos, a data set and a study; the scenes are those of the tests."""
    sys.path.append(str(ROOT / "tests"))
    try:
        captured = importlib.import_module("support.captured")
        street = importlib.import_module("support.street")
    finally:
        sys.path.remove(str(ROOT / "tests"))
    captured.write(folder / "photos", captured.photos(captured.arc(9)), ".jpg")
    street.write_street(folder / "street")
    (folder / "study.yaml").write_text(STUDY)


def possible(uses: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """The uses whose packages are installed."""
    return [use for use in uses if all(find_spec(NEEDS[w]) for w in use if w in NEEDS)]


def use_offline(
    uses: Sequence[Sequence[str]], folder: Path, variables: Mapping[str, str] | None = None
) -> tuple[list[Used], Watched]:
    """Make uses in one process without a network.

    Args:
        uses: words of command lines.
        folder: with the inputs.
        variables: environment variables besides those of this process.

    Returns:
        What came of each, and what the witnesses have seen.
    """
    (folder / "uses.json").write_text(json.dumps(uses))
    program = Path(__file__).with_name("offline_session.py")
    command = (sys.executable, str(program), "uses.json")
    watched = run_offline(command, folder, variables)
    lines = [line for line in watched.said.splitlines() if line.startswith('{"use"')]
    found = [json.loads(line) for line in lines]
    return [Used(each["use"], each["code"], each["said"]) for each in found], watched


def failed(used: Sequence[Used], watched: Watched, uses: Sequence[Sequence[str]]) -> list[str]:
    """Uses that did not work, a line each."""
    lines = [f"{' '.join(u.words)}: exit {u.code}: {u.said[-300:]}" for u in used if u.code]
    if len(used) < len(uses):
        end = f"exit {watched.code}: {watched.said[-300:]}"
        lines.append(f"{' '.join(uses[len(used)])}: ended the session with {end}")
    return lines


def run(size: int, seed: int, say: Callable[[str], None]) -> Outcome:
    """Make the first ``size`` uses, each in a process of its own."""
    cannot = refusal()
    if cannot:
        promise = Promise("No verb needs a network.", f"Not tried: {cannot}.", "0 uses", False)
        return Outcome([promise], failures=[cannot])
    seen: list[tuple[Sequence[str], list[str], Watched]] = []
    with tempfile.TemporaryDirectory(prefix="gsfw-offline-") as place:
        folder = Path(place)
        make_inputs(folder)
        for use in possible(USES)[:size]:
            used, watched = use_offline([use], folder)
            seen.append((use, failed(used, watched, [use]), watched))
            works, hosts = seen[-1][1] or ["works"], watched.reached
            say(f"{' '.join(use)}: {'; '.join(works)} {', '.join(hosts)}")
    return _outcome(seen)


def _outcome(seen: Sequence[tuple[Sequence[str], list[str], Watched]]) -> Outcome:
    verbs, unable = {use[0] for use, _, _ in seen}, [line for _, lines, _ in seen for line in lines]
    reached = [
        f"{' '.join(use)}: reached for {host}"
        for use, _, watched in seen
        if OF_RAY not in use
        for host in watched.reached
    ]
    opened = [
        f"{' '.join(use)}: listened on {host}"
        for use, _, watched in seen
        for host in watched.open_to
    ]
    traced, count = has_strace(), f"{len(seen)} uses of {len(verbs)} verbs"
    witness = "an audit hook in every interpreter" + (", and strace" if traced else "")
    rows = [
        (f"`gsfw {' '.join(use)}`", "no" if lines else "yes", ", ".join(watched.reached) or "-")
        for use, lines, watched in seen
    ]
    return Outcome(
        [
            Promise(
                "No verb needs a network.",
                "A network namespace with loopback only; each use is a process of its own.",
                f"{count}, {len(unable)} failed",
                not unable,
            ),
            Promise(
                "No verb contacts another machine or a name server, unless an address or "
                "executor=ray is given.",
                f"The same uses under {witness}; Ray's own processes are listed below.",
                f"{len(reached)} hosts beyond loopback in {count}",
                not reached,
            ),
            Promise(
                "Nothing listens beyond loopback.",
                "Calls of listen under strace." if traced else "Not tried: there is no strace.",
                f"{len(opened)} addresses beyond loopback in {count}",
                traced and not opened,
            ),
        ],
        [Detail("Uses, and the hosts that they contacted:", ("use", "works", "hosts"), rows)],
        [*unable, *reached, *opened],
    )


CAMPAIGN = Campaign(
    "no-network", "every verb, on a machine without a network", "uses", len(USES), run
)
