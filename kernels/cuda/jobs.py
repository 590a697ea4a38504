"""Jobs: the structures of sources/stages.h, field by field."""

from __future__ import annotations

import ctypes
from typing import ClassVar

POINTER, INT, INT64, DOUBLE = ctypes.c_void_p, ctypes.c_int, ctypes.c_int64, ctypes.c_double


class Grid(ctypes.Structure):
    """The image and its tiles."""

    _fields_: ClassVar = [("width", INT), ("height", INT), ("columns", INT), ("rows", INT)]


class View(ctypes.Structure):
    """One camera and the conventions of a render."""

    _fields_: ClassVar = [
        ("world_to_camera", POINTER),
        ("intrinsics", POINTER),
        ("jacobian_margin", DOUBLE),
        ("dilation", DOUBLE),
        ("compensation_min", DOUBLE),
        ("alpha_min", DOUBLE),
        ("near", DOUBLE),
        ("far", DOUBLE),
        ("length_max", DOUBLE),
        ("quaternion_min_norm", DOUBLE),
        ("model", INT),
        ("antialias", INT),
    ]


class SplatArrays(ctypes.Structure):
    """Splats."""

    _fields_: ClassVar = [
        ("count", INT64),
        ("means", POINTER),
        ("quats", POINTER),
        ("scales", POINTER),
        ("covariances", POINTER),
        ("opacities", POINTER),
        ("colors", POINTER),
        ("rest", POINTER),
        ("offsets", POINTER),
        ("rest_rows", INT64),
        ("extra", POINTER),
        ("color_stride", INT),
        ("rest_stride", INT),
        ("extras", INT),
        ("color_channels", INT),
        ("depth_channels", INT),
        ("unused", INT),
    ]


class SplatGradients(ctypes.Structure):
    """Addresses of the gradients of splats."""

    _fields_: ClassVar = [
        ("means", POINTER),
        ("quats", POINTER),
        ("scales", POINTER),
        ("covariances", POINTER),
        ("opacities", POINTER),
        ("colors", POINTER),
        ("rest", POINTER),
        ("extra", POINTER),
    ]


class ProjectJob(ctypes.Structure):
    """Arguments of ``project``."""

    _fields_: ClassVar = [
        ("view", View),
        ("splats", SplatArrays),
        ("grid", Grid),
        ("level_min", DOUBLE),
        ("bounded", INT),
        ("stride", INT),
        ("projected", POINTER),
        ("depth_keys", POINTER),
        ("tile_counts", POINTER),
        ("visible", POINTER),
        ("radii", POINTER),
    ]


class CountsJob(ctypes.Structure):
    """Arguments of ``sum_counts``."""

    _fields_: ClassVar = [
        ("order", POINTER),
        ("count", INT64),
        ("tile_counts", POINTER),
        ("ends", POINTER),
        ("row_ends", POINTER),
        ("pairs", POINTER),
        ("next", POINTER),
        ("words", POINTER),
    ]


class EmitJob(ctypes.Structure):
    """Arguments of ``emit``."""

    _fields_: ClassVar = [
        ("grid", Grid),
        ("bounded", INT),
        ("stride", INT),
        ("projected", POINTER),
        ("order", POINTER),
        ("count", INT64),
        ("tile_counts", POINTER),
        ("ends", POINTER),
        ("tiles", POINTER),
        ("payload", POINTER),
        ("rows", POINTER),
        ("room", INT64),
        ("numbered", INT),
        ("unused", INT),
    ]


class TilesJob(ctypes.Structure):
    """Arguments of ``find_tiles``."""

    _fields_: ClassVar = [
        ("tiles", POINTER),
        ("count", INT64),
        ("counted", POINTER),
        ("num_tiles", INT),
        ("chunk", INT),
        ("starts", POINTER),
        ("chunk_starts", POINTER),
        ("chunk_tiles", POINTER),
        ("chunks", INT64),
        ("next", POINTER),
        ("words", POINTER),
    ]


class BlendJob(ctypes.Structure):
    """Arguments of ``blend``."""

    _fields_: ClassVar = [
        ("grid", Grid),
        ("level_min", DOUBLE),
        ("alpha_cap", DOUBLE),
        ("alpha_limit", DOUBLE),
        ("transmittance_min", DOUBLE),
        ("projected", POINTER),
        ("stride", INT),
        ("channels", INT),
        ("bounded", INT),
        ("unused", INT),
        ("rows", POINTER),
        ("tile_starts", POINTER),
        ("chunk_starts", POINTER),
        ("background", POINTER),
        ("image", POINTER),
        ("alpha", POINTER),
        ("left", POINTER),
        ("seen", POINTER),
        ("checkpoints", POINTER),
        ("chunk_tiles", POINTER),
        ("contribution", POINTER),
        ("pixel_weights", POINTER),
        ("slots", POINTER),
    ]


class BlendBackwardJob(ctypes.Structure):
    """Arguments of ``blend_backward``."""

    _fields_: ClassVar = [
        ("forward", BlendJob),
        ("image_gradient", POINTER),
        ("alpha_gradient", POINTER),
        ("chunks", INT64),
        ("sums", POINTER),
        ("sum_stride", INT),
        ("unused", INT),
    ]


class ProjectBackwardJob(ctypes.Structure):
    """Arguments of ``project_backward``."""

    _fields_: ClassVar = [
        ("forward", ProjectJob),
        ("sums", POINTER),
        ("sum_stride", INT),
        ("channels", INT),
        ("slot_ends", POINTER),
        ("gradients", SplatGradients),
        ("screen_gradient", POINTER),
        ("absgrad", POINTER),
        ("pose", POINTER),
        ("accumulate", INT),
        ("unused", INT),
    ]
