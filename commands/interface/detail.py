"""Detail: a run or a tree of levels of detail, drawn within a budget and a bound of memory."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.core.errors import ConfigError
from gsfw.core.progress import stage
from gsfw.core.words import size

if TYPE_CHECKING:
    from gsfw.commands.interface.runs import RunArgument
    from gsfw.core.model import PrimitiveModel
    from gsfw.lod.cut import Limits
    from gsfw.lod.nodes import Tree
    from gsfw.plugins.registry import Registry
    from gsfw.plugins.restore import Restored
    from gsfw.plugins.settings import Layer

MEMORY = 512_000_000
"""Bytes for the Gaussians of a tree in a file, unless a bound is given."""
LEAST_CHUNKS = 8_000_000
"""Bytes of chunks below which a tree would be read again and again."""
CANDIDATES = 512
"""Bytes that the choice of a cut takes for each of its Gaussians."""
COARSE = 4096
"""Most nodes that stand for a tree where there is no view."""
VIEWS = 24
"""Views whose cut stands for a run where there is no view, as in a file."""
UNITS = {"MB": 1_000_000, "GB": 1_000_000_000}


@dataclass(frozen=True)
class Detail:
    """The limits of what is drawn of a model in a view."""

    budget: str = ""
    """Most Gaussians, or megabytes of them; empty: all of a run, as many as fit of a tree."""
    pixels: float = 0.0
    """Size in pixels below which detail is left out; 0: none is."""
    memory: int = MEMORY
    """Bytes for the Gaussians of a tree in a file, and for what is held of it."""

    @staticmethod
    def parse(budget: str, pixels: float, memory: str) -> Detail:
        """Read the options of a verb.

        Raises:
            ConfigError: one is no number, or out of range.
        """
        from gsfw.core.refinement.budget import BudgetSize

        if budget and BudgetSize.amount(budget) is None:
            raise ConfigError(
                f"budget={budget}: expected a number of Gaussians such as 200000, or megabytes "
                "such as 200MB."
            )
        found = re.fullmatch(r"(\d+(?:\.\d+)?)(MB|GB)", memory)
        if memory and (found is None or not float(found[1])):
            raise ConfigError(f"memory={memory}: expected an amount such as 512MB or 2GB.")
        bound = int(float(found[1]) * UNITS[found[2]]) if found else MEMORY
        return Detail(budget, pixels, bound)

    @property
    def is_given(self) -> bool:
        """True if less than a whole model may be drawn."""
        return bool(self.budget or self.pixels)

    @property
    def suffix(self) -> str:
        """Addition to the names of files of results, such as "_budget_200000"."""
        budget = f"_budget_{self.budget}" if self.budget else ""
        return budget + (f"_detail_{self.pixels:g}" if self.pixels else "")

    def limits(self, tree: Tree, fitting: int) -> Limits:
        """The limits of a cut; without a budget, as many Gaussians as fit."""
        from gsfw.core.refinement.budget import BudgetSize
        from gsfw.lod.cut import Limits

        amount = BudgetSize.amount(self.budget)
        if amount is None:
            return Limits(max(fitting, 1), self.pixels)
        most = amount.rows or int((amount.num_bytes or 0) / tree.splat_bytes)
        return Limits(max(min(most, tree.count), 1), self.pixels)


def within_budget(restored: Restored, detail: Detail) -> Restored:
    """A run that is drawn as cuts of a tree of its model, which is built here.

    Raises:
        ConfigError: the model moves, has other splats for each view, or has no SH colours.
    """
    from gsfw.core.datamanager import Split, spread
    from gsfw.core.maths.frame import with_axes
    from gsfw.core.splats import Sh
    from gsfw.lod.build import build
    from gsfw.lod.model import LodModel
    from gsfw.plugins.run_source import is_dynamic

    parts = restored.composition.parts
    if is_dynamic(restored.composition):
        raise ConfigError(
            "budget: levels of detail need a static model, and this one moves.",
            "Leave budget and detail out; or draw one time of it: gsfw export RUN format=lod "
            "time=0.5",
        )
    if parts.model.depends_on_view:
        raise ConfigError(
            "budget: a tree of levels of detail has one set of splats, and those of this model "
            "depend on the view.",
            "Leave budget and detail out.",
        )
    splats = with_axes(parts.model.splats().map(lambda tensor: tensor.detach()).to("cpu"))
    if not isinstance(splats.colors, Sh):
        raise ConfigError(
            "budget: this model renders features, which levels of detail cannot represent.",
            "Leave budget and detail out.",
        )
    with stage("building the levels of detail"):
        tree = build(splats)
    cameras = parts.data.views(Split.TRAIN).cameras
    views = [cameras[n] for n in spread(range(len(cameras)), VIEWS)]
    model = LodModel(parts.model, tree, detail.limits(tree, tree.count), views=views or None)
    return _drawn_as(restored, model)


def open_tree(path: Path, registry: Registry, changed: Layer | None, detail: Detail) -> Restored:
    """A run whose model is a tree in a file, of which views read what they need.

    Raises:
        ConfigError: the budget does not fit into the memory.
        DataError: the file is damaged.
    """
    import torch

    from gsfw.core.maths.frame import transform_splats
    from gsfw.core.maths.similarity import Similarity
    from gsfw.lod.cut import Limits, select
    from gsfw.lod.file import TreeFile
    from gsfw.lod.importer import splat_file, world_from_tree
    from gsfw.lod.model import LodModel
    from gsfw.plugins.splat_run import run_of_splats

    tree = TreeFile(path, detail.memory)
    each = tree.node_bytes + 2 * tree.splat_bytes + CANDIDATES
    fitting = (detail.memory - LEAST_CHUNKS) // each
    limits = detail.limits(tree, min(fitting // 2, tree.count))
    if limits.most > fitting:
        needed = limits.most * each + LEAST_CHUNKS
        raise ConfigError(
            f"memory={size(detail.memory)}: {limits.most:,} Gaussians of {path} need "
            f"{size(needed)}.",
            f"Give memory={needed // 1_000_000 + 1}MB, or a smaller budget.",
        )
    tree.memory = detail.memory - limits.most * each
    world = world_from_tree(tree.header)
    coarse = tree.nodes(select(tree, None, Limits(min(COARSE, limits.most)))).splats()
    content = splat_file(transform_splats(coarse, world), tree.header)
    restored = run_of_splats(content, path, registry, changed)
    scene = restored.composition.scene.world_from_scene
    origin = torch.tensor(tree.header.origin, dtype=torch.float64)
    frame = Similarity(scene.scale, scene.rotation, scene.translation - origin)
    return _drawn_as(restored, LodModel(restored.composition.parts.model, tree, limits, frame))


def is_tree_file(found: RunArgument) -> bool:
    """True if the argument is a tree of levels of detail."""
    from gsfw.lod.file import is_tree

    return found.splat_file is not None and is_tree(found.splat_file)


def _drawn_as(restored: Restored, model: PrimitiveModel) -> Restored:
    """The run with another model to draw."""
    parts = replace(restored.composition.parts, model=model)
    return replace(restored, composition=replace(restored.composition, parts=parts))
