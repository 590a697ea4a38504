"""Sets of images among which panoramas are cut."""

from pathlib import Path

from gsfw.datamanagers.images import read_header
from gsfw.preparation.choices import Choices
from gsfw.preparation.exif import Exif
from gsfw.preparation.image_set import ImageSet, SourceImage
from gsfw.preparation.panorama_cutting import PanoramaRule, cut_panoramas


def images(folder: Path, video: str = "") -> ImageSet:
    files = sorted(folder.iterdir())
    return ImageSet(
        tuple(
            SourceImage(
                file.name,
                file,
                read_header(file),
                Exif(),
                video,
                float(number) if video else None,
            )
            for number, file in enumerate(files)
        )
    )


def photos(tmp_path: Path) -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    return folder


def cut(given: ImageSet, tmp_path: Path, **choices) -> tuple[ImageSet, list[str]]:
    said: list[str] = []
    rule = PanoramaRule(**choices)
    return cut_panoramas(given, rule, tmp_path / "views", Choices(said.append)), said
