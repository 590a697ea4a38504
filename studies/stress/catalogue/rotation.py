"""Rotation: quaternions of no norm, of almost none, and of far too much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gsfw.core.splats import Splats
from gsfw.studies.stress.case import Change, Drawing, StressCase
from gsfw.studies.stress.catalogue.variants import EVERYTHING, SIZE, ordinary, splat_cases
from gsfw.studies.stress.scene import front_camera


def with_quats(*quat: float) -> Change:
    """All splats turned by one quaternion."""
    return lambda splats: replace(
        splats, quats=splats.means.new_tensor([quat]).repeat(len(splats), 1)
    )


def times(factor: float) -> Change:
    """Quaternions as they are, but for their norms."""

    def change(splats: Splats) -> Splats:
        assert splats.quats is not None
        return replace(splats, quats=splats.quats * factor)

    return change


CHANGES: dict[str, Change] = {
    "rotation/zero": with_quats(0.0, 0.0, 0.0, 0.0),
    "rotation/norm-1e-20": with_quats(1e-20, 2e-20, 0.0, 0.0),
    "rotation/norm-1e-11": with_quats(1e-11, 2e-11, 0.0, 0.0),
    "rotation/norm-1e20": with_quats(1e20, 2e20, -1e20, 0.0),
    "rotation/norm-1e37": with_quats(1e37, 2e37, -1e37, 3e37),
    "rotation/norm-100": times(100.0),
    "rotation/antipodal": times(-1.0),
}

REASONS: dict[str, str] = {}


def _with_norms(factors: Sequence[float]) -> Drawing:
    splats = ordinary()
    assert splats.quats is not None
    norms = splats.means.new_tensor(factors).repeat(len(splats))[: len(splats), None]
    return Drawing(replace(splats, quats=splats.quats * norms), front_camera(*SIZE), EVERYTHING)


ROTATION = (
    *splat_cases(CHANGES, REASONS),
    StressCase("rotation/mixed-norms", lambda: _with_norms([1e-11, 1e-3, 1.0, 1e3, 1e20])),
)
"""All cases of this section."""
