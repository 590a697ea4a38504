"""Images on a GPU: how they get there ahead of use, which stay, and which pass through."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from gsfw.core.batch import Resampling
from gsfw.datamanagers.images import DecodedImage


@dataclass(frozen=True)
class Shipment:
    """Tensors on their way to a device."""

    tensors: tuple[Tensor, ...]
    """Valid only after ``Upload.receive`` has returned them."""
    sent: torch.cuda.Event | None = None
    """Passes when they have arrived; ``None`` when they have already."""


class Upload(ABC):
    """Brings tensors from the memory of the host to one device."""

    @abstractmethod
    def send(self, tensors: tuple[Tensor, ...]) -> Shipment:
        """Start to copy tensors that nobody changes meanwhile; may be called in any thread."""

    @abstractmethod
    def receive(self, shipment: Shipment) -> tuple[Tensor, ...]:
        """The sent tensors, ready for all work that the calling thread starts from now on.

        May be asked for the same shipment again.
        """


class PlainUpload(Upload):
    """Copies at once, to any device."""

    def __init__(self, device: torch.device) -> None:
        self._device = device

    def send(self, tensors: tuple[Tensor, ...]) -> Shipment:
        """Copy, and wait for it."""
        return Shipment(tuple(tensor.to(self._device) for tensor in tensors))

    def receive(self, shipment: Shipment) -> tuple[Tensor, ...]:
        """The copies."""
        return shipment.tensors


class CudaUpload(Upload):
    """Copies on a stream of its own, beside the kernels of the step that is under way.

    Who owns which memory until when: the pinned buffer is given back as soon as the copy is
    started, and torch's allocator of pinned memory lends it out again only once that copy has
    ended. The memory on the GPU belongs to the stream of the copy; ``record_stream`` keeps it from
    being lent out again before the work that uses it has ended.
    """

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self._stream = torch.cuda.Stream(device)

    def send(self, tensors: tuple[Tensor, ...]) -> Shipment:
        """Put the tensors into pinned memory, and start to copy them from there."""
        # A thread begins on the first GPU, on which pinning would set up a context.
        with torch.cuda.device(self._device), torch.cuda.stream(self._stream):
            copies = tuple(
                tensor.contiguous().pin_memory().to(self._device, non_blocking=True)
                for tensor in tensors
            )
            return Shipment(copies, self._stream.record_event())

    def receive(self, shipment: Shipment) -> tuple[Tensor, ...]:
        """The copies; the stream that is current now waits for them, the host does not."""
        stream = torch.cuda.current_stream(self._device)
        if shipment.sent is not None:
            stream.wait_event(shipment.sent)
        for tensor in shipment.tensors:
            tensor.record_stream(stream)
        return shipment.tensors


def upload_to(device: torch.device) -> Upload | None:
    """The way to a device; ``None`` for the CPU, where images are used where they are."""
    if device.type == "cpu":
        return None
    return CudaUpload(device) if device.type == "cuda" else PlainUpload(device)


MOST_PASSING = 16
"""Images that were sent ahead and not yet used; more mean that a guess of what comes was wrong,
and the oldest are dropped."""


@dataclass(frozen=True)
class PlacedMap:
    """A per-view map where it is used; see ``FittedMap``."""

    values: Float[Tensor, "rows columns d"]
    known: Bool[Tensor, "h w"]
    rule: Resampling


@dataclass(frozen=True)
class PlacedImage:
    """An image where it is used."""

    pixels: UInt8[Tensor, "h w d"]
    """The pixels of ``DecodedImage``."""
    mask: Bool[Tensor, "h w"] | None = None
    maps: Mapping[str, PlacedMap] = field(default_factory=dict)

    @staticmethod
    def on_host(image: DecodedImage) -> PlacedImage:
        """A decoded image where it is; nothing is copied."""
        mask = None if image.mask is None else torch.from_numpy(image.mask)
        maps = {
            name: PlacedMap(torch.from_numpy(item.values), torch.from_numpy(item.known), item.rule)
            for name, item in image.maps.items()
        }
        return PlacedImage(torch.from_numpy(image.pixels), mask, maps)

    @property
    def layout(self) -> Layout:
        """Layout of ``tensors``."""
        rules = {name: item.rule for name, item in self.maps.items()}
        return Layout(self.mask is not None, rules)

    @property
    def tensors(self) -> tuple[Tensor, ...]:
        """Pixels, the mask if there is one, and values and known pixels of each map."""
        mask = () if self.mask is None else (self.mask,)
        maps = (tensor for item in self.maps.values() for tensor in (item.values, item.known))
        return (self.pixels, *mask, *maps)


@dataclass(frozen=True)
class Layout:
    """Layout of an image's tensors, to put them together on a device."""

    masked: bool
    rules: Mapping[str, Resampling]
    """Resampling of the maps, in order."""

    def image(self, tensors: Sequence[Tensor]) -> PlacedImage:
        """The image of ``PlacedImage.tensors``."""
        pixels, *others = tensors
        mask = others.pop(0) if self.masked else None
        maps = {
            name: PlacedMap(values, known, rule)
            for (name, rule), values, known in zip(
                self.rules.items(), others[::2], others[1::2], strict=True
            )
        }
        return PlacedImage(pixels, mask, maps)


