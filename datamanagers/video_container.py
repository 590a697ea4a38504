"""Video container: a video file as PyAV opens it, and the time stamps of its packets.

Nothing is decoded here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gsfw.core.errors import DataError, UnavailableError
from gsfw.datamanagers.detection import VIDEOS

MISSING = 5.0
"""Images that would fit between a video's last image and the end that it announces, beyond which
its end is missing."""
ADVICE = "Copy the video again; if it was recorded so, write it anew with ffmpeg -i OLD NEW.mp4."


@contextmanager
def opened_video(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open a video for PyAV; gives its container and its video stream.

    Raises:
        DataError: the file is no video, or cannot be opened.
        UnavailableError: PyAV is not installed.
    """
    try:
        import av
    except ImportError:
        raise UnavailableError(
            f"{path} is a video, and PyAV, which decodes videos, is not installed.",
            "Install it with: pip install 'gsfw[video]' (or: pip install av). Or cut the video "
            "into images.",
        ) from None
    try:
        container = _container(path)
    except (av.FFmpegError, OSError) as error:
        raise DataError(f"{path}: {_why_unopened(path, error)}", ADVICE) from error
    with container:
        if not container.streams.video or container.format.name.endswith(("_pipe", "image2")):
            raise DataError(
                f"{path}: the file ({container.format.long_name}) is no video.",
                f"Expected a file such as {', '.join(VIDEOS)} with a video in it.",
            )
        stream = container.streams.video[0]
        # One thread for each video: several videos are decoded at once, and seeking stays quick.
        stream.thread_type = "NONE"
        yield container, stream


def _container(path: Path, options: Mapping[str, str] | None = None) -> Any:  # noqa: ANN401
    """Open a file by PyAV, whatever bytes its metadata holds."""
    import av

    # PyAV 19 replaces metadata that is no text by itself; earlier versions need an argument for it.
    settings: dict[str, Any] = {"options": dict(options or {})}
    if int(av.__version__.partition(".")[0]) < 19:
        settings["metadata_errors"] = "replace"
    # FFmpeg takes text before a colon in a relative path for a protocol.
    return av.open(str(path.absolute()), **settings)


def time_stamps(path: Path, container: Any, stream: Any) -> tuple[list[int], list[int]]:  # noqa: ANN401
    """Time stamps of all images, and of the key frames among them, in the order of the packets.

    Raises:
        DataError: the video is cut off or damaged, or contains no images or no times.
    """
    import av

    stamps, keys, corrupt = [], [], 0
    try:
        for packet in container.demux(stream):
            if packet.size == 0 or packet.is_discard:
                continue
            corrupt += packet.is_corrupt
            stamp = packet.dts if packet.pts is None else packet.pts
            if stamp is None:
                raise DataError(
                    f"{path}: its images have no time stamps.",
                    "Put it into a container that has them: ffmpeg -i OLD -c copy NEW.mp4.",
                )
            stamps.append(stamp)
            if packet.is_keyframe:
                keys.append(stamp)
    except (av.FFmpegError, OSError) as error:
        raise DataError(f"{path}: the video cannot be read: {reason_of(error)}", ADVICE) from error
    announced = stream.frames or len(stamps)
    if len(stamps) < announced and not corrupt and "mov" in container.format.name:
        announced -= _count_stored(path) - len(stamps)
    if corrupt or len(stamps) < announced:
        there = len(stamps) - corrupt
        raise DataError(
            f"{path} is cut off: its header announces {announced} images, {there} are there.",
            "Copy the video again.",
        )
    if not stamps:
        raise DataError(f"{path}: the video contains no images.", "Record or copy it again.")
    _check_length(path, stream, stamps)
    return stamps, keys


def _check_length(path: Path, stream: Any, stamps: list[int]) -> None:  # noqa: ANN401
    """Check that a video lasts as long as it announces: Matroska does so in place of a number.

    Raises:
        DataError: its end is missing.
    """
    parts = re.fullmatch(r"(\d+):(\d+):(\d+\.\d+)", stream.metadata.get("DURATION", ""))
    if parts is None or len(stamps) < 2:
        return
    announced = 3600 * int(parts[1]) + 60 * int(parts[2]) + float(parts[3])
    first, last = min(stamps) * float(stream.time_base), max(stamps) * float(stream.time_base)
    if announced - last > MISSING * (last - first) / (len(stamps) - 1):
        raise DataError(
            f"{path} is cut off: its header announces {announced:.2f} s, and its last image is "
            f"at {last:.2f} s.",
            "Copy the video again.",
        )


def _count_stored(path: Path) -> int:
    """Number of images in an MP4 or MOV file, with those that its edit list leaves out.

    Editors trim videos by such a list, and leave the images and their announced number as is.
    """
    import av

    try:
        with _container(path, {"ignore_editlist": "1"}) as container:
            return sum(packet.size > 0 for packet in container.demux(container.streams.video[0]))
    except (av.FFmpegError, OSError) as error:
        raise DataError(f"{path}: the video cannot be read: {reason_of(error)}", ADVICE) from error


def _why_unopened(path: Path, error: Exception) -> str:
    if path.is_dir():
        return "this is a folder."
    if not path.exists():
        return "there is no such file."
    size = path.stat().st_size
    if size == 0:
        return "the file is empty (0 bytes)."
    boxes = _boxes(path)
    if "ftyp" in boxes and "moov" not in boxes:
        return f"the video is cut off after {size} bytes: its index (the moov box) is missing."
    return f"these {size} bytes are no video ({reason_of(error)})."


def _boxes(path: Path) -> list[str]:
    """Names of the outermost boxes of an MP4 or MOV file (ISO/IEC 14496-12, 4.2)."""
    names: list[str] = []
    position, size = 0, path.stat().st_size
    with path.open("rb") as file:
        while position + 8 <= size and len(names) < 64:
            file.seek(position)
            head = file.read(16)
            length = int.from_bytes(head[:4], "big")
            if length == 1:
                length = int.from_bytes(head[8:16], "big")
            names.append(head[4:8].decode("latin-1"))
            if length < 8:
                break
            position += length
    return names


def reason_of(error: Exception) -> str:
    """The reason that FFmpeg or the system states for an error."""
    return getattr(error, "strerror", None) or str(error)
