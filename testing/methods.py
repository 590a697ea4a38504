"""Promises of methods: they learn, resume to the same bits, and render the same from files."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import torch

from gsfw.core.config import MethodConfig
from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.core.loop.resolution import MIN_SIDE, ResolutionSchedule
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.maths.frame import transform_splats
from gsfw.core.model import PrimitiveModel
from gsfw.core.splats import Sh, Splats
from gsfw.formats.model_file import ModelFileExporter, read_model_file
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.plugins.config_file import PLACES, read_config, write_config
from gsfw.plugins.rebuild import rebuild, stored_model
from gsfw.plugins.restore import restore
from gsfw.plugins.settings import Layer, resolve
from gsfw.plugins.snapshot import snapshot, with_sh
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.stress.case import front_camera
from gsfw.testing.method_trial import HALF, STEPS, TIMES, flat, method_trial, splats_at, trained
from gsfw.testing.model_edits import EDITS
from gsfw.testing.promise import BrokenPromise, NotApplicable, Promise, require
from gsfw.testing.strategies import TableWatch, watched
from gsfw.testing.subject import Subject
from gsfw.testing.trial import (
    difference,
    require_equal_resume,
    require_own_generator,
)

SHORT = 12
"""Length of the other runs."""
EPOCH = 6
"""Steps in which every view is drawn once."""
EDITED = 120
"""Length of the runs with strategies, in which these edit rows."""
STRATEGIES = ("adc", "error", "mcmc", "none")
"""The built-in strategies."""
SHADE = 1e-3
"""Largest difference of an image after an export."""


def _learns(subject: Subject) -> None:
    _, watched_losses, _ = trained(subject)
    losses = watched_losses.losses
    # The best turn, since methods with phases may lose what an earlier phase has learned.
    turns = [sum(losses[at : at + EPOCH]) / EPOCH for at in range(0, STEPS, EPOCH)]
    require(
        min(turns[1:]) < turns[0],
        f"the mean loss is {turns[0]:.4f} over the first {EPOCH} steps, and never below "
        f"{min(turns[1:]):.4f} later.",
        "Check that losses() is computed from context.rendered, and the learning rates of the "
        "columns.",
    )


def _resumes(subject: Subject) -> None:
    trained(subject)
    run = method_trial(subject, "trained", {"checkpoint_every": HALF})
    require_equal_resume(
        run,
        HALF,
        STEPS,
        "Keep all state that changes during training in the columns, parameter groups, buffers or "
        "state_dict of the method; draw random numbers only from the given generator.",
    )


def _is_evaluated_as_restored(subject: Subject) -> None:
    _, _, halfway = trained(subject)
    run = method_trial(subject, "trained", {"checkpoint_every": HALF})
    model = run.resumed(HALF).parts.model
    for time, before in zip(TIMES, halfway.splats, strict=True):
        found = difference(before, flat(splats_at(model, time)))
        require(
            not found,
            f"after the model of step {HALF} was restored, {found} from the splats of evaluations "
            f"in the run (time {time}).",
            "Add noise and dropout in splats() only while self.training is true, that is in "
            "training steps.",
        )


def _uses_the_given_generator(subject: Subject) -> None:
    require_own_generator(
        lambda name: method_trial(subject, name, {"steps": SHORT}),
        SHORT,
        "Pass the generator of build_model to all random numbers; make layers with "
        "torch.nn.init on values drawn from it.",
    )


def _one_gaussian(subject: Subject) -> None:
    if subject.data is not None:
        raise NotApplicable("the data set has its own points")
    watch = TableWatch()
    try:
        run = method_trial(
            subject, "one", {"steps": SHORT, "datamanager.points": 1, "init": "points"}
        )
        trainer = run.trainer([watch])
    except ConfigError as refusal:
        raise NotApplicable(f"it is refused: {refusal.message}") from refusal
    watched(trainer, watch)


def _runs_with(strategy: str, subject: Subject) -> None:
    watch = TableWatch()
    changes = {"strategy": strategy, "steps": EDITED}
    try:
        trainer = method_trial(subject, f"with-{strategy}", changes).trainer([watch])
    except ConfigError as refusal:
        raise NotApplicable(f"it is refused: {refusal.message}") from refusal
    watched(trainer, watch)


def _resolution_schedule(subject: Subject) -> None:
    watch = TableWatch()
    changes = {"steps": 2 * SHORT, "resolution_schedule": "auto", "resolution_steps": SHORT}
    if subject.data is None:
        changes |= {"datamanager.width": 2 * MIN_SIDE, "datamanager.height": 2 * MIN_SIDE}
    try:
        trainer = method_trial(subject, "coarse", changes).trainer([watch])
    except ConfigError as refusal:
        raise NotApplicable(f"it is refused: {refusal.message}") from refusal
    # The measured schedule of a run this short is at full size from its first step.
    coarse = ResolutionSchedule(((0, 2.0), (SHORT, 1.0)))
    trainer.plan = replace(trainer.plan, resolution=coarse)
    watched(trainer, watch)


def _times_are_honoured(subject: Subject) -> None:
    trainer, _, _ = trained(subject)
    parts = trainer.parts
    if not parts.data.scene.is_dynamic:
        still = [flat(splats_at(parts.model, time)) for time in (None, *TIMES)]
        found = next(filter(None, (difference(still[0], other) for other in still[1:])), "")
        require(not found, f"in a static scene, {found} at another time.", "Ignore the time.")
        return
    moved = [flat(splats_at(parts.model, time)) for time in TIMES]
    require(
        any(difference(moved[0], other) for other in moved[1:]),
        f"after {STEPS} steps the splats are the same at the times {TIMES}.",
        "Let splats(time) depend on the time.",
    )
    again = difference(moved[0], flat(splats_at(parts.model, TIMES[0])))
    require(
        not again,
        f"at time 0 again, after other times, {again}.",
        "splats(time) must not depend on earlier calls: keep no state of a batch in the model.",
    )
    first = difference(moved[0], flat(splats_at(parts.model, None)))
    require(not first, f"without a time, {first} from time 0.", "None stands for the first time.")


def _view_dependence_is_declared(subject: Subject) -> None:
    trainer, _, _ = trained(subject)
    parts = trainer.parts
    if parts.model.depends_on_view:
        raise NotApplicable("it declares that they depend on the view")
    views = parts.data.views(Split.TRAIN).cameras
    for time in TIMES if parts.data.scene.is_dynamic else (None,):
        cameras = (*views[:2], views[-1])
        first, *others = (flat(splats_at(parts.model, time, camera)) for camera in cameras)
        found = next(filter(None, (difference(first, other) for other in others)), "")
        require(
            not found,
            f"asked for another camera, {found} (time {time}).",
            "Set depends_on_view = True in the model, so that each view gets its own splats; or "
            "let splats() ignore which cameras it is given.",
        )


def _model_file_renders_the_same(subject: Subject) -> None:
    trained(subject)
    run = method_trial(subject, "trained", {"checkpoint_every": HALF})
    restored = restore(RunFolder(run.folder), subject.registry)
    path = subject.workspace / "model.gsfw"
    try:
        ModelFileExporter().write(path, stored_model(restored))
    except ValueError as error:
        advice = "Keep the state of the model in columns, parameters and tensors as buffers."
        raise BrokenPromise(f"the model cannot be stored: {error}.", advice) from error
    again = rebuild(read_model_file(path), path, subject.registry).composition.parts.model
    model = restored.composition.parts.model
    for time in TIMES if restored.composition.scene.is_dynamic else (None,):
        found = difference(flat(splats_at(model, time)), flat(splats_at(again, time)))
        require(
            not found,
            f"after the model was read from its file, {found} (time {time}).",
            "splats() must depend only on the state_dict of the model, and build_model must give "
            "the same structure for any points.",
        )


def _export_renders_the_same(subject: Subject) -> None:
    trainer, _, _ = trained(subject)
    parts = trainer.parts
    decodes = type(parts.model).decode is not PrimitiveModel.decode
    before = with_sh(splats_at(parts.model, 0.0))
    if decodes or not isinstance(before.colors, Sh):
        raise NotApplicable(
            "its colours are computed after rendering, which no splat file can store"
        )
    taken = snapshot(parts.model, parts.data.scene, False, torch.tensor(0.0))
    path = subject.workspace / "splats.ply"
    PlyExporter().write(path, taken)
    frame = parts.data.scene.world_from_scene.inverse()
    after = transform_splats(PlyImporter().read(path).splats, frame)
    shade = (_image(before) - _image(after)).abs().max().item()
    require(
        shade <= SHADE and not taken.num_dropped,
        f"the image of the exported splats differs by {shade:.2g} (of 1), and {taken.num_dropped} "
        "rows were dropped.",
        "splats() must return activated values in the scene frame: opacities in [0, 1], standard "
        "deviations, wxyz.",
    )


@torch.no_grad()
def _image(splats: Splats) -> torch.Tensor:
    cameras = front_camera(dtype=torch.float64)
    exact = splats.map(lambda tensor: tensor.detach().cpu().double())
    return ReferenceRasterizer().render(exact, cameras).color[0]


def _settings_survive_config_yaml(subject: Subject) -> None:
    settings = method_trial(subject, "settings", {}).settings()
    path = subject.workspace / "config.yaml"
    path.write_text(write_config(settings, ["check"]), encoding="utf-8")
    again = resolve(subject.registry, [read_config(path, everything=True)])
    paths = dict.fromkeys(("out", *PLACES), "")  # Absolute in the file; not those of the method.
    found = difference({**settings.flat(), **paths}, {**again.flat(), **paths})
    require(not found, f"read from config.yaml, {found}.", "Use plain types for settings.")


def _presets_resolve(subject: Subject) -> None:
    kind: type[MethodConfig] = subject.target
    for preset in kind.presets:
        run = method_trial(subject, "preset", {})
        given = {key: value for key, value in run.values.items() if not key.startswith("steps")}
        try:
            layer = Layer("the settings of the check", {**given, "preset": preset})
            resolve(subject.registry, [layer]).config.check()
        except ConfigError as error:
            require(
                False,
                f"preset={preset} is refused: {error.message}",
                "Correct its keys and values.",
            )


PROMISES = (
    Promise("learns", "Its loss falls in a few steps.", _learns),
    Promise(
        "resumes-to-the-same-bits",
        "A resumed run ends with the same bits as an uninterrupted one.",
        _resumes,
    ),
    Promise(
        "uses-the-given-generator",
        "Random numbers come only from the given generators.",
        _uses_the_given_generator,
    ),
    Promise(
        "is-evaluated-as-restored",
        "Evaluations of a run see the splats of its restored checkpoint, without training noise.",
        _is_evaluated_as_restored,
    ),
    Promise(
        "times-are-honoured",
        "Splats depend on the time in moving scenes only, and never on earlier calls.",
        _times_are_honoured,
    ),
    Promise(
        "view-dependence-is-declared",
        "Splats are the same for all cameras, unless the model says that they depend on the view.",
        _view_dependence_is_declared,
    ),
    *EDITS,
    *(
        Promise(
            f"runs-with-{strategy}",
            f"It trains with strategy {strategy}, with valid rows after each step, or is refused "
            "with a message.",
            partial(_runs_with, strategy),
        )
        for strategy in STRATEGIES
    ),
    Promise(
        "runs-at-lower-resolution",
        "It trains with resolution_schedule=auto, or is refused with a message.",
        _resolution_schedule,
    ),
    Promise("one-gaussian", "It trains from one Gaussian.", _one_gaussian),
    Promise(
        "model-file-renders-the-same",
        "Its model renders the same from a model file, without the data set.",
        _model_file_renders_the_same,
    ),
    Promise(
        "export-renders-the-same",
        "An exported splat file renders the same image.",
        _export_renders_the_same,
    ),
    Promise(
        "settings-survive-config-yaml",
        "All settings of a run are the same when its config.yaml is read.",
        _settings_survive_config_yaml,
    ),
    Promise("presets-resolve", "Every preset has valid keys and values.", _presets_resolve),
)