def staying(sizes: Sequence[int], budget: int) -> frozenset[int]:
    """The images that stay on a GPU: from the first on, each that still fits.

    Always the same ones, because every epoch uses each image once: keeping those used last would
    drop each one shortly before it is used again.

    Args:
        sizes: bytes of each image, those used most first.
        budget: bytes that all of them may take.
    """
    chosen: list[int] = []
    for number, size in enumerate(sizes):
        if size <= budget:
            chosen.append(number)
            budget -= size
    return frozenset(chosen)


class DeviceImages:
    """The images of a data set on one device; they are sent by a thread, ahead of use.

    Besides those that stay, the few that were sent ahead take memory until they are used.
    """

    def __init__(
        self,
        request: Callable[[int], Future[DecodedImage]],
        upload: Upload,
        kept: frozenset[int],
    ) -> None:
        """Nothing is sent yet.

        Args:
            request: has an image decoded, by its number.
            upload: the way to the device.
            kept: numbers of the images that stay once they are there.
        """
        self._request = request
        self._upload = upload
        self._kept = kept
        self._sent: dict[int, Future[tuple[Layout, Shipment]]] = {}
        self._thread = ThreadPoolExecutor(1, "gsfw-upload")

    def lacking(self, numbers: Iterable[int]) -> list[int]:
        """Those of ``numbers`` that are neither there nor on their way."""
        return [number for number in numbers if number not in self._sent]

    def send(self, number: int, image: Future[DecodedImage]) -> None:
        """Have an image sent as soon as it is decoded."""
        passing = [other for other in self._sent if other not in self._kept]
        for unused in passing[: max(len(passing) + 1 - MOST_PASSING, 0)]:
            del self._sent[unused]
        self._sent[number] = self._thread.submit(self._ship, image)

    def _ship(self, image: Future[DecodedImage]) -> tuple[Layout, Shipment]:
        placed = PlacedImage.on_host(image.result())
        return placed.layout, self._upload.send(placed.tensors)

    def get(self, number: int) -> PlacedImage:
        """An image on the device; waits for it to be decoded and sent, not for its arrival.

        Raises:
            DataError: it does not decode.
        """
        if number not in self._sent:
            self.send(number, self._request(number))
        coming = self._sent.pop(number)
        try:
            layout, shipment = coming.result()
        except CancelledError:  # A later request took its place in the cache.
            return self.get(number)
        if number in self._kept:
            self._sent[number] = coming
        return layout.image(self._upload.receive(shipment))

    def close(self) -> None:
        """Stop sending, and free the device's memory."""
        self._thread.shutdown(cancel_futures=True)
        self._sent.clear()
