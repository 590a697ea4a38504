"""DevicePictures: pictures on a GPU, those that stay there and those that pass through."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from gsfw.datamanagers.pictures import Picture
from gsfw.datamanagers.upload import Shipment, Upload

MOST_PASSING = 16
"""Pictures that were sent ahead and not yet used; more mean that a guess of what comes was wrong,
and the oldest are dropped."""


@dataclass(frozen=True)
class PlacedPicture:
    """A picture where it is used."""

    pixels: UInt8[Tensor, "h w d"]
    """As ``Picture`` has them."""
    mask: Bool[Tensor, "h w"] | None = None
    depth: Float[Tensor, "h w"] | None = None

    @staticmethod
    def on_host(picture: Picture) -> PlacedPicture:
        """A decoded picture where it is; nothing is copied."""
        mask = None if picture.mask is None else torch.from_numpy(picture.mask)
        depth = None if picture.depth is None else torch.from_numpy(picture.depth)
        return PlacedPicture(torch.from_numpy(picture.pixels), mask, depth)

    @staticmethod
    def of(tensors: tuple[Tensor, ...]) -> PlacedPicture:
        """A picture of its ``tensors``, which are told by their types."""
        pixels, *others = tensors
        mask = next((tensor for tensor in others if tensor.dtype is torch.bool), None)
        depth = next((tensor for tensor in others if tensor.dtype is not torch.bool), None)
        return PlacedPicture(pixels, mask, depth)

    @property
    def tensors(self) -> tuple[Tensor, ...]:
        """Pixels, and the mask and the depths if there are any."""
        others = (tensor for tensor in (self.mask, self.depth) if tensor is not None)
        return (self.pixels, *others)


def staying(sizes: Sequence[int], budget: int) -> frozenset[int]:
    """The pictures that stay on a GPU: from the first on, each that still fits.

    Always the same ones, because every epoch uses each picture once: keeping those used last would
    drop each one shortly before it is used again.

    Args:
        sizes: bytes of each picture, those used most first.
        budget: bytes that all of them may take.
    """
    chosen: list[int] = []
    for number, size in enumerate(sizes):
        if size <= budget:
            chosen.append(number)
            budget -= size
    return frozenset(chosen)


class DevicePictures:
    """The pictures of a data set on one device; they are sent by a thread, ahead of use.

    Besides those that stay, the few that were sent ahead take memory until they are used.
    """

    def __init__(
        self,
        request: Callable[[int], Future[Picture]],
        upload: Upload,
        kept: frozenset[int],
    ) -> None:
        """Nothing is sent yet.

        Args:
            request: has a picture decoded, by its number.
            upload: the way to the device.
            kept: numbers of the pictures that stay once they are there.
        """
        self._request = request
        self._upload = upload
        self._kept = kept
        self._sent: dict[int, Future[Shipment]] = {}
        self._thread = ThreadPoolExecutor(1, "gsfw-upload")

    def lacking(self, numbers: Iterable[int]) -> list[int]:
        """Those of ``numbers`` that are neither there nor on their way."""
        return [number for number in numbers if number not in self._sent]

    def send(self, number: int, picture: Future[Picture]) -> None:
        """Have a picture sent as soon as it is decoded."""
        passing = [other for other in self._sent if other not in self._kept]
        for unused in passing[: max(len(passing) + 1 - MOST_PASSING, 0)]:
            del self._sent[unused]
        self._sent[number] = self._thread.submit(self._ship, picture)

    def _ship(self, picture: Future[Picture]) -> Shipment:
        return self._upload.send(PlacedPicture.on_host(picture.result()).tensors)

    def get(self, number: int) -> PlacedPicture:
        """A picture on the device; waits for it to be decoded and sent, not for its arrival.

        Raises:
            DataError: it does not decode.
        """
        if number not in self._sent:
            self.send(number, self._request(number))
        coming = self._sent.pop(number)
        try:
            shipment = coming.result()
        except CancelledError:  # What was asked for later took its place among the decoded ones.
            return self.get(number)
        if number in self._kept:
            self._sent[number] = coming
        return PlacedPicture.of(self._upload.receive(shipment))

    def close(self) -> None:
        """Stop sending, and free the device's memory."""
        self._thread.shutdown(cancel_futures=True)
        self._sent.clear()
