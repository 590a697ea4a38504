"""Jobs of temporal fields: the structures of sources/field_stages.h, and its constants."""

from __future__ import annotations

import ctypes
from typing import ClassVar

from gsfw.kernels.cuda.jobs import DOUBLE, INT, INT64, POINTER
from gsfw.kernels.cuda.source_files import constant

PLANE_THREADS = constant("field_stages.h", "PLANE_THREADS")
PLANE_LEVELS = constant("field_stages.h", "PLANE_LEVELS")
GRID_THREADS = constant("field_stages.h", "GRID_THREADS")
GRID_NUMBERS = constant("field_stages.h", "GRID_NUMBERS")
SLICE_THREADS = constant("field_stages.h", "SLICE_THREADS")
HASH_THREADS = constant("field_stages.h", "HASH_THREADS")
HASH_LEVELS = constant("field_stages.h", "HASH_LEVELS")


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


class GridNumbers(ctypes.Structure):
    """Numbers of a grid that is penalised."""

    _fields_: ClassVar = [
        ("values", POINTER),
        ("count", INT64),
        ("sums", POINTER),
        ("arriving", POINTER),
        ("gradient", POINTER),
    ]


class GridAxis(ctypes.Structure):
    """An axis along which neighbours are compared."""

    _fields_: ClassVar = [("cells", INT), ("stride", INT), ("weight", DOUBLE)]


class GridVariationJob(ctypes.Structure):
    """Arguments of ``grid_variation`` and ``grid_variation_backward``."""

    _fields_: ClassVar = [
        ("grid", GridNumbers),
        ("first", GridAxis),
        ("second", GridAxis),
        ("order", INT),
        ("unused", INT),
    ]


class GridDistanceJob(ctypes.Structure):
    """Arguments of ``grid_distance`` and ``grid_distance_backward``."""

    _fields_: ClassVar = [("grid", GridNumbers), ("center", DOUBLE), ("weight", DOUBLE)]


class PenaltyJob(ctypes.Structure):
    """Arguments of ``add_penalty``."""

    _fields_: ClassVar = [("sums", POINTER), ("blocks", INT64), ("value", POINTER)]


class SliceJob(ctypes.Structure):
    """Arguments of ``slice``."""

    _fields_: ClassVar = [
        ("left", POINTER),
        ("right", POINTER),
        ("scales", POINTER),
        ("count", INT64),
        ("covariances", POINTER),
        ("velocities", POINTER),
        ("variances", POINTER),
    ]


class SliceBackwardJob(ctypes.Structure):
    """Arguments of ``slice_backward``."""

    _fields_: ClassVar = [
        ("forward", SliceJob),
        ("covariances", POINTER),
        ("velocities", POINTER),
        ("variances", POINTER),
        ("left", POINTER),
        ("right", POINTER),
        ("scales", POINTER),
    ]


class HashLevel(ctypes.Structure):
    """A table of a hash grid."""

    _fields_: ClassVar = [
        ("table", POINTER),
        ("rows", INT64),
        ("side", INT),
        ("times", INT),
        ("dense", INT),
        ("unused", INT),
    ]


class HashJob(ctypes.Structure):
    """Arguments of ``hash_features``."""

    _fields_: ClassVar = [
        ("levels", HashLevel * HASH_LEVELS),
        ("places", POINTER),
        ("time", POINTER),
        ("count", INT64),
        ("level_count", INT),
        ("channels", INT),
        ("features", POINTER),
    ]


class HashBackwardJob(ctypes.Structure):
    """Arguments of ``hash_features_backward``."""

    _fields_: ClassVar = [
        ("forward", HashJob),
        ("gradient", POINTER),
        ("tables", POINTER * HASH_LEVELS),
    ]
