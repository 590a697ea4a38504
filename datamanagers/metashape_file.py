"""Reader of Metashape's cameras XML.

The manual's frame camera is Brown's with u = w / 2 + cx + x' (f + b1) + y' b2 and
v = h / 2 + cy + y' f, where the centre of the first pixel is at (0.5, 0.5), as in gsfw: nothing
moves by half a pixel. Its P1 is OpenCV's p2, and its P2 OpenCV's p1. Its fisheye is the same on
x' = x theta / r. The image is the sensor: Metashape has no crop, resolution is that of the file.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.files.reading import first_bytes
from gsfw.core.maths.similarity import Similarity
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.metashape_lens import read_lens, text_number, text_numbers
from gsfw.datamanagers.poses import pose_from_center
from gsfw.datamanagers.xml_file import read_xml

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

HEAD_BYTES = 4096
"""Bytes of a file that are searched for Metashape's signature."""


@dataclass(frozen=True)
class MetashapeCamera:
    """A camera with a pose; what the rest of the world calls an image."""

    label: str
    sensor: str
    """The number of the lens."""
    lens: Lens
    world_to_camera: Float64[Tensor, "4 4"]


@dataclass(frozen=True)
class MetashapeFile:
    """The chunk of a file with the most cameras, and its component with the most."""

    cameras: tuple[MetashapeCamera, ...]
    disabled: tuple[str, ...]
    """Labels of cameras that the user has switched off."""
    unaligned: tuple[str, ...]
    """Labels of cameras without a pose."""
    slaves: tuple[str, ...]
    """Labels of cameras of a rig that have no pose but by that of their master."""
    notes: tuple[str, ...]
    up: str
    """"z" in Metashape's local coordinates; empty elsewhere."""

    @staticmethod
    def read(file: Path) -> MetashapeFile:
        """Read the file.

        Raises:
            DataError: it is damaged, has no camera with a pose, or one that cannot be used.
        """
        root = read_xml(file, "Export the cameras again.")
        chunks = list(root.iter("chunk"))
        if not chunks:
            raise DataError(
                f"{file} contains no chunk.",
                "Export the cameras in Metashape's own format (Agisoft XML).",
            )
        best = max(chunks, key=lambda chunk: len(list(chunk.iterfind(".//camera/transform"))))
        note = f"used the largest of {len(chunks)} chunks"
        return _chunk(best, file, (note,) if len(chunks) > 1 else ())


def is_metashape(file: Path) -> bool:
    """True if an XML file begins like Metashape's."""
    head = first_bytes(file, HEAD_BYTES)
    return b"<document" in head and b"<chunk" in head


def has_poses(file: Path) -> bool:
    """True if a file of Metashape places a camera; its Export Markers writes sensors alone.

    Raises:
        DataError: it is damaged.
    """
    return read_xml(file, "Export the cameras again.").find(".//camera/transform") is not None


def _chunk(chunk: Element, file: Path, notes: tuple[str, ...]) -> MetashapeFile:
    entries = list(chunk.iterfind("cameras//camera"))
    disabled = [entry for entry in entries if entry.get("enabled") in ("0", "false")]
    enabled = [entry for entry in entries if entry not in disabled]
    unaligned = [entry for entry in enabled if entry.find("transform") is None]
    aligned = [entry for entry in enabled if entry.find("transform") is not None]
    if not aligned:
        raise DataError(
            f"{file}: none of its {len(entries)} cameras is enabled and has a pose.",
            "Align the photos in Metashape first (Workflow > Align Photos), then export again.",
        )
    worlds = _worlds(chunk, file)
    aligned, component_note = _largest_component(aligned, worlds)
    sensors = {entry.get("id", ""): entry for entry in chunk.iterfind("sensors//sensor")}
    used = sorted({entry.get("sensor_id", "") for entry in aligned})
    for number in used:
        if number not in sensors:
            raise DataError(f"{file}: there is no sensor {number}.", "Export the cameras again.")
    lenses = {number: read_lens(sensors[number], f"sensor {number} of {file}") for number in used}
    chunk_world = worlds.get("")
    reference = chunk.findtext("reference") or ""
    local = chunk_world is not None and reference.startswith("LOCAL_CS")
    return MetashapeFile(
        cameras=tuple(
            _camera(
                entry,
                lenses[entry.get("sensor_id", "")],
                worlds.get(entry.get("component_id", ""), chunk_world) or Similarity(),
                f"{file}: camera {entry.get('label')}",
            )
            for entry in aligned
        ),
        disabled=tuple(entry.get("label", "") for entry in disabled),
        unaligned=tuple(entry.get("label", "") for entry in unaligned if not _is_slave(entry)),
        slaves=tuple(entry.get("label", "") for entry in unaligned if _is_slave(entry)),
        notes=(*notes, *component_note, _world_note(bool(worlds), reference)),
        up="z" if local else "",
    )


def _is_slave(camera: Element) -> bool:
    return camera.get("master_id", camera.get("id")) != camera.get("id")


def _world_note(placed: bool, reference: str) -> str:
    if not placed:
        return "the chunk has no transform: its own coordinates are the world"
    name = re.match(r'\w+\["([^"]*)"', reference)
    return f"the world is {name[1]}" if name else "the world is that of the chunk's transform"


def _largest_component(
    cameras: list[Element], worlds: dict[str, Similarity]
) -> tuple[list[Element], tuple[str, ...]]:
    """Cameras that share a world: all of them, or those of the component that has the most."""
    counts = Counter(entry.get("component_id", "") for entry in cameras)
    if len(counts) < 2 or all(number in worlds for number in counts):
        return cameras, ()
    best, count = counts.most_common(1)[0]
    return (
        [entry for entry in cameras if entry.get("component_id", "") == best],
        (
            f"used the {count} cameras of the largest of {len(counts)} components, which Metashape "
            f"did not join; {len(cameras) - count} cameras are left out",
        ),
    )


def _worlds(chunk: Element, file: Path) -> dict[str, Similarity]:
    """Poses of the components in the world, by number, and of the chunk itself (by "")."""
    nodes = {entry.get("id", ""): entry for entry in chunk.iterfind("components/component")}
    found = {"": chunk, **nodes}
    return {
        number: _similarity(transform, f"{file}: the transform of {number or 'the chunk'}")
        for number, entry in found.items()
        if (transform := entry.find("transform")) is not None and len(transform)
    }


def _similarity(node: Element, where: str) -> Similarity:
    """A rotation, a translation and a scale; those that are missing do nothing."""
    rotation = torch.eye(3, dtype=torch.float64)
    translation = torch.zeros(3, dtype=torch.float64)
    if node.find("rotation") is not None:
        rotation = text_numbers(node, "rotation", 9, where).reshape(3, 3)
        # Checked, and made exactly a rotation, as that of a camera is.
        rotation = pose_from_center(rotation, translation, where)[:3, :3]
    if node.find("translation") is not None:
        translation = text_numbers(node, "translation", 3, where)
    scale = text_number(node, "scale", where, 1.0)
    if scale <= 0:
        raise DataError(f"{where}: its scale is {scale:g}.", "Export the cameras again.")
    return Similarity(scale, rotation, translation)


def _camera(node: Element, lens: Lens, world: Similarity, where: str) -> MetashapeCamera:
    placed = text_numbers(node, "transform", 16, where).reshape(4, 4)
    rotation = (world.rotation @ placed[:3, :3]).T
    pose = pose_from_center(rotation, world.apply(placed[:3, 3]), where)
    return MetashapeCamera(node.get("label", ""), node.get("sensor_id", ""), lens, pose)
