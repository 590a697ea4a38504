"""Merging: each block keeps the Gaussians whose centre is in its own cell; cells tile the ground.

Lin et al., VastGaussian (CVPR 2024), section 4.3. Positions are decided and kept in float64, in the
world of the data: what a block's float32 numbers say is not rounded again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.exchange import SplatFile
from gsfw.core.loop.memory import release_freed_memory
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.operators import Operators
from gsfw.core.splats import Splats
from gsfw.formats.model_file import ModelFileExporter
from gsfw.formats.ply import PlyExporter
from gsfw.partition.block_data import places_of
from gsfw.partition.document import Block, Partition
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.initial_splats import in_scene
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import Restored, restore
from gsfw.plugins.run_source import RunSource, is_dynamic
from gsfw.plugins.settings import COMMAND_LINE, Layer, Settings, resolve

PLY, MODEL = "merged.ply", "merged.gsfw"
"""Names of the files of a merged model."""
FEW = 64
"""Gaussians that the settings of a merged model are checked with."""


@dataclass(frozen=True)
class Merged:
    """A merged model."""

    content: SplatFile
    """In the world of the data, in float64."""
    rows: dict[str, int]
    """Number of Gaussians of each block."""
    step: int
    """Steps of the block with the fewest."""


def merge(partition: Partition, runs: Sequence[Path], registry: Registry) -> Merged:
    """Merge finished runs.

    Args:
        partition: says which cells the blocks have.
        runs: folders of the runs, in the order of the blocks.
        registry: the installed parts.

    Raises:
        ConfigError: the method moves.
        DataError: a run cannot be read, or no Gaussian lies in any cell.
    """
    parts, rows, steps = list[SplatFile](), dict[str, int](), list[int]()
    for block, path in zip(partition.blocks, runs, strict=True):
        part, step = _part(partition, block, path, registry)
        parts.append(part)
        rows[block.name] = len(part.splats)
        steps.append(step)
        release_freed_memory()
    full = [part for part in parts if len(part.splats)]
    if not full:
        raise DataError(
            f"{partition.path}: no Gaussian of any block lies in its cell.",
            "Train longer, or make the partition anew with fewer blocks.",
        )
    content = replace(full[0], splats=Splats.cat([part.splats for part in full]))
    return Merged(content, rows, min(steps))


def _part(
    partition: Partition, block: Block, path: Path, registry: Registry
) -> tuple[SplatFile, int]:
    """The splats of a block's own cell, and its step; the rest of its run is not kept in memory."""
    restored = restore(RunFolder(path), registry)
    return own_rows(run_splats(restored), partition, block), restored.step


def run_splats(restored: Restored) -> SplatFile:
    """The splats of a run, in the world of the data.

    Raises:
        ConfigError: the method moves.
    """
    composition = restored.composition
    if is_dynamic(composition):
        raise ConfigError(
            f"method {composition.settings.method.name} is for moving scenes, and blocks are "
            "merged as static models.",
            "Use a method for static scenes, such as method=3dgs.",
        )
    composition.parts.data.close()
    return RunSource(restored).splat_file()


def own_rows(content: SplatFile, partition: Partition, block: Block) -> SplatFile:
    """The splats whose centre lies in the cell of a block."""
    inside = block.cell.holds(places_of(content.splats.means, partition.ground))
    rows = torch.from_numpy(inside.nonzero()[0])
    return replace(content, splats=content.splats.take(rows))


def write_merged(merged: Merged, folder: Path, layer: Layer, registry: Registry) -> list[Path]:
    """Write the merged model as a PLY with exact positions, and as a model file; the paths.

    The model file has the cameras of the whole data set, and positions in float32 in its scene
    frame, as every model file. Neither needs the memory of training the whole.

    Args:
        merged: the model.
        folder: for the files.
        layer: settings of a run of the whole.
        registry: the installed parts.

    Raises:
        OutputError: a file cannot be written.
    """
    PlyExporter(positions="double").write(folder / PLY, merged.content)
    settings = whole_settings(layer, merged.content, registry)
    data = open_data(settings)
    try:
        initial = in_scene(merged.content, data.scene)
        # The optimizer of a composition has two moments for each number of its model.
        few = initial.take(torch.arange(min(FEW, len(initial))))
        composition = compose(settings, registry, data=data, initial=few)
        whole = _with_rows(composition, initial)
    finally:
        data.close()
    restored = Restored(RunFolder(folder), whole, {"step": merged.step})
    ModelFileExporter().write(folder / MODEL, RunSource(restored))
    return [folder / PLY, folder / MODEL]


def _with_rows(composition: Composition, initial: Splats) -> Composition:
    """The composition with a model of these splats, on the CPU; its optimizer has others."""
    parts, config = composition.parts, composition.settings.config
    method, scene = parts.method, parts.data.scene
    generator = torch.Generator().manual_seed(config.seed)
    model = method.build_model(scene, Operators(), generator, initial)
    method.begin(scene, parts.data.views(Split.TRAIN), model)
    return replace(composition, parts=replace(parts, model=model))


def whole_settings(layer: Layer, content: SplatFile, registry: Registry) -> Settings:
    """Settings of the merged model, which no strategy changes."""
    values = {key: value for key, value in layer.values.items() if not key.startswith("strategy.")}
    values |= {"strategy": "none", "sh_degree": content.splats.sh_degree}
    return resolve(registry, [Layer(COMMAND_LINE, values)])
