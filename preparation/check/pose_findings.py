"""Findings about poses and focal lengths that matches between images contradict."""

from __future__ import annotations

from collections.abc import Iterator

from gsfw.core.words import listed
from gsfw.preparation.check.contradictions import Contradictions, exchanged_pairs
from gsfw.preparation.check.lens_findings import spread_groups
from gsfw.preparation.check.pose_conventions import Reading
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding, Weight


def pose_findings(survey: Survey) -> Iterator[Finding]:
    """Findings of the matches; none if there are too few.

    Where focal lengths of one lens differ, images contradict their poses for that reason.
    """
    found = survey.cross_check
    if found.matches.problem:
        yield _not_matched(found.matches.problem)
    if found.turntable is not None:
        yield _turntable(found.turntable)
    elif found.reading is not None:
        yield _other_reading(found.reading)
    elif found.focal_factor is not None:
        yield _wrong_focal(found.focal_factor)
    elif found.other_scene:
        yield _two_scenes(survey)
    elif found.contradictions is not None and not spread_groups(survey):
        yield from _contradictions(survey, found.contradictions)
        if found.row_shear is not None and not found.cameras_wrong:
            yield _rolling_shutter(found.row_shear)


def _not_matched(problem: str) -> Finding:
    return Finding(
        "images not matched",
        Weight.NOTE,
        f"COLMAP does not load: {problem}.",
        "Poses and focal lengths are not compared with the images.",
        "Install it anew with: pip install --force-reinstall 'pycolmap>=4.2'",
    )


def _turntable(share: float) -> Finding:
    return Finding(
        "background does not move",
        Weight.LIMIT,
        f"{100 * share:.0f} % of what two images have in common lies at the same pixel in both, "
        "although their cameras look from different sides: the object stood on a turntable.",
        "The background turns with every camera, and becomes fog around the object.",
        "Photographed on a turntable: mask the background (masks/NAME.png, bright where the "
        "object is).",
    )


def _other_reading(reading: Reading) -> Finding:
    share = f"{100 * reading.agreement:.0f} % of the matches between images agree with the poses"
    if reading.kind == "inverted":
        kind, what = "poses inverted", "once each is inverted"
        advice = (
            "The file has world-to-camera where camera-to-world is expected, or the reverse: "
            "invert each matrix."
        )
    elif reading.kind == "rotations transposed":
        kind, what = "rotations transposed", "once each rotation is transposed"
        advice = "Transpose the 3x3 rotation of each pose, and keep the rest."
    elif reading.kind:
        kind, what = "positions for translations", "once translations are taken for positions"
        advice = "Write t = -R c, where c is the position of the camera and R its rotation."
    elif reading.mirrors:
        kind, what = "mirrored", "once they are mirrored"
        advice = (
            "Poses or images were flipped, or come from a left-handed tool: negate the same row "
            "and the same column of each pose (and that coordinate of the points), or flip the "
            "images back."
        )
    else:
        kind = "camera axes"
        what = "once other axes of the camera are taken for right, down and forward"
        advice = "The file mixes OpenGL and OpenCV axes: negate two columns of each matrix."
    return Finding(
        kind,
        Weight.STOP,
        f"{share} {what}, and hardly any as they are.",
        "As they are, no shape explains two of the images.",
        advice,
    )


def _wrong_focal(factor: float) -> Finding:
    return Finding(
        "focal length wrong",
        Weight.LIMIT,
        f"Matches between images agree with focal lengths {factor:.2f} times the given ones, and "
        "not with these.",
        "Space is stretched along the viewing directions, and no shape fits all images.",
        "Is the focal length that of another image size or another lens? Correct it, or compute "
        "the cameras again with gsfw prepare.",
    )


def _rolling_shutter(shear: float) -> Finding:
    return Finding(
        "rolling shutter",
        Weight.LIMIT,
        f"Matches are off as if images were sheared, each otherwise, by {100 * shear:.1f} % of "
        "their longer side between the first and the last row.",
        "The camera moved while its rows were read one after another; no pose fits all rows.",
        "Move slower, or use photos or a faster shutter mode of the camera.",
    )


def _two_scenes(survey: Survey) -> Finding:
    names = survey.viewpoints.named(survey.cross_check.other_scene)
    return Finding(
        "two scenes",
        Weight.LIMIT,
        f"{len(names)} images match none of the others, although their cameras stand among "
        f"them: {listed(names)}.",
        "Two places in one model lie over each other as fog.",
        "Move the images of one place out of the folder, and compute cameras of each alone.",
        names,
    )


def _contradictions(survey: Survey, found: Contradictions) -> Iterator[Finding]:
    viewpoints, check = survey.viewpoints, survey.cross_check
    if found.most:
        names = viewpoints.named(found.views.tolist())
        yield Finding(
            "images and poses do not belong together",
            Weight.STOP,
            f"{len(found.views)} of {found.judged} images contradict their poses: {listed(names)}. "
            "They match each other, but elsewhere than their cameras look.",
            "Poses that belong to other images explain none of them.",
            "Were images renamed, or sorted in another way than the poses? Restore the order, or "
            "compute the cameras again with gsfw prepare.",
            names,
        )
        return
    pairs = exchanged_pairs(check.matches, check.rig, found.views)
    if pairs:
        names = viewpoints.named([view for pair in pairs for view in pair])
        swaps = ", ".join(
            f"{viewpoints.names[one]} and {viewpoints.names[other]}" for one, other in pairs
        )
        yield Finding(
            "poses exchanged",
            Weight.LIMIT,
            f"Each of these images fits the pose of the other: {swaps}.",
            "An image at another's place becomes fog in front of all cameras.",
            "Exchange their poses, or their names.",
            names,
        )
    told = {view for pair in pairs for view in pair}
    left = [view for view in check.misplaced.tolist() if view not in told]
    if left:
        yield _misplaced(survey, found, left)


def _misplaced(survey: Survey, found: Contradictions, left: list[int]) -> Finding:
    names = survey.viewpoints.named(left)
    alike = dict(zip(found.views.tolist(), found.partners, strict=True))
    why = f"{names[0]} does not show the points that were matched in it."
    if left[0] in alike:
        partners = ", ".join(survey.viewpoints.named(alike[left[0]]))
        why = f"{names[0]} shows what {partners} show, but its camera looks elsewhere."
    return Finding(
        "cameras misplaced",
        Weight.LIMIT,
        f"{len(left)} of {len(survey.viewpoints)} cameras do not look where their images were "
        f"taken: {listed(names)}. {why}",
        "A misplaced image becomes fog and doubles in front of the other cameras.",
        "Leave these images out (move them out of the folder), or compute their cameras again.",
        names,
    )
