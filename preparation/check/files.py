"""Files: what is known of a capture's pictures without decoding them."""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.core.datamanager import DataManager
from gsfw.datamanagers.capture import Capture


@dataclass(frozen=True)
class Files:
    """Counts over all pictures."""

    turned: tuple[str, ...] = ()
    """Names of pictures with an EXIF orientation, which was applied."""
    in_videos: int = 0
    """Pictures that are decoded from videos."""

    @staticmethod
    def of(data: DataManager) -> Files:
        """Of a data set; nothing where its pictures are no files."""
        if not isinstance(data, Capture):
            return Files()
        frames = data.recording.frames
        return Files(
            turned=tuple(frame.name for frame in frames if frame.header.orientation != 1),
            in_videos=sum(frame.shot is not None for frame in frames),
        )
