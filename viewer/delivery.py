"""Delivery: whether a page takes what is sent to it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import viser

NAP_SECONDS = 0.005
"""Between two looks at the queue of a page; viser empties it every 17 ms."""


def wait_until_taken(client: viser.ClientHandle, given_up: Callable[[], bool]) -> None:
    """Wait until nothing is queued for a page any more.

    viser queues without limit, and its queue empties only as far as the page reads its socket. So a
    page that reads nothing gets no further frame, and costs no rendering.

    Args:
        client: the page.
        given_up: true once nobody waits for it any more.
    """
    queue = client._websock_connection.get_message_buffer()
    last = queue.message_counter - 1
    while not given_up() and not queue.done:
        # The lock is not taken: keys are looked at one by one, and a stale answer costs one nap.
        if not any(number <= last for number in tuple(queue.message_from_id)):
            return
        time.sleep(NAP_SECONDS)
