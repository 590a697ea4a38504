"""Findings about decoded images: damage, blur, exposure, copies, masks and orientation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gsfw.core.words import listed
from gsfw.preparation.blur import blur_findings
from gsfw.preparation.check.image_sample import SampledImage
from gsfw.preparation.check.point_scale import points_factor
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding, Weight
from gsfw.preparation.image_quality import CLIPPED, EMPTY

UNEVEN = 0.1
"""Standard deviation of the logarithm of brightness at the same points: fox has 0.02, plush 0.04,
and a camera that halves its exposure for some images 0.2 and more."""
UNEVEN_WITHOUT_POINTS = 0.4
"""The same of whole images, which differ because they show different things: 0.1 to 0.27."""
UNLIT = 0.04
"""Mean grey level of what counts, and its standard deviation, below which an image is black: the
darkest images of the shared captures have 0.2."""
SAME = 0.03
"""Root mean square difference of two images as 16x16 grey pixels, in standard deviations of these
pixels: another JPEG quality makes about 0.01, the next photo of fox or plush 0.1 and more."""


def image_findings(survey: Survey) -> Iterator[Finding]:
    """Everything that the sampled images show."""
    yield from _damaged(survey)
    yield from _empty(survey)
    yield from _unlit(survey)
    yield from _blur(survey)
    yield from _clipped(survey)
    yield from _uneven(survey)
    yield from _drifting(survey)
    yield from _copies(survey)
    yield from _masked(survey)
    yield from _stray_masks(survey)
    yield from _turned(survey)


def _damaged(survey: Survey) -> Iterator[Finding]:
    failures = survey.sample.failures
    if failures:
        names = survey.viewpoints.named([view for view, _ in failures])
        yield Finding(
            "damaged images",
            Weight.STOP,
            f"{len(failures)} of {survey.sample.tried} images do not decode: {failures[0][1]}",
            "Training ends with an error when it comes to one.",
            "Replace them, or remove them: missing images are left out.",
            names,
        )


def _empty(survey: Survey) -> Iterator[Finding]:
    images = survey.sample.images
    empty = [image for image in images if image.contrast < EMPTY and not is_unlit(image)]
    if empty:
        yield _blank(
            survey, empty, "empty images", "of one colour", "nothing is there", made="empty"
        )


def is_unlit(image: SampledImage) -> bool:
    """True if an image is black all over: the light was off, or the lens covered."""
    shows = image.covered > 0 and image.valid > 0
    return shows and max(image.quality.brightness, image.quality.contrast) < UNLIT


def _unlit(survey: Survey) -> Iterator[Finding]:
    images = survey.sample.images
    unlit = [image for image in images if is_unlit(image)]
    if unlit:
        learnt = "everything is black from there"
        yield _blank(survey, unlit, "unlit images", "(nearly) black", learnt, made="black")


def _blank(
    survey: Survey, blank: list[SampledImage], kind: str, what: str, learnt: str, made: str
) -> Finding:
    """Images that show nothing."""
    names = survey.viewpoints.named([image.view for image in blank])
    total = len(survey.sample.images)
    return Finding(
        kind,
        Weight.STOP if 2 * len(blank) > total else Weight.LIMIT,
        f"{len(blank)} of {total} images are {what}: {listed(names)}.",
        f"Training learns from them that {learnt}.",
        f"Remove them; if alpha or masks made them {made}, check that these are bright where "
        "pixels count.",
        names,
    )


def _textured(survey: Survey) -> list[SampledImage]:
    images = survey.sample.images
    return [image for image in images if image.contrast >= EMPTY and not is_unlit(image)]


def _blur(survey: Survey) -> Iterator[Finding]:
    scene, names = survey.scene, survey.viewpoints.names
    plain = scene.has_alpha or any(image.border for image in survey.sample.images)
    if scene.num_times > 1 and plain:
        return  # Where things come and go before nothing, they take the detail with them.
    yield from blur_findings([(names[image.view], image.quality) for image in _textured(survey)])


def _clipped(survey: Survey) -> Iterator[Finding]:
    images = _textured(survey)
    worst = sorted(images, key=lambda image: -image.quality.clipped)
    clipped = [image for image in worst if image.quality.clipped > CLIPPED]
    if clipped:
        names = survey.viewpoints.named([image.view for image in clipped])
        yield Finding(
            "clipped images",
            Weight.LIMIT,
            f"{len(clipped)} of {len(images)} images are pure white or black in up to "
            f"{100 * clipped[0].quality.clipped:.0f} % of what counts: {listed(names)}.",
            "Such areas have no texture, so their depth cannot be found.",
            "Expose for the bright parts; mask a plain background, or give background=COLOUR.",
            names,
        )


def _uneven(survey: Survey) -> Iterator[Finding]:
    images, agreement = survey.sample.images, survey.agreement
    check = survey.cross_check
    moved = check.cameras_wrong or check.other_scene or points_factor(survey) is not None
    if moved and agreement is not None:
        return  # Points then lie elsewhere in the images.
    if agreement is not None:
        gains, limit, how = agreement.gains.copy(), UNEVEN, "at the same points"
    else:
        gains = np.array([image.quality.brightness for image in images])
        gains = gains / max(float(np.median(gains)), 1e-6) if len(gains) else gains
        limit, how = UNEVEN_WITHOUT_POINTS, "as a whole"
    # What looks elsewhere, or shows nothing, has no exposure to compare.
    for row, image in enumerate(images):
        if image.view in survey.cross_check.misplaced or is_unlit(image):
            gains[row] = np.nan
    known = np.flatnonzero(np.isfinite(gains) & (gains > 1e-3))
    if len(known) < 3:
        return
    gains = gains[known]
    if float(np.log(gains).std()) > limit:
        order = np.argsort(-np.abs(np.log(gains)))
        names = survey.viewpoints.named([images[known[i]].view for i in order[:10]])
        yield Finding(
            "uneven exposure",
            Weight.LIMIT,
            f"Images are {gains.min():.2f} to {gains.max():.2f} times as bright as usual {how}.",
            "Training explains the differences by fog in front of the cameras.",
            "Train with exposure=true; next time fix exposure and white balance.",
            names,
        )


def _drifting(survey: Survey) -> Iterator[Finding]:
    found = survey.view_dependence
    if found is not None and found.drifts:
        before, after = (255 * float(np.median(d)) for d in (found.exposed, found.deviation))
        yield Finding(
            "exposure drifts",
            Weight.NOTE,
            f"A point's colours differ by {before:.1f} grey levels, and by {after:.1f} once each "
            "image has its own gains and offsets.",
            "Without these, the model takes changes of exposure for reflections.",
            "exposure=true gives images their own (held-out ones are rendered without, and measure "
            "lower); next time fix exposure and white balance.",
        )


def _copies(survey: Survey) -> Iterator[Finding]:
    """Images that are the same although another place, or the same twice, took them."""
    images, viewpoints = _textured(survey), survey.viewpoints
    copies: list[tuple[int, int]] = []
    for i, image in enumerate(images):
        for other in images[:i]:
            if _may_be_alike(survey, image, other) or image.print.shape != other.print.shape:
                continue
            difference = float(np.sqrt(np.square(image.print - other.print).mean()))
            if difference < SAME * float(image.print.std()):
                copies.append((image.view, other.view))
                break
    if copies:
        names = viewpoints.named([copy for copy, _ in copies])
        twins = tuple(
            f"{viewpoints.names[copy]} is {viewpoints.names[twin]}" for copy, twin in copies
        )
        yield Finding(
            "copies",
            Weight.LIMIT,
            f"{len(copies)} of {len(images)} images are nearly the same as another: "
            f"{listed(twins)}.",
            "They show nothing new, count twice, and a held-out copy of a trained image makes "
            "figures too good.",
            "Remove them; if their poses differ, one of the poses is wrong.",
            names,
        )


def _may_be_alike(survey: Survey, one: SampledImage, other: SampledImage) -> bool:
    """A camera that stands still takes the same image again at another time."""
    viewpoints = survey.viewpoints
    if viewpoints.times is None or viewpoints.times[one.view] == viewpoints.times[other.view]:
        return False
    return bool(viewpoints.place_of[one.view] == viewpoints.place_of[other.view])


def _masked(survey: Survey) -> Iterator[Finding]:
    images = survey.sample.images
    hidden = [image for image in images if image.valid == 0 or image.covered == 0]
    if hidden:
        names = survey.viewpoints.named([image.view for image in hidden])
        yield Finding(
            "nothing left of images",
            Weight.STOP if len(hidden) == len(images) else Weight.LIMIT,
            f"Masks or alpha leave nothing of {len(hidden)} of {len(images)} images: "
            f"{listed(names)}.",
            "Training learns nothing from them, or that nothing is there.",
            "Check the masks; if they are dark where pixels count, datamanager.invert_masks=true.",
            names,
        )


def _stray_masks(survey: Survey) -> Iterator[Finding]:
    stray = survey.leftovers.masks
    if stray is not None:
        yield Finding(
            "masks not used",
            Weight.LIMIT,
            f"{len(stray.files)} masks have the name of no image (such as {stray.found}), and "
            f"{len(stray.bare)} of {len(survey.viewpoints)} images have no mask (such as "
            f"{stray.bare[0]}).",
            "All pixels of these images count, also those that the masks should leave out.",
            f"Name each mask as its image: {stray.looked_for}, in any image format; "
            "datamanager.masks=none if they are not to be used.",
            stray.bare,
        )


def _turned(survey: Survey) -> Iterator[Finding]:
    turned = survey.files.turned
    if turned:
        yield Finding(
            "turned images",
            Weight.NOTE,
            f"{len(turned)} of {len(survey.viewpoints)} images carry an EXIF orientation, which "
            f"gsfw applies: {listed(turned)}.",
            "Cameras of the images as stored are turned with them.",
            "If results are sideways, remove that tag from the files.",
            turned,
        )
