"""Remote: files of an address that fsspec opens (s3://, gs://, https://, ...), read with retries.

Credentials are fsspec's own business: its environment variables and configuration files.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any, TypeVar
from urllib.parse import unquote

from gsfw.core.errors import DataError, UnavailableError

ATTEMPTS = 4
"""Most times that a read is tried before it fails."""
WAIT = 0.5
"""Seconds before the second attempt; each further one waits twice as long."""
TAGS = ("ETag", "etag", "md5Hash", "LastModified", "mtime", "created")
"""Facts of a file that change with its content, as different stores call them."""

_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.\-]*(?:::[^/]*)?://")
Answer = TypeVar("Answer")


def is_remote(text: str) -> bool:
    """True for an address such as s3://bucket/scene, false for a path."""
    return _ADDRESS.match(text) is not None


@dataclass(frozen=True)
class RemoteFile:
    """A file of an address."""

    place: str
    """Full name of the file, as the store expects it."""
    size: int | None
    """Size in bytes; ``None`` if the store does not say."""
    tag: str
    """Changes with the content, if the store says so much; else empty."""


class RemoteSource:
    """The files below an address."""

    def __init__(self, address: str) -> None:
        """Connect.

        Raises:
            UnavailableError: a package is missing; names it.
            DataError: the address cannot be used.
        """
        self.address = address.rstrip("/")
        try:
            from fsspec.core import url_to_fs
        except ImportError:
            raise UnavailableError(
                f"data={address}: addresses are read through fsspec, which is not installed.",
                "pip install 'gsfw[cloud]'",
            ) from None
        try:
            self._files, self._root = url_to_fs(self.address)
        except ImportError as error:
            raise UnavailableError(
                f"data={address}: a package for this kind of address is missing: {error}"
            ) from error
        except ValueError as error:
            raise DataError(
                f"data={address}: this address cannot be read: {error}",
                "Give a folder, or an address such as s3://bucket/scene or https://host/scene.",
            ) from error

    def files(self) -> Mapping[str, RemoteFile]:
        """All files, by path relative to the address.

        Raises:
            DataError: there are none, or the place cannot be listed.
        """
        found: Mapping[str, Mapping[str, Any]] = self._tried(
            self.address, lambda: self._files.find(self._root, detail=True)
        )
        root = str(self._root).rstrip("/")
        files: dict[str, RemoteFile] = {}
        for place, listed in found.items():
            name = unquote(place) if "://" in place else place
            relative = name.removeprefix(unquote(root) if "://" in place else root).lstrip("/")
            if not relative or ".." in PurePosixPath(relative).parts:
                continue
            facts = listed if listed.get("size") is not None else self._facts(place)
            tag = next((str(facts[name]) for name in TAGS if facts.get(name)), "")
            size = facts.get("size")
            files[relative] = RemoteFile(place, None if size is None else int(size), tag)
        if not files:
            raise DataError(
                f"data={self.address}: nothing was found there.",
                "Give the address of the folder of the data set. A web server has to list its "
                "folders.",
            )
        return files

    def _facts(self, place: str) -> Mapping[str, Any]:
        """The facts of one file, where the listing has no sizes."""
        found: Mapping[str, Any] = self._tried(place, lambda: self._files.info(place))
        return found

    def read(self, file: RemoteFile, most: int | None = None) -> bytes:
        """The content of a file, or its first bytes.

        Raises:
            DataError: it is gone, may not be read, or the connection failed again and again.
        """

        def content() -> bytes:
            if most is not None and file.size is not None and most < file.size:
                found: bytes = self._files.cat_file(file.place, start=0, end=most)
                expected = most
            else:
                found, expected = self._files.cat_file(file.place), file.size or 0
            if file.size is not None and len(found) < expected:
                raise ConnectionError(f"{len(found):,} of {expected:,} bytes came")
            return found[:most]

        return self._tried(file.place, content)

    def _tried(self, place: str, action: Callable[[], Answer]) -> Answer:
        """The result of an action, tried again where the connection fails.

        Raises:
            DataError: it failed for good, or ``ATTEMPTS`` times.
        """
        for attempt in range(1, ATTEMPTS + 1):
            try:
                return action()
            except FileNotFoundError as error:
                raise DataError(
                    f"{self._named(place)}: there is nothing at this address.",
                    "Compare the address with what the store lists.",
                ) from error
            except Exception as error:  # Each store has errors of its own.
                if isinstance(error, PermissionError) or _status(error) in (401, 403):
                    raise DataError(
                        f"{self._named(place)} may not be read: {error or 'no permission'}.",
                        "Check the credentials; fsspec takes them from its environment and "
                        "configuration.",
                    ) from error
                if attempt == ATTEMPTS:
                    reason = str(error) or type(error).__name__
                    raise DataError(
                        f"{self._named(place)} could not be read in {ATTEMPTS} attempts: {reason}",
                        "Check the connection. A run that was training continues from its "
                        "last checkpoint: gsfw resume RUN",
                    ) from error
                time.sleep(WAIT * 2 ** (attempt - 1))
        raise AssertionError("the last attempt returns or raises")

    def _named(self, place: str) -> str:
        """A place with its protocol, for messages."""
        return (
            place if "://" in place else f"{self.address.partition('://')[0]}://{place.lstrip('/')}"
        )


def _status(error: Exception) -> int | None:
    """The status of a response of a web server; ``None`` if the error has none."""
    status = getattr(error, "status", None)
    return status if isinstance(status, int) else None
