"""Recordable: the runs and the steps that may be recorded, and repeated as a graph."""

from __future__ import annotations

from collections.abc import Hashable

from gsfw.core.loop.training_parts import TrainingParts
from gsfw.core.method import Method
from gsfw.core.refiner import Refiner
from gsfw.core.team import Team


def graph_key(method: Method, step: int) -> Hashable | None:
    """``Method.graph_key``; ``None`` where a derived class has changed the steps it speaks of."""
    return method.graph_key(step) if promises(method) else None


def promises(method: Method) -> bool:
    """True if a method has a ``graph_key`` that speaks of its own steps."""
    order = type(method).__mro__
    place = _place_of("graph_key", order)
    promised = ("losses", "render_settings", "prepare", "build_model")
    return order[place] is not Method and all(_place_of(name, order) >= place for name in promised)


def can_be_recorded(refiner: Refiner, step: int) -> bool:
    """``Refiner.can_be_recorded``; false where a derived class has changed what it speaks of."""
    order = type(refiner).__mro__
    place = _place_of("can_be_recorded", order)
    if any(_place_of(name, order) < place for name in ("regularizers", "before_backward")):
        return False
    return refiner.can_be_recorded(step)


def _place_of(name: str, order: tuple[type, ...]) -> int:
    return next(place for place, kind in enumerate(order) if name in vars(kind))


def has_graphs(parts: TrainingParts) -> bool:
    """True if the steps of a run have only parts that a graph can have."""
    alone = type(parts.team) is Team and parts.rendered is None and parts.edited is None
    return parts.rasterizer.can_be_captured and alone and not parts.optimizer.sparse
