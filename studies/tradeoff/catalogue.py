"""Catalogue: every variant of a finished model, axis by axis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch

from gsfw.core.capabilities import Feature, of_splatting
from gsfw.core.contributions import most_useful_part
from gsfw.core.numerics import NumericsProfile
from gsfw.core.rasterizer import Rasterizer
from gsfw.plugins.loading import load
from gsfw.studies.tradeoff.edits import (
    TYPES,
    Kept,
    ShTruncation,
    StaticConversion,
    TemporalCulling,
    rounded,
)
from gsfw.studies.tradeoff.file_round_trip import PLY, round_trips
from gsfw.studies.tradeoff.finished_model import FinishedModel, LeftOut
from gsfw.studies.tradeoff.subject import Edit, Subject
from gsfw.studies.tradeoff.variant import AS_IS, Variant, unchanged

PARTS = (0.9, 0.75, 0.5, 0.25)
"""Parts of the Gaussians that pruning keeps."""
CUT_OFFS = (
    ("alpha 1/64", {"alpha_min": 1 / 64}),
    ("alpha 1/16", {"alpha_min": 1 / 16}),
    ("transmittance 1e-2", {"transmittance_min": 1e-2}),
)
"""Names and values of coarser cut-offs; the defaults are 1/255 and 1e-4."""
COMBINED = ((0.9, None, "fp16"), (0.9, 2, ""), (0.75, 2, "fp16"), (0.75, 1, ""), (0.5, 1, "fp16"))
"""Kept part, SH degree and precision of the variants with several changes."""
OPACITIES = (("1/255", 1 / 255), ("0.02", 0.02), ("0.05", 0.05))
"""Thresholds of temporal culling; below the first, no pixel shows a splat by default."""
STILL = (("25% still", 0.25), ("50% still", 0.5), ("75% still", 0.75), ("still", 1.0))
"""Parts of the rows, those with the least motion, that become static."""

Made = list[Variant] | LeftOut


def catalogue(model: FinishedModel, axes: Sequence[str]) -> tuple[list[Variant], list[LeftOut]]:
    """The unchanged model, then every variant of some axes; and the axes that are left out."""
    makers: dict[str, Callable[[FinishedModel], Made]] = {
        "sh": _sh,
        "prune": _pruned,
        "time": _times,
        "precision": _precisions,
        "format": _formats,
        "cutoffs": _cut_offs,
        "antialias": _antialias,
        "resolution": _resolutions,
        "backend": _backends,
        "combined": _combined,
    }
    variants, left_out = [_as_it_is(model)], []
    for axis in axes:
        made = makers[axis](model)
        if isinstance(made, LeftOut):
            left_out.append(made)
        else:
            variants += made
    return variants, left_out


def _as_it_is(model: FinishedModel) -> Variant:
    """The unchanged model, as a file of splats, or of the whole model where it is more."""
    if model.subject.is_splats:
        return Variant(AS_IS, AS_IS, unchanged, ("export",), file=_file_of(model))
    trips = round_trips(model)
    form = next((trip.form for trip in trips if trip.holds_the_model), "")
    words = ("export", f"format={form}") if form else ()
    return Variant(AS_IS, AS_IS, unchanged, words, file=form)


def _file_of(model: FinishedModel) -> str:
    """Format for the sizes of files; empty where splats are not the model, or none holds them."""
    trips = round_trips(model) if model.subject.is_splats else []
    return PLY if any(trip.form == PLY for trip in trips) else ""


def _edited(subject: Subject, edit: Edit) -> Subject:
    return replace(subject, edits=(*subject.edits, edit))


def _cut(degree: int) -> Callable[[Subject], Subject]:
    """Leave out the SH bands above a degree."""
    return lambda subject: _edited(subject, ShTruncation(degree))


def _kept(model: FinishedModel, part: float) -> Callable[[Subject], Subject]:
    """Keep the Gaussians of most contribution, which is measured at the first use."""
    return lambda subject: _edited(subject, Kept(most_useful_part(model.scores, part)))


def _export(model: FinishedModel, *settings: str) -> tuple[str, ...]:
    """The command that writes the variant; there is none for a model that is more than splats."""
    return ("export", *settings) if model.subject.is_splats else ()


def _sh(model: FinishedModel) -> Made:
    splats = model.subject.splats()
    degree = splats.sh_degree
    if degree == 0 and splats.extra is not None:
        return LeftOut("sh", "a network makes its colours of channels, which have no SH bands")
    if degree == 0:
        return LeftOut("sh", "its colours are the same from everywhere already")
    file = _file_of(model)
    return [
        Variant("sh", f"degree {d}", _cut(d), _export(model, f"sh_degree={d}"), file=file)
        for d in reversed(range(min(degree, 3)))
    ]


def _pruned(model: FinishedModel) -> Made:
    why = _cannot_prune(model)
    if why:
        return LeftOut("prune", why)
    return [
        Variant(
            "prune",
            f"keep {part:.0%}",
            _kept(model, part),
            _export(model, f"keep={part:g}"),
            file=_file_of(model),
        )
        for part in PARTS
    ]


def _cannot_prune(model: FinishedModel) -> str:
    if Feature.CONTRIBUTION not in model.able[model.rasterizer].features:
        return f"rasterizer {model.rasterizer} does not measure contributions"
    return ""


def _times(model: FinishedModel) -> Made:
    if model.is_still:
        return LeftOut("time", "the model does not move")
    return [
        *(Variant("time", f"cull below {name}", _culled(least)) for name, least in OPACITIES),
        *(Variant("time", name, _stilled(model, part)) for name, part in STILL),
    ]


def _culled(opacity: float) -> Callable[[Subject], Subject]:
    """Render at each time the splats that are opaque enough."""
    return lambda subject: _edited(subject, TemporalCulling(opacity))


def _stilled(model: FinishedModel, part: float) -> Callable[[Subject], Subject]:
    """Make the rows of least motion static; motion is measured at the first use."""

    def change(subject: Subject) -> Subject:
        rows = model.by_motion[: round(part * len(model.by_motion))]
        return _edited(subject, StaticConversion.of(subject, rows))

    return change


def _precisions(model: FinishedModel) -> Made:
    return [Variant("precision", name, rounded(name), draws_alike=True) for name in TYPES]


def _formats(model: FinishedModel) -> Made:
    found = []
    for trip in round_trips(model):
        # A model file needs no second one: it would be the same.
        is_there = model.is_model_file and trip.holds_the_model and not trip.options
        words, change = () if is_there else trip.command, trip.read_back
        found.append(Variant("format", trip.name, change, words, draws_alike=True, file=trip.name))
    return found


def _cut_offs(model: FinishedModel) -> Made:
    only = model.able[model.rasterizer].profile
    if only:
        return LeftOut("cutoffs", f"rasterizer {model.rasterizer} renders with {only!r} alone")
    profile = model.subject.settings.profile
    return [
        Variant("cutoffs", name, _profile(replace(profile, name=name, **values)))
        for name, values in CUT_OFFS
    ]


def _profile(profile: NumericsProfile) -> Callable[[Subject], Subject]:
    return lambda subject: replace(subject, settings=replace(subject.settings, profile=profile))


def _antialias(model: FinishedModel) -> Made:
    if Feature.ANTIALIAS not in model.able[model.rasterizer].features:
        return LeftOut("antialias", f"rasterizer {model.rasterizer} has none")
    other = not model.subject.settings.antialias

    def change(subject: Subject) -> Subject:
        return replace(subject, settings=replace(subject.settings, antialias=other))

    return [Variant("antialias", "on" if other else "off", change)]


def _resolutions(model: FinishedModel) -> Made:
    def change(subject: Subject) -> Subject:
        return replace(subject, shrink=2)

    return [Variant("resolution", "1/2, enlarged", change, ("render", "scale=0.5"))]


def _backends(model: FinishedModel) -> Made:
    """Other rasterizers that render the same image here, and types other than float32."""
    needs = [model.restored.composition.settings.config.needs(), model.subject.settings.needs()]
    found = []
    for name, able in of_splatting(model.able).items():
        if able.preference < 0 or any(able.lacking(need, model.device.type) for need in needs):
            continue  # Below 0 are rasterizers that are never chosen automatically.
        config = load("rasterizer", model.registry.find("rasterizer", name))()
        if name != model.rasterizer:
            built = config.build(model.device)
            found.append(Variant("backend", f"{name}, float32", _drawn_by(built, torch.float32)))
        elif Feature.FLOAT64 in able.features:
            own = model.subject.rasterizer
            found.append(Variant("backend", f"{name}, float64", _drawn_by(own, torch.float64)))
    return found or LeftOut("backend", "no other rasterizer runs here")


def _drawn_by(rasterizer: Rasterizer, dtype: torch.dtype) -> Callable[[Subject], Subject]:
    return lambda subject: replace(subject, rasterizer=rasterizer, dtype=dtype)


def _combined(model: FinishedModel) -> Made:
    why = _cannot_prune(model)
    if why:
        return LeftOut("combined", why)
    most = model.subject.splats().sh_degree
    return [
        _combination(model, part, degree, kind)
        for part, degree, kind in COMBINED
        if degree is None or degree < most
    ]


def _combination(model: FinishedModel, part: float, degree: int | None, kind: str) -> Variant:
    """A part of the Gaussians, with a lower degree and another precision where given."""
    names, changes = [f"keep {part:.0%}"], [_kept(model, part)]
    words = _export(model, f"keep={part:g}")
    if degree is not None:
        names.append(f"degree {degree}")
        changes.append(_cut(degree))
        words = _export(model, f"keep={part:g}", f"sh_degree={degree}")
    if kind:
        names.append(kind)
        changes.append(rounded(kind))
        words = ()  # No verb stores it.
    file = _file_of(model) if words else ""
    return Variant("combined", ", ".join(names), _in_turn(changes), words, file=file)


def _in_turn(changes: Sequence[Callable[[Subject], Subject]]) -> Callable[[Subject], Subject]:
    def change(subject: Subject) -> Subject:
        for one in changes:
            subject = one(subject)
        return subject

    return change
