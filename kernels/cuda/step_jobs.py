"""Jobs of a step: the structures of sources/step_stages.h, field by field, and its constants."""

from __future__ import annotations

import ctypes
from typing import ClassVar

from gsfw.kernels.cuda.jobs import DOUBLE, INT, INT64, POINTER
from gsfw.kernels.cuda.source_files import constant

SSIM_WIDTH = constant("step_stages.h", "SSIM_WIDTH")
SSIM_HEIGHT = constant("step_stages.h", "SSIM_HEIGHT")
SSIM_THREADS = constant("step_stages.h", "SSIM_THREADS")
SSIM_FLOWS = constant("step_stages.h", "SSIM_FLOWS")
SSIM_SUMS = constant("step_stages.h", "SSIM_SUMS")
ADAM_THREADS = constant("step_stages.h", "ADAM_THREADS")
ADAM_NUMBERS = constant("step_stages.h", "ADAM_NUMBERS")
ADAM_TABLES = constant("step_stages.h", "ADAM_TABLES")
FINITE_THREADS = constant("step_stages.h", "FINITE_THREADS")
FINITE_NUMBERS = constant("step_stages.h", "FINITE_NUMBERS")
FINITE_TENSORS = constant("step_stages.h", "FINITE_TENSORS")
NEIGHBOR_THREADS = constant("step_stages.h", "NEIGHBOR_THREADS")

WARP = constant("platform.h", "WARP")
"""Threads of the least block."""


class Comparison(ctypes.Structure):
    """Images that are compared."""

    _fields_: ClassVar = [
        ("rendered", POINTER),
        ("target", POINTER),
        ("valid", POINTER),
        ("images", INT),
        ("height", INT),
        ("width", INT),
        ("channels", INT),
    ]


class SsimJob(ctypes.Structure):
    """Arguments of ``ssim``."""

    _fields_: ClassVar = [("images", Comparison), ("flows", POINTER), ("sums", POINTER)]


class LossesJob(ctypes.Structure):
    """Arguments of ``add_losses``."""

    _fields_: ClassVar = [
        ("sums", POINTER),
        ("blocks", INT64),
        ("channels", INT64),
        ("l1", POINTER),
        ("dissimilarity", POINTER),
        ("share", POINTER),
    ]


class SsimBackwardJob(ctypes.Structure):
    """Arguments of ``ssim_backward``."""

    _fields_: ClassVar = [
        ("images", Comparison),
        ("flows", POINTER),
        ("share", POINTER),
        ("l1_gradient", POINTER),
        ("dissimilarity_gradient", POINTER),
        ("gradient", POINTER),
    ]


class AdamRows(ctypes.Structure):
    """Rows that may lie apart."""

    _fields_: ClassVar = [("numbers", POINTER), ("stride", INT64)]


class AdamTable(ctypes.Structure):
    """The update of one table of numbers in a step of Adam."""

    _fields_: ClassVar = [
        ("values", AdamRows),
        ("gradient", AdamRows),
        ("first", AdamRows),
        ("second", AdamRows),
        ("rows", POINTER),
        ("count", INT64),
        ("width", INT64),
        ("rate", DOUBLE),
        ("rate_at", POINTER),
        ("steps", POINTER),
        ("first_block", INT),
        ("whole", INT),
        ("aligned", INT),
        ("unused", INT),
    ]


class AdamJob(ctypes.Structure):
    """Arguments of ``begin_adam`` and ``adam``."""

    _fields_: ClassVar = [
        ("tables", AdamTable * ADAM_TABLES),
        ("beta1", DOUBLE),
        ("beta2", DOUBLE),
        ("epsilon", DOUBLE),
        ("gradient_limit", DOUBLE),
        ("finite", POINTER),
        ("scales", POINTER),
        ("count", INT),
        ("unused", INT),
    ]


class FiniteJob(ctypes.Structure):
    """Arguments of ``check_finite``."""

    _fields_: ClassVar = [
        ("numbers", POINTER * FINITE_TENSORS),
        ("counts", INT64 * FINITE_TENSORS),
        ("first_blocks", INT * FINITE_TENSORS),
        ("aligned", INT),
        ("unused", INT),
        ("finite", POINTER),
    ]


class NeighborsJob(ctypes.Structure):
    """Arguments of ``neighbors``."""

    _fields_: ClassVar = [
        ("points", POINTER),
        ("rows", POINTER),
        ("count", INT),
        ("wanted", INT),
        ("first", INT),
        ("end", INT),
    ]
