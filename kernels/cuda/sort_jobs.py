"""Sort jobs: the structures of sources/sort_stages.h, field by field."""

from __future__ import annotations

import ctypes
from typing import ClassVar

from gsfw.kernels.cuda.jobs import INT, INT64, POINTER


class DigitField(ctypes.Structure):
    """The digit that one pass sorts by."""

    _fields_: ClassVar = [("shift", INT), ("digits", INT)]


class DigitsJob(ctypes.Structure):
    """Of ``count_digits``."""

    _fields_: ClassVar = [
        ("keys", POINTER),
        ("count", INT64),
        ("field", DigitField),
        ("counts", POINTER),
    ]


class ScatterJob(ctypes.Structure):
    """Of ``scatter``."""

    _fields_: ClassVar = [
        ("keys", POINTER),
        ("payload", POINTER),
        ("count", INT64),
        ("field", DigitField),
        ("ends", POINTER),
        ("sorted_keys", POINTER),
        ("sorted_payload", POINTER),
    ]
