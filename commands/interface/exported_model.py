"""Exported model: the model that ``gsfw export`` writes into a model file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Exporter, ExportSource, StoredModel
from gsfw.core.progress import stage
from gsfw.formats.model_file import ModelFileExporter

if TYPE_CHECKING:
    from gsfw.commands.interface.runs import RunArgument
    from gsfw.plugins.fine_tuning import Effect
    from gsfw.plugins.restore import Restored


def check_finetune(steps: int, found: RunArgument, exporter: Exporter) -> None:
    """Check, before a run is opened, that it can be fine-tuned for a file.

    Raises:
        ConfigError: files of the format are not rounded in steps, or there is no run.
    """
    if steps and not (isinstance(exporter, ModelFileExporter) and exporter.is_compressed):
        raise ConfigError(
            f"finetune={steps}: fine-tuning is for compressed model files.",
            "Add format=gsfw format.precision=compressed, or leave finetune out.",
        )
    if steps and found.model_file is not None:
        raise ConfigError(
            f"finetune={steps}: {found.name} is a model file, without optimizer and images.",
            "Give the folder of the run that it was exported from.",
        )


def check_model(found: RunArgument, exporter: Exporter) -> None:
    """Refuse to write a model file again as it is.

    Raises:
        ConfigError: it would be.
    """
    if found.model_file is not None and exporter == type(exporter)():
        raise ConfigError(
            f"{found.name} is a model file already.",
            "Copy it, or write a smaller one: format.precision=compressed out=small.gsfw",
        )


@dataclass(frozen=True)
class ExportedModel:
    """A model to be written."""

    model: StoredModel
    source: ExportSource
    """Source of the model for its exporter."""
    effect: Effect | None = None
    """Figures of the fine-tuning; ``None`` if there was none."""

    def lines(self) -> tuple[str, ...]:
        """The effect of the fine-tuning, in words."""
        if self.effect is None:
            return ()
        usual, rounded, tuned = self.effect.usual, self.effect.rounded, self.effect.fine_tuned
        if usual is None or rounded is None or tuned is None:
            return ("no views are held out: what fine-tuning has changed was not measured",)
        return (
            f"PSNR of the held-out views: {usual:.2f} dB as trained, {rounded:.2f} dB rounded, "
            f"{tuned:.2f} dB rounded after fine-tuning",
        )

    def document(self) -> dict[str, Any]:
        """The same as plain data, and the number of Gaussians."""
        psnr = {} if self.effect is None else {"psnr": asdict(self.effect)}
        return {"num_gaussians": self.model.rows, **psnr}


def exported_model(restored: Restored, exporter: Exporter, finetune: int) -> ExportedModel:
    """The model of a run, fine-tuned for its file if that is wanted.

    Args:
        restored: the run; fine-tuning changes its model.
        exporter: writes the file.
        finetune: steps for the rounding of the file, checked by ``check_finetune``; 0 for none.

    Raises:
        ConfigError: the file of this model has no steps, or the method cannot train on.
        ValueError: it has state that is no tensor; names it.
    """
    from gsfw.plugins.run_source import RunSource

    source = RunSource(restored)
    if finetune:
        return _fine_tuned(restored, source, exporter, finetune)
    return ExportedModel(source.stored_model(), source)


def _fine_tuned(
    restored: Restored, source: ExportSource, exporter: Exporter, steps: int
) -> ExportedModel:
    """Train a run on for the rounding of its file."""
    from gsfw.formats.compact.rounding import Rounding
    from gsfw.plugins.fine_tuning import fine_tune

    assert isinstance(exporter, ModelFileExporter)
    model = source.stored_model()
    with stage("measuring what each Gaussian adds to the training views"):
        contributions = source.contributions()
    rounding = Rounding.of(model, exporter.step, contributions)
    if rounding is None:
        raise ConfigError(
            f"finetune={steps}: a file of method {model.method} is not rounded in steps.",
            "Leave finetune out.",
        )
    effect = fine_tune(restored, steps, rounding)
    trained = source.stored_model()
    written = rounding.with_steps(replace(trained, step=trained.step + steps))
    return ExportedModel(written.model, written, effect)
