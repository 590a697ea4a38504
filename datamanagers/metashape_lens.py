"""Lenses of Metashape's cameras XML; its formulas are in ``metashape_file``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.datamanagers.brown import brown_lens, fisheye_lens
from gsfw.datamanagers.lens import Lens

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

FISHEYES = ("fisheye", "equidistant_fisheye")
"""Metashape's names of r = theta."""
SKEW = 0.1
"""Most pixels that leaving b2 out may move a corner of the image."""


def read_lens(sensor: Element, where: str) -> Lens:
    """The lens of a sensor.

    Raises:
        DataError: it is not calibrated, of a kind that cannot be used, or skewed.
    """
    kind = sensor.get("type", "frame")
    if kind != "frame" and kind not in FISHEYES:
        raise DataError(
            f"{where}: images of {kind} cameras cannot be trained on.",
            "Expected frame or fisheye; cut panoramas into images of pinhole cameras first.",
        )
    calibration = _calibration(sensor, where)
    resolution = calibration.find("resolution")
    resolution = sensor.find("resolution") if resolution is None else resolution
    try:
        size = {} if resolution is None else resolution.attrib
        width, height = int(size["width"]), int(size["height"])
    except (KeyError, ValueError):
        raise DataError(f"{where}: it has no resolution.", "Export the cameras again.") from None
    names = ("cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")
    values = {name: text_number(calibration, name, where, 0.0) for name in names}
    focal = text_number(calibration, "f", where)
    _check_terms(values, focal, height, where)
    pinhole = Lens(
        fx=focal + values["b1"],
        fy=focal,
        cx=width / 2 + values["cx"],
        cy=height / 2 + values["cy"],
        width=width,
        height=height,
        source=where,
    )
    pinhole.check()
    radial = (values["k1"], values["k2"], values["k3"], values["k4"])
    tangential = (values["p2"], values["p1"])
    make = fisheye_lens if kind in FISHEYES else brown_lens
    return make(pinhole, radial, tangential)


def _calibration(sensor: Element, where: str) -> Element:
    """The adjusted calibration; where there is none, the only one."""
    found = sensor.findall("calibration")
    adjusted = [entry for entry in found if entry.get("class") == "adjusted"]
    calibration = next(iter(adjusted or found), None)
    if calibration is None or calibration.find("f") is None:
        raise DataError(
            f"{where}: it has no calibration with a focal length f.",
            "Align the photos in Metashape, then export the cameras as Agisoft XML (version 1.2 "
            "or newer).",
        )
    return calibration


def _check_terms(values: dict[str, float], focal: float, height: int, where: str) -> None:
    moved = abs(values["b2"]) * height / 2 / max(focal, 1e-9)
    if moved > SKEW:
        raise DataError(
            f"{where}: its skew b2 = {values['b2']:g} moves corners by {moved:.2g} pixels, which "
            "no camera here can do.",
            "Optimize the cameras in Metashape without b2, or export undistorted images.",
        )
    if values["p3"] or values["p4"]:
        raise DataError(
            f"{where}: its tangential terms p3 = {values['p3']:g} and p4 = {values['p4']:g} cannot "
            "be used.",
            "Optimize the cameras in Metashape without them, or export undistorted images.",
        )


def text_number(node: Element, tag: str, where: str, default: float | None = None) -> float:
    """The number in a child.

    Raises:
        DataError: it is something else, or not there and has no default; begins with ``where``.
    """
    if node.find(tag) is None and default is not None:
        return default
    return float(text_numbers(node, tag, 1, where)[0])


def text_numbers(node: Element, tag: str, count: int, where: str) -> Float64[Tensor, " n"]:
    """The numbers in a child, separated by spaces.

    Raises:
        DataError: they are something else, or not there; begins with ``where``.
    """
    text = node.findtext(tag) or ""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        shown = text.strip()[:60] or "nothing"
        raise DataError(
            f"{where}: {tag} should be {count} numbers; found {shown}.",
            "Export the cameras again.",
        )
    return torch.tensor(values, dtype=torch.float64)
