"""Partition: scenes that fit nowhere, cut into blocks that are trained alone and then merged."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_datamanagers() -> list[Spec]:
    """The data of a partition."""
    return [
        Spec(
            "blocks",
            "partition.json of gsfw partition: a data set, or one block of it",
            "gsfw.partition.block_data:BlocksConfig",
        )
    ]
