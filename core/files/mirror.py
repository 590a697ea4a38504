"""Mirror: a remote data set as a folder, whose images come when they are needed.

All files but images are fetched when the data set is opened, as any code may read them. An image is
an empty file until something asks for its header; then the first bytes of all images beside it are
fetched, in parallel. Whoever decodes an image holds it (``held``): it is fetched whole, in the
thread that decodes ahead of use, and stays until the bound of the folder needs its room.

The folder stays for the next run; what has changed at the address since is fetched again. Runs may
share it at the same time: one of them makes it, and no image is cut that another reads.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections import Counter, OrderedDict, defaultdict
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path
from threading import Lock

from PIL import Image

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.file_use import if_unused, in_turn, in_use
from gsfw.core.files.json_text import parsed_json
from gsfw.core.files.remote import RemoteFile, RemoteSource, is_remote
from gsfw.core.files.user_folder import cache_root, temporary_root
from gsfw.core.progress import stage, tracked
from gsfw.core.words import size

IMAGES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp", ".npy", ".npz")
"""Extensions of the files that are fetched on demand: images, and maps as arrays."""
ARRAYS = (".npy", ".npz")
"""Extensions of the images that are always read whole."""
SINGLE_FILES = (".json", ".xml", ".csv")
"""Extensions of files that a data set may be named by; the folder around is the data set."""
HEADS = (1 << 14, 1 << 17)
"""First bytes of an image that are fetched for its header; the second, should they not do."""
CONNECTIONS = 8
"""Files that are fetched at once when a data set is opened."""
MANIFEST, LOCK = ".gsfw-remote.json", ".gsfw-remote.lock"
ATTEMPTS = 10
"""Most times that an image is fetched again because another run has cut it meanwhile."""
MEGABYTE = 1_000_000
SMALL = 256 * MEGABYTE
"""Bytes of files that are no images, which are fetched at once under any bound."""
USUAL = 4096 * MEGABYTE
"""Bound of the folder in bytes, unless one is given."""

_open: dict[str, Mirror] = {}
"""The mirrors of this process, by address."""


def local_place(data: str, most: int | None = None) -> Path:
    """The path of a data set: a folder that mirrors it, if it is an address.

    Args:
        data: a path or an address.
        most: bytes that whole images may take in the folder; ``None``: as before.

    Raises:
        DataError: the address cannot be read.
        UnavailableError: a package for it is missing.
    """
    if not is_remote(data):
        return Path(data)
    folder, _, name = data.rstrip("/").rpartition("/")
    is_single = Path(name).suffix.lower() in SINGLE_FILES
    address = folder if is_single else data.rstrip("/")
    if address not in _open:
        _open[address] = Mirror(address, USUAL if most is None else most)
    mirror = _open[address]
    mirror.most = mirror.most if most is None else most
    return mirror.path / name if is_single else mirror.path


@contextmanager
def held(path: Path, whole: bool) -> Iterator[None]:
    """Have a file of a mirror at hand while it is read; any other path is left alone.

    Args:
        path: the file.
        whole: false if its header is enough.

    Raises:
        DataError: it cannot be fetched.
    """
    mirror = _mirror_of(path)
    with nullcontext() if mirror is None else mirror.held(path, whole):
        yield


def notes_on(path: Path) -> tuple[str, ...]:
    """A sentence on what was fetched for a data set, and will be; none for a local one."""
    mirror = _mirror_of(path)
    return () if mirror is None else mirror.notes()


def _mirror_of(path: Path) -> Mirror | None:
    if not _open:
        return None
    return next((item for item in _open.values() if path.is_relative_to(item.path)), None)


class Mirror:
    """The folder of a remote data set."""

    def __init__(self, address: str, most: int) -> None:
        """List the address, and fetch all files but images.

        Raises:
            DataError: it cannot be read, or these files are more than ``most`` and ``SMALL``.
            OutputError: a user without a home has no place of their own for it.
        """
        self.most = most
        """Most bytes of whole images in the folder; one is kept even if it has more."""
        self._source = RemoteSource(address)
        with stage(f"listing {address}"):
            self._files = self._source.files()
        root = cache_root() or temporary_root()
        key = hashlib.blake2b(address.encode(), digest_size=6).hexdigest()
        self.path = (root / "remote" / key / address.rpartition("/")[2]).resolve()
        self._lock = Lock()
        self._locks: defaultdict[str, Lock] = defaultdict(Lock)
        self._in_use: Counter[str] = Counter()
        self._whole: OrderedDict[str, int] = OrderedDict()
        self._looked_at: set[str] = set()
        self.fetched = 0
        """Bytes that this process has fetched."""
        with in_turn(self.path / LOCK):
            self._begin()

    def _begin(self) -> None:
        """Make the folder what the address lists."""
        plain = {name: file for name, file in self._files.items() if not self._is_image(name)}
        total = sum(file.size or 0 for file in plain.values())
        if total > max(self.most, SMALL):
            largest = max(plain, key=lambda name: plain[name].size or 0)
            raise DataError(
                f"data={self._source.address}: {size(total)} that are no images would be fetched "
                f"at once ({largest}: {size(plain[largest].size or 0)}), and data_cache_mb is "
                f"{self.most // MEGABYTE}.",
                "Give the address of the data set alone, or raise data_cache_mb.",
            )
        known = self._known()
        for name, file in self._files.items():
            self._keep(name, file, known.get(name))
        missing = [name for name in plain if not self._is_whole(name)]
        count = f"{len(missing)} files ({size(sum(plain[name].size or 0 for name in missing))})"
        self._fetch_all(missing, None, f"fetching {count} of {self._source.address}")
        facts = {name: [file.size, file.tag] for name, file in self._files.items()}
        write_atomically(self.path / MANIFEST, json.dumps(facts).encode())
        self._shrink()

    def _is_image(self, name: str) -> bool:
        file = self._files[name]
        return file.size is not None and Path(name).suffix.lower() in IMAGES

    def _known(self) -> Mapping[str, list[object]]:
        """Sizes and tags of the files when the folder was used last."""
        try:
            found = parsed_json((self.path / MANIFEST).read_text())
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _keep(self, name: str, file: RemoteFile, before: list[object] | None) -> None:
        """Keep what is there of a file, if it has not changed; else an image begins empty."""
        place = self.path / name
        there = place.stat().st_size if place.is_file() else -1
        if before != [file.size, file.tag] or there > (file.size or there):
            place.unlink(missing_ok=True)
            there = -1
        if there < 0 and self._is_image(name):
            place.parent.mkdir(parents=True, exist_ok=True)
            place.touch()
        elif there > 0 and self._is_image(name) and there == file.size:
            self._whole[name] = there

    def _is_whole(self, name: str) -> bool:
        place, expected = self.path / name, self._files[name].size
        return place.is_file() and (expected is None or place.stat().st_size >= expected)

    @contextmanager
    def held(self, path: Path, whole: bool) -> Iterator[None]:
        """See ``held``."""
        name = path.relative_to(self.path).as_posix()
        if name not in self._files or not self._is_image(name):
            yield
            return
        with self._lock:
            self._in_use[name] += 1
        try:
            if whole or path.suffix.lower() in ARRAYS:
                with self._whole_image(name):
                    yield
            else:
                self._look_at(name)
                yield
        finally:
            with self._lock:
                self._in_use[name] -= 1

    @contextmanager
    def _whole_image(self, name: str) -> Iterator[None]:
        """Fetch a whole image, unless it is there; no run cuts it in the meantime."""
        with self._lock:
            own = self._locks[name]
        with ExitStack() as use:
            with own:
                for _ in range(ATTEMPTS):
                    if not self._is_whole(name):
                        self._write(name, self._source.read(self._files[name]))
                    use.enter_context(in_use(self.path / name))
                    if self._is_whole(name):
                        break
                    use.close()
                with self._lock:
                    self._whole[name] = self._files[name].size or 0
                    self._whole.move_to_end(name)
            self._shrink()
            yield

    def _look_at(self, name: str) -> None:
        """Fetch the headers of an image and of those beside it, unless they are there."""
        folder = Path(name).parent.as_posix()
        with self._lock:
            own = self._locks[folder + "/"]
        with own:
            if folder in self._looked_at:
                return
            beside = [
                other
                for other in self._files
                if Path(other).parent.as_posix() == folder
                and self._is_image(other)
                and not _has_header(self.path / other)
            ]
            title = f"fetching the headers of {len(beside)} images of {self._source.address}"
            for most in (*HEADS, None):
                self._fetch_all(beside, most, title)
                beside = [other for other in beside if not _has_header(self.path / other)]
            self._looked_at.add(folder)

    def _fetch_all(self, names: list[str], most: int | None, title: str) -> None:
        """Fetch files, or their first bytes, in parallel."""
        if not names:
            return
        with ThreadPoolExecutor(CONNECTIONS, "gsfw-fetch") as pool:
            contents = pool.map(lambda name: self._source.read(self._files[name], most), names)
            for name, content in zip(names, tracked(contents, title, len(names)), strict=True):
                self._write(name, content, is_head=most is not None)

    def _write(self, name: str, content: bytes, is_head: bool = False) -> None:
        """Write a file, or the header of an image, unless another run has written more of it."""
        place = self.path / name
        with in_turn(place):
            if is_head:
                if place.stat().st_size < len(content):
                    with place.open("r+b") as file:
                        file.write(content)
            elif self._files[name].size is None or not self._is_whole(name):
                write_atomically(place, content)
        with self._lock:
            self.fetched += len(content)

    def _shrink(self) -> None:
        """Cut the images that were used longest ago back to their headers, as the bound needs."""
        with self._lock:
            used = sum(self._whole.values())
            for name in list(self._whole)[:-1]:
                if used <= self.most:
                    return
                if self._in_use[name]:
                    continue
                with if_unused(self.path / name) as is_unused:
                    if is_unused:
                        used -= self._whole.pop(name)
                        _cut(self.path / name)

    def notes(self) -> tuple[str, ...]:
        """A sentence on what was fetched, and what will be."""
        images = [file.size or 0 for name, file in self._files.items() if self._is_image(name)]
        return (
            f"{self._source.address}: {size(self.fetched)} were fetched into {self.path}; its "
            f"{len(images):,} images and maps ({size(sum(images))}) come as they are needed, and "
            f"at most {size(self.most)} of them stay there (data_cache_mb)",
        )


def _has_header(path: Path) -> bool:
    """True if what is there of an image is enough for its header; arrays are always read whole."""
    return path.suffix.lower() in ARRAYS or _is_readable(path)


def _is_readable(image: Path | io.BytesIO) -> bool:
    try:
        with Image.open(image) as header:
            return header.width > 0
    except Exception:  # Pillow's decoders raise whatever a broken file makes them.
        return False


def _cut(path: Path) -> None:
    """Cut an image back to its header; an image whose header is long stays whole."""
    with path.open("rb") as file:
        start = file.read(HEADS[-1])
    for length in HEADS:
        if path.suffix.lower() in ARRAYS or _is_readable(io.BytesIO(start[:length])):
            os.truncate(path, min(length, path.stat().st_size))
            return
