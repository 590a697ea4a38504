"""Opening: the data set of a run, at the image size of its settings or at another one."""

from __future__ import annotations

from gsfw.core.config import DataManagerConfig
from gsfw.core.datamanager import DataManager, DataRequest
from gsfw.core.files.mirror import MEGABYTE, local_place
from gsfw.core.hold_out import HoldOutBy
from gsfw.core.progress import stage
from gsfw.plugins.devices import find_device
from gsfw.plugins.memory_fit import usual_cache_mb
from gsfw.plugins.settings import Settings


def open_data(settings: Settings, downscale: float | None = None) -> DataManager:
    """Read the data set's cameras and points.

    Args:
        settings: the run.
        downscale: the factor by which images are shrunk; ``None`` for that of the run.

    Raises:
        DataError: the data cannot be used; names the cause and the place.
    """
    config = settings.config
    assert isinstance(config.datamanager, DataManagerConfig)
    most = config.data_cache_mb * MEGABYTE
    request = DataRequest(
        path=local_place(config.data, most) if config.data else None,
        downscale=config.downscale if downscale is None else downscale,
        eval_every_nth=config.holdout_every,
        eval_by=HoldOutBy(config.holdout_by),
        eval_names=config.holdout,
        cache_megabytes=usual_cache_mb(settings),
        gpu_cache_megabytes=config.gpu_cache_mb if find_device(config.device).type != "cpu" else 0,
    )
    with stage(f"reading {config.data or 'the built-in scene'}"):
        return config.datamanager.build(request)
