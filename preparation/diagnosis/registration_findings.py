"""Findings on images without a camera, and on files that are not used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from gsfw.core.words import capitalized, listed
from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.match_graph import Bridge
from gsfw.preparation.diagnosis.own_focals import PER_IMAGE
from gsfw.preparation.diagnosis.repetition import ONCE
from gsfw.preparation.diagnosis.unregistered import MATCH_REASONS
from gsfw.preparation.finding import Finding, Weight, remedies

MOST = 0.9
"""Part of the images that a capture without fault places: fox and plush place all."""
HALF = 0.5
"""Part of the images below which the model is of something else than was photographed."""
ENOUGH = 20
"""Placed images that train nevertheless, to a model of a part; as in ``gsfw check``."""
FEWEST = 3
"""Images that a model needs: a point that two show is confirmed by the third."""
MANY = 0.1
"""Part of the images, or of the files, that is missed."""
SHOWN = 3
"""Largest number of bridges or reasons in a sentence."""


def registration_findings(evidence: Evidence) -> Iterator[Finding]:
    """Everything that is missing."""
    if not evidence.registered:
        yield _no_model(evidence)
    elif evidence.unregistered:
        yield _unplaced(evidence)
    yield from _groups(evidence)
    yield from _models(evidence)
    yield from _left_out(evidence)


def _no_model(evidence: Evidence) -> Finding:
    places, noun = evidence.count_shots(evidence.graph.names), evidence.noun
    found = f"None of {places} {noun} could be placed: {_reasons(evidence)}."
    if places < FEWEST:
        images = f"is only one {noun[:-1]}" if places == 1 else f"are only {places} {noun}"
        advice = "Take 50 to 150, each overlapping the next by two thirds."
        why = f"Depth needs {FEWEST} images from different places at least."
        return Finding("no cameras", Weight.STOP, f"There {images}.", why, advice)
    worst = Counter(item.reason for item in evidence.unregistered).most_common(1)[0][0]
    advice = next(item.advice for item in evidence.unregistered if item.reason == worst)
    return Finding(
        "no cameras",
        Weight.STOP,
        found,
        "Training needs to know where each image was taken from.",
        advice,
        tuple(item.name for item in evidence.unregistered),
    )


def _unplaced(evidence: Evidence) -> Finding:
    placed = evidence.count_shots(evidence.registered)
    given = evidence.count_shots(evidence.graph.names)
    missed = evidence.unregistered
    weight = Weight.NOTE if placed >= MOST * given else Weight.LIMIT
    if placed < HALF * given and len(evidence.registered) < ENOUGH:
        weight = Weight.STOP
    reasons = Counter(item.reason for item in missed).most_common(SHOWN)
    cause = _remedy_of_cause(evidence)
    first = {
        item.reason: cause if cause and item.reason in MATCH_REASONS else item.advice
        for item in reversed(missed)
    }
    advice = " ".join(remedies((reason, first[reason]) for reason, _ in reasons))
    return Finding(
        "images not placed",
        weight,
        f"{placed} of {given} {evidence.noun} were placed; the others: {_reasons(evidence)}.",
        "What only the others show will be missing."
        if weight is not Weight.STOP
        else "What is left is too small a part of what was photographed.",
        advice,
        tuple(item.name for item in missed),
    )


def _remedy_of_cause(evidence: Evidence) -> str:
    """Remedy for a known cause of too few or of wrong matches, else empty."""
    if evidence.has_own_focals:
        return PER_IMAGE
    return ONCE if evidence.graph.is_repetitive else ""


def _reasons(evidence: Evidence) -> str:
    """The reasons, each with its number of images, the most frequent first."""
    counts = Counter(item.reason for item in evidence.unregistered)
    return ", ".join(f"{reason} ({count})" for reason, count in counts.most_common())


def _groups(evidence: Evidence) -> Iterator[Finding]:
    """Images that match each other and not the others."""
    # Other groups may have been placed by many weak matches.
    components = [c for c in evidence.components if c == evidence.components[0] or not c.placed]
    whole = len(components) == len(evidence.components)
    bridges = evidence.bridges if whole else evidence.graph.bridges(components)
    joined = sum(len(component.images) for component in components)
    # Without a model, a few pairs among many images are not what was wrong.
    if len(components) < 2 or not (evidence.registered or joined > HALF * evidence.given):
        return
    apart = [name for component in components[1:] for name in component.images]
    sizes = _and([len(component.images) for component in components])
    steps = [bridge.advice for bridge in bridges[:SHOWN]]
    if len(bridges) > SHOWN:
        steps.append(f"{len(bridges) - SHOWN} more are in the report")
    # Photos in between remove no other cause.
    advice = _remedy_of_cause(evidence) or _sentence(steps)
    yield Finding(
        "separate groups",
        Weight.NOTE if len(apart) < MANY * evidence.given else Weight.LIMIT,
        f"The images fall into {len(components)} groups, of {sizes}, that hardly a match joins.",
        "Their relative position is unknown, so that only one of them is kept.",
        f"{advice} If the groups show different things, prepare each by itself.",
        tuple(apart),
    )


def _models(evidence: Evidence) -> Iterator[Finding]:
    """Models of images that match those of another, and still could not be joined to it."""
    reached = list(evidence.models[:1])
    weak: list[tuple[frozenset[str], Bridge]] = []
    for model in evidence.models[1:]:
        ours = [name for name in evidence.graph.names if any(name in one for one in reached)]
        theirs = [name for name in evidence.graph.names if name in model and name not in ours]
        if theirs and any(
            link.joins and link.other(name) in ours
            for name in theirs
            for link in evidence.graph.by_image[name]
        ):
            weak.append((model, evidence.graph.bridge(ours, theirs)))
        reached.append(model)
    if weak and not _remedy_of_cause(evidence):
        sizes = _and([len(model) for model, _ in weak])
        yield Finding(
            "separate models",
            Weight.LIMIT,
            f"There {'is' if len(weak) == 1 else 'are'} {len(weak)} more model"
            f"{'' if len(weak) == 1 else 's'}, of {sizes} images, with too few matches to be "
            "joined to others.",
            "Only the largest model is kept.",
            _sentence([bridge.advice for _, bridge in weak[:SHOWN]]),
        )


def _sentence(clauses: list[str]) -> str:
    return f"{capitalized('; '.join(clauses))}."


def _and(numbers: list[int]) -> str:
    first = ", ".join(str(number) for number in numbers[:-1])
    return f"{first} and {numbers[-1]}" if first else str(numbers[-1])


def _left_out(evidence: Evidence) -> Iterator[Finding]:
    left_out = evidence.images.left_out
    if not left_out:
        return
    # A file without advice, such as a second copy, is no loss.
    lost = [item for item in left_out if item.advice]
    files = len(left_out) + evidence.given
    counts = Counter(item.reason for item in left_out).most_common()
    reasons = "; ".join(
        f"{listed([item.name for item in left_out if item.reason == reason])}: {reason}"
        for reason, _ in counts[:SHOWN]
    )
    more = f"; {len(counts) - SHOWN} more reasons are in the report" if counts[SHOWN:] else ""
    advice = " ".join(remedies((item.name, item.advice) for item in lost))
    yield Finding(
        "files left out",
        Weight.LIMIT if len(lost) > MANY * files else Weight.NOTE,
        f"{len(left_out)} of {files} files are not used: {reasons}{more}.",
        "What only they show will be missing." if lost else "Nothing is missing without them.",
        advice or "Nothing needs to be done.",
    )
