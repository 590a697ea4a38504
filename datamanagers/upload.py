"""Upload: how pictures get to a device ahead of use, without anyone waiting for the copy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Shipment:
    """Tensors on their way to a device."""

    tensors: tuple[Tensor, ...]
    """Not to be touched before ``Upload.receive`` has given them out."""
    sent: torch.cuda.Event | None = None
    """Passes when they have arrived; ``None`` when they have already."""


class Upload(ABC):
    """Brings tensors from the memory of the host to one device."""

    @abstractmethod
    def send(self, tensors: tuple[Tensor, ...]) -> Shipment:
        """Start to copy tensors that nobody changes meanwhile; may be called in any thread."""

    @abstractmethod
    def receive(self, shipment: Shipment) -> tuple[Tensor, ...]:
        """What was sent, for all work that the calling thread starts from now on.

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
    """The way to a device; ``None`` for the CPU, where pictures are used where they are."""
    if device.type == "cpu":
        return None
    return CudaUpload(device) if device.type == "cuda" else PlainUpload(device)
