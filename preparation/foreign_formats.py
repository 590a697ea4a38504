"""Foreign formats: files of photos and videos that are not read, and what to do about them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ForeignFormat:
    """A kind of file that has to be converted."""

    name: str
    advice: str

    @property
    def reason(self) -> str:
        """The reason why a file of this kind is left out."""
        return f"{self.name} files are not read"


HEIC = ForeignFormat(
    "HEIC",
    "Convert them to JPEG. macOS: sips -s format jpeg *.HEIC --out FOLDER. Linux: heif-convert -q "
    "95 IN.HEIC OUT.jpg for each (in Debian's libheif-examples). Windows: open and save them in "
    "Photos. An iPhone takes JPEG with Settings > Camera > Formats > Most Compatible.",
)
AVIF = ForeignFormat("AVIF", "Convert them to PNG: ffmpeg -i IN.avif OUT.png for each.")
RAW = ForeignFormat(
    "camera RAW",
    "Develop all of them with the same settings, and uncropped, to JPEG, PNG or TIFF: with the "
    "camera's own program, or darktable-cli IN OUT.jpg for each.",
)
OTHER_IMAGE = "Convert them to PNG: ffmpeg -i IN OUT.png for each."
OTHER_VIDEO = "Convert them to MP4: ffmpeg -i IN OUT.mp4 for each."

RAW_EXTENSIONS = (
    *(".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dng", ".erf", ".fff", ".gpr", ".iiq", ".kdc"),
    *(".mrw", ".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".rwl", ".sr2", ".srf"),
    *(".srw", ".x3f"),
)

HEIC_EXTENSIONS = (".heic", ".heif", ".hif")

BY_EXTENSION = {
    **dict.fromkeys(HEIC_EXTENSIONS, HEIC),
    ".avif": AVIF,
    **dict.fromkeys(RAW_EXTENSIONS, RAW),
    **{
        f".{name.lower()}": ForeignFormat(name, OTHER_IMAGE)
        for name in ("GIF", "JP2", "JXL", "PSD", "EXR", "HDR", "TGA", "PPM", "PGM")
    },
    **{
        f".{name.lower()}": ForeignFormat(name, OTHER_VIDEO)
        for name in ("MTS", "M2TS", "MPG", "WMV", "3GP", "FLV", "INSV")
    },
}

BRANDS = {
    **dict.fromkeys((b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"), HEIC),
    **dict.fromkeys((b"avif", b"avis"), AVIF),
}
"""Brands of ISO/IEC 23008-12 and AVIF: phones also send such files under the name of a JPEG."""

HEAD = 12
"""Number of bytes at a file's beginning that contain its brand."""


def foreign_format(extension: str, head: bytes) -> ForeignFormat | None:
    """The unsupported format of a file, by its first bytes or else its lower-case extension."""
    if head[4:8] == b"ftyp" and head[8:12] in BRANDS:
        return BRANDS[head[8:12]]
    return BY_EXTENSION.get(extension)
