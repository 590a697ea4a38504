"""Restore: composes the run of a run folder again, with the state of a checkpoint."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gsfw.core.config import AUTO
from gsfw.core.errors import DataError
from gsfw.core.files.reading import is_there
from gsfw.core.files.remote import is_remote
from gsfw.core.hold_out import HoldOutBy
from gsfw.core.loop.checkpoint_file import fitting_state, read_checkpoint
from gsfw.core.loop.determinism import differences, environment
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.part_state import load_part
from gsfw.core.progress import stage
from gsfw.core.words import shell_argument
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.config_file import read_config
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import PLANNED_BY, Layer, Settings, resolve


@dataclass(frozen=True)
class Restored:
    """A run with the state of a checkpoint."""

    folder: RunFolder
    composition: Composition
    """Its model has the checkpoint's parameters; the other parts are in their initial state."""
    state: dict[str, Any]
    """The whole checkpoint, for ``Trainer.load_state_dict``."""

    @property
    def step(self) -> int:
        """Number of finished steps."""
        return int(self.state["step"])

    def changes(self) -> list[str]:
        """Differences from the machine of the checkpoint that may change bits."""
        parts = self.composition.parts
        now = environment(parts.device, parts.rasterizer.capabilities().details)
        with fitting_state(str(self.folder.path)):
            return differences(self.state["environment"], now)


def restore(
    folder: RunFolder,
    registry: Registry,
    checkpoint: Path | None = None,
    changed: Layer | None = None,
) -> Restored:
    """Compose a run again and load a checkpoint into it.

    Args:
        folder: folder of the run.
        registry: the installed parts.
        checkpoint: path of the checkpoint; ``None`` for the latest.
        changed: settings that replace the run's own.

    Raises:
        DataError: the folder is no run, has no checkpoint, or the data is gone.
        ConfigError: its settings no longer resolve (a plugin is missing).
    """
    if not folder.config.is_file():
        raise DataError(
            f"{folder.path} is not a run: it has no {folder.config.name}.",
            "Give the folder that gsfw train made, a checkpoint in it, or latest.",
        )
    checkpoint = checkpoint or folder.latest_checkpoint()
    if checkpoint is None:
        raise DataError(
            f"{folder.path} has no checkpoint.", "Begin it again with its gsfw train command."
        )
    saved = read_config(folder.config, everything=True)
    # Runs of before there was this setting held out every n-th image by name.
    saved = replace(saved, values={"holdout_by": HoldOutBy.NAME.value, **saved.values})
    if changed is not None and "steps" in changed.values:
        # The schedules do not change with the new length, which takes the place of a time.
        kept = {key: value for key, value in saved.values.items() if key not in PLANNED_BY}
        saved = replace(saved, values=kept, given=None)
    layers = [saved] if changed is None else [saved, _with_rasterizer(changed, saved, registry)]
    settings = resolve(registry, layers)
    _check_data(settings, folder, changed)
    # Into host memory; only the required tensors are copied to a GPU.
    with stage("reading the checkpoint"):
        state = read_checkpoint(checkpoint)
    composition = replace(compose(settings, registry, restoring=True), settings=settings)
    with fitting_state(str(folder.path)):
        load_part(composition.parts.model, state["model"])
        composition.parts.corrections.load_state(state)
    return Restored(folder, composition, state)


def _check_data(settings: Settings, folder: RunFolder, changed: Layer | None) -> None:
    """Refuse to continue without the data set, unless the user gave a new place.

    Raises:
        DataError: the data set is not at its place of the training.
    """
    data = settings.config.data
    given = changed is not None and "data" in changed.values
    if given or not is_gone(data):
        return
    model = folder.path / "model.gsfw"
    shown = model if model.is_file() else folder.splats
    alone = (
        f" Or look at the splats without it: gsfw view {shell_argument(shown)}."
        if shown.is_file()
        else ""
    )
    raise DataError(
        f"{folder.path} was trained on {data}, and there is no such file or folder any more.",
        f"Say where the data set is now: data=PATH.{alone}",
    )


def is_gone(data: str) -> bool:
    """True if the data set of a run was at a place on this machine where there is nothing now."""
    return bool(data) and not is_remote(data) and not is_there(Path(data))


def _with_rasterizer(changed: Layer, saved: Layer, registry: Registry) -> Layer:
    """Let a run choose another rasterizer if its own does not run on the new device."""
    if "device" not in changed.values or "rasterizer" in changed.values:
        return changed
    able = rasterizer_capabilities(registry).get(str(saved.values.get("rasterizer")))
    kind = str(changed.values["device"]).partition(":")[0]
    if able is not None and not able.unavailable and kind in able.devices:
        return changed
    return replace(changed, values={**changed.values, "rasterizer": AUTO})
