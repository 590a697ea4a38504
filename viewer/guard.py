"""Guard: lets nobody in who does not know the secret that the page's address begins with.

viser has no access control. Its page opens the websocket at its own address, so that a secret in
the path reaches both: every request is refused unless its path begins with it. The check is made
where viser's server is made, before viser sees a request.
"""

from __future__ import annotations

import functools
import hmac
import http
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from gsfw.core.errors import UnavailableError

REFUSAL = b"This page needs the whole address that gsfw printed, with its secret.\n"

_starting = threading.Lock()
"""One server starts at a time: the name that viser looks up is replaced meanwhile."""


def without_secret(path: str, secret: str) -> str | None:
    """The path behind the secret, with its slash; ``None`` if it does not begin with it."""
    _, _, rest = path.partition("/")
    given, _, behind = rest.partition("?")[0].partition("/")
    if not hmac.compare_digest(given.encode(), secret.encode()):
        return None
    return f"/{behind}"


@contextmanager
def guarded(listening: socket.socket, secret: str) -> Iterator[None]:
    """Make the viser server that starts inside listen on a given socket, behind a secret.

    Args:
        listening: bound to its address.
        secret: the first part of every path.

    Raises:
        UnavailableError: the installed viser does not start as expected; it is not left open.
    """
    from websockets.asyncio import server

    original, used = server.serve, False

    def serve(handler: Callable[..., Any], host: str, port: int, **settings: Any) -> Any:  # noqa: ANN401
        nonlocal used
        used = True
        inner = settings.pop("process_request")
        checked = functools.partial(_checked, secret, inner)
        return original(handler, sock=listening, process_request=checked, **settings)

    with _starting:
        server.serve = serve  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            server.serve = original  # type: ignore[misc]
    if not used:
        raise UnavailableError(
            "this version of viser starts its server in an unknown way, without a check of who "
            "may see the page.",
            "Install the tested one: pip install 'viser==1.1.1'",
        )


def _checked(secret: str, inner: Callable[..., Any], connection: Any, request: Any) -> Any:  # noqa: ANN401
    """The answer to a request: viser's own, or a refusal."""
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    path = without_secret(request.path, secret)
    if path is None:
        headers = Headers({"Content-Type": "text/plain", "Content-Length": str(len(REFUSAL))})
        return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", headers, REFUSAL)
    request.path = path
    answer = inner(connection, request)
    if answer is not None:  # The secret must not leave in a link's referrer.
        answer.headers["Referrer-Policy"] = "no-referrer"
        answer.headers["Cache-Control"] = "no-store"
    return answer
