"""Callback wandb: curves, held-out images and settings of a run, in Weights & Biases."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal

from gsfw.api import Callback, CallbackConfig, ConfigError, number, write_atomically

RUN_ID = "wandb_run_id.txt"
"""File in the run's folder: a resumed run continues its curves."""


@dataclass
class WandbConfig(CallbackConfig):
    """Weights & Biases."""

    enabled: bool = False
    """True to use the callback."""
    mode: Literal["online", "offline"] = "online"
    """online needs an account (wandb login); offline writes files, which wandb sync sends later."""
    project: str = "gsfw"
    """Project of the run."""
    name: str = ""
    """Name of the run. Empty: that of its folder."""
    images: int = number(4, at_least=0)
    """Held-out views shown at each evaluation, beside their photos."""

    def build(self):
        return Wandb(self)

    def check(self):
        if find_spec("wandb") is None:
            raise ConfigError(
                "callbacks.wandb.enabled=true: the package wandb is not installed.",
                "Install it with pip install wandb, or leave out callbacks.wandb.enabled.",
            )


class Wandb(Callback):
    """Curves have the names of gsfw's TensorBoard where both have them."""

    def __init__(self, config):
        self.config, self.run, self.shown = config, None, {}

    def on_start(self, run, control):
        import wandb

        file = run.folder / RUN_ID
        known = file.read_text().strip() if run.first_step > 0 and file.is_file() else ""
        self.run = wandb.init(
            project=self.config.project,
            name=self.config.name or run.folder.name,
            mode=self.config.mode,
            dir=os.fspath(run.folder),
            config={"method": run.method, "scene": run.scene, **run.settings},
            id=known or None,
            resume="allow",
        )
        write_atomically(file, self.run.id.encode())

    def on_step(self, report, control):
        figures = {
            "loss/total": report.loss,
            **{f"loss/{name}": value for name, value in report.losses.items()},
            **{f"method/{name}": value for name, value in report.metrics.items()},
            "train/psnr": report.psnr,
            "gaussians": report.num_gaussians,
            "step_ms": report.step_ms,
            **{f"lr/{name}": value for name, value in report.learning_rates.items()},
            **{f"memory_mb/{name}": value for name, value in report.memory_mb.items()},
            **{f"refined/{name}": value for name, value in report.refined.items()},
        }
        self.run.log(figures, step=report.step)

    def on_view(self, step, view):
        import torch
        import wandb

        if len(self.shown) >= self.config.images:
            return
        panels = [view.target, view.rendered, *view.images.values()]
        same = [panel.cpu() for panel in panels if panel.shape == view.target.shape]
        pixels = torch.cat(same, dim=1).clamp(0, 1).mul(255).byte().numpy()
        caption = ", ".join(["photo", "render", *view.images])
        self.shown[f"view/{view.name}"] = wandb.Image(pixels, caption=caption)

    def on_evaluation(self, step, evaluation, control):
        figures = {f"eval/{name}": value for name, value in evaluation.means.items()}
        self.run.log({**figures, **self.shown}, step=step)
        self.shown = {}

    def on_end(self, step, summary):
        plain = {k: v for k, v in summary.items() if isinstance(v, int | float | str)}
        self.run.summary.update(plain)

    def close(self):
        if self.run is not None:
            self.run.finish()
