"""Jobs of temporal fields: the structures of sources/field_stages.h, and its constants."""

from __future__ import annotations

import ctypes
from typing import ClassVar

from gsfw.kernels.cuda.jobs import DOUBLE, INT, INT64, POINTER
from gsfw.kernels.cuda.source_files import constant

PLANE_THREADS = constant("field_stages.h", "PLANE_THREADS")
PLANE_LEVELS = constant("field_stages.h", "PLANE_LEVELS")


class PlaneLevel(ctypes.Structure):
    """Planes of one resolution."""

    _fields_: ClassVar = [
        ("planes", POINTER),
        ("lines", POINTER),
        ("side", INT),
        ("unused", INT),
    ]


class PlaneProductJob(ctypes.Structure):
    """Arguments of ``plane_product``."""

    _fields_: ClassVar = [
        ("levels", PlaneLevel * PLANE_LEVELS),
        ("places", POINTER),
        ("count", INT64),
        ("scale", DOUBLE),
        ("level_count", INT),
        ("channels", INT),
        ("features", POINTER),
    ]


class PlaneGradients(ctypes.Structure):
    """Gradients of the planes of one resolution."""

    _fields_: ClassVar = [("planes", POINTER), ("lines", POINTER)]


class PlaneProductBackwardJob(ctypes.Structure):
    """Arguments of ``plane_product_backward``."""

    _fields_: ClassVar = [
        ("forward", PlaneProductJob),
        ("levels", PlaneGradients * PLANE_LEVELS),
        ("gradient", POINTER),
        ("places", POINTER),
    ]
