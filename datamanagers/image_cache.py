"""ImageCache: decoded images within a memory budget, decoded by threads ahead of use."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from gsfw.core.cores import cores
from gsfw.datamanagers.images import DecodedImage


class ImageCache:
    """Keeps the images that were used last; what is asked for never depends on what is kept."""

    def __init__(
        self, decode: Callable[[int], DecodedImage], sizes: Sequence[int], budget: int
    ) -> None:
        """Nothing is decoded yet.

        Args:
            decode: gives an image by its number; called from several threads.
            sizes: bytes that each image takes once decoded.
            budget: bytes that all of them may take; one image is kept even if it takes more.
        """
        self.sizes = sizes
        self._decode = decode
        self._budget = budget
        self._held: OrderedDict[int, Future[DecodedImage]] = OrderedDict()
        self._used = 0
        self._pool = ThreadPoolExecutor(min(4, cores()), "gsfw-decode")

    def get(self, index: int) -> DecodedImage:
        """The image, waiting for it to be decoded if need be.

        Raises:
            DataError: it does not decode.
        """
        return self.request(index).result()

    def prefetch(self, indices: Sequence[int]) -> dict[int, Future[DecodedImage]]:
        """Start decoding, as far as half of the budget goes: the rest stays for what is in use.

        Gives the images that were started or are held already, by their number.
        """
        ahead, started = 0, {}
        for index in indices:
            ahead += self.sizes[index]
            if 2 * ahead > self._budget:
                break
            started[index] = self.request(index)
        return started

    def halve(self) -> int:
        """Halve the budget; images that were used last stay. Returns the number of freed bytes."""
        before = self._used
        self._budget = min(self._budget, before) // 2
        self._make_room(0)
        return before - self._used

    def close(self) -> None:
        """Stop decoding and free the images."""
        self._pool.shutdown(cancel_futures=True)
        self._held.clear()
        self._used = 0

    def request(self, index: int) -> Future[DecodedImage]:
        """The image as soon as it is decoded; cancelled where others need its room before."""
        if index in self._held:
            self._held.move_to_end(index)
            return self._held[index]
        self._make_room(self.sizes[index])
        self._used += self.sizes[index]
        self._held[index] = self._pool.submit(self._decode, index)
        return self._held[index]

    def _make_room(self, size: int) -> None:
        """Drop the images that were not used for longest, until ``size`` bytes more fit."""
        while self._held and self._used + size > self._budget:
            oldest, future = self._held.popitem(last=False)
            future.cancel()
            self._used -= self.sizes[oldest]
