"""HParams page of TensorBoard: the settings of runs beside their final figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData
from torch.utils.tensorboard.summary import hparams

FIRST = ("method", "scene", "seed", "steps", "strategy")
"""Settings whose columns are shown first: TensorBoard shows five of more than a hundred."""


def hparam_events(
    settings: Mapping[str, Any], scene: str, figures: Mapping[str, float]
) -> list[Summary]:
    """The events of a run.

    Args:
        settings: by key.
        scene: name of the data.
        figures: the tags of curves, and their ends.
    """
    shown = {key: _hparam(value) for key, value in {**settings, "scene": scene}.items()}
    # SummaryWriter.add_hparams would open a second run beside this one.
    experiment, *others = hparams(shown, dict(figures))
    plugin = experiment.value[0].metadata.plugin_data
    data = HParamsPluginData.FromString(plugin.content)
    for info in data.experiment.hparam_infos:
        info.differs = info.name in FIRST  # TensorBoard puts these before the others.
    plugin.content = data.SerializeToString()
    return [experiment, *others]


def _hparam(value: object) -> int | float | str:
    """A setting as the page can hold it; torch would write truth as 1.0."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value
    return str(value)
