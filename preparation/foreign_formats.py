"""Foreign formats: files of photos and videos that are not read, and what to do about them."""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.datamanagers.detection import HEIC_EXTENSIONS
from gsfw.datamanagers.images import EXTENSIONS


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
    "Install their decoder, and the same command uses them: pip install 'gsfw[heic]'. Or convert "
    "them to JPEG. macOS: sips -s format jpeg *.HEIC --out FOLDER. Linux: heif-convert -q "
    "95 IN.HEIC OUT.jpg for each (in Debian's libheif-examples). Windows: open and save them in "
    "Photos. An iPhone takes JPEG with Settings > Camera > Formats > Most Compatible.",
)
AVIF = ForeignFormat(
    "AVIF",
    "This Pillow has no AVIF decoder; ready-built Pillow has one from version 11.3 on. Install it, "
    "and repeat the command: pip install -U --force-reinstall --only-binary pillow pillow. Or "
    "convert them to PNG: ffmpeg -i IN -frames:v 1 OUT.png for each.",
)
RAW = ForeignFormat(
    "camera RAW",
    "Develop all of them with the same settings, and uncropped, to JPEG, PNG or TIFF: with the "
    "camera's own program, or darktable-cli IN OUT.jpg for each.",
)
STITCH = (
    "Export it as a panorama of all directions (equirectangular, 2:1) with the camera's program; "
    "gsfw cuts that into views itself."
)
TWO_FISHEYES = f"Its images are those of several lenses, and not stitched. {STITCH}"
OTHER_IMAGE = "Convert them to PNG: ffmpeg -i IN -frames:v 1 OUT.png for each."
OTHER_VIDEO = "Convert them to MP4: ffmpeg -i IN OUT.mp4 for each."

RAW_EXTENSIONS = (
    *(".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dng", ".erf", ".fff", ".gpr", ".iiq", ".kdc"),
    *(".mrw", ".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".rwl", ".sr2", ".srf"),
    *(".srw", ".x3f"),
)

TWO_FISHEYE_EXTENSIONS = (".insp", ".insv", ".360")
"""Extensions of cameras with two lenses; .insp files are JPEG files by content, and .360 files of
GoPro MAX hold the faces of a cube."""

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
        for name in ("MTS", "M2TS", "MPG", "WMV", "3GP", "FLV")
    },
    **{end: ForeignFormat(end[1:].upper(), TWO_FISHEYES) for end in TWO_FISHEYE_EXTENSIONS},
}

BRANDS = {
    **dict.fromkeys((b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"), HEIC),
    **dict.fromkeys((b"avif", b"avis"), AVIF),
    b"crx ": RAW,
}
"""Brands of ISO/IEC 23008-12, AVIF and CR3: phones also name such files like a JPEG."""

MISNAMED_VIDEO = ForeignFormat("misnamed video", "Name them .mp4 or .mov to use their frames.")
SIGNATURES = {
    b"GIF8": BY_EXTENSION[".gif"],
    b"\xff\x0a": BY_EXTENSION[".jxl"],
    b"\0\0\0\x0cJXL ": BY_EXTENSION[".jxl"],
    b"\0\0\0\x0cjP  ": BY_EXTENSION[".jp2"],
    b"8BPS": BY_EXTENSION[".psd"],
    b"v/1\x01": BY_EXTENSION[".exr"],
    b"#?RADIANCE": BY_EXTENSION[".hdr"],
    b"P5\n": BY_EXTENSION[".pgm"],
    b"P6\n": BY_EXTENSION[".ppm"],
    b"FUJIFILMCCD-": RAW,
}
"""First bytes of formats that are not read, under the name of an image."""
HEAD = 12
"""Number of bytes at a file's beginning that tell its format."""


def foreign_format(extension: str, head: bytes) -> ForeignFormat | None:
    """The unsupported format of a file, by its first bytes or else its lower-case extension."""
    if head[4:8] == b"ftyp" and head[8:12] in BRANDS:
        return BRANDS[head[8:12]]
    if extension not in EXTENSIONS:
        return BY_EXTENSION.get(extension)
    if head[4:8] == b"ftyp":
        return MISNAMED_VIDEO
    by_content = (kind for start, kind in SIGNATURES.items() if head.startswith(start))
    return next(by_content, None)
