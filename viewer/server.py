"""ViewerServer: the web server of the page: localhost only, behind a secret, for several pages."""

from __future__ import annotations

import asyncio
import io
import logging
import os
import secrets
import socket
import warnings
from contextlib import redirect_stdout
from getpass import getuser
from typing import TYPE_CHECKING, Any

from gsfw.core.errors import ConfigError, UnavailableError
from gsfw.viewer.guard import guarded

if TYPE_CHECKING:
    import viser

    from gsfw.viewer.page import Pages
    from gsfw.viewer.session import Session

HOST = "127.0.0.1"
"""Nobody but this machine reaches it; from elsewhere, ssh forwards the port."""
FIRST_PORT, TRIED_PORTS = 8080, 50
"""Without a given port, the first free one of these."""
UNDERWAY = 1 << 17
"""Bytes that may be on their way to a page, a few frames: the usual megabytes would be seconds of a
slow connection, in which the page lags behind."""

logger = logging.getLogger(__name__)


def check_installed() -> None:
    """Check that viser is there, without importing it.

    Raises:
        UnavailableError: it is not.
    """
    from importlib.util import find_spec

    if find_spec("viser") is None:
        raise UnavailableError(
            "the viewer needs viser, which is not installed.", "pip install 'gsfw[viewer]'"
        )


class ViewerServer:
    """Serves the page at an address that holds a secret."""

    def __init__(self, listening: socket.socket) -> None:
        """Start to listen.

        Args:
            listening: the socket of ``bound``; it belongs to the server from now on.

        Raises:
            UnavailableError: viser is not installed, or starts in an unknown way.
        """
        check_installed()
        import viser

        self.port: int = listening.getsockname()[1]
        self.secret = secrets.token_urlsafe(16)
        logging.getLogger("websockets").addHandler(logging.NullHandler())
        logging.getLogger("websockets").propagate = False
        # viser prints its address, which lacks the secret.
        with guarded(listening, self.secret), redirect_stdout(io.StringIO()):
            self.viser: viser.ViserServer = viser.ViserServer(HOST, self.port, verbose=False)
        self.viser.get_event_loop().set_exception_handler(_note)

    @property
    def address(self) -> str:
        """Address of the page, with its secret."""
        return f"http://{HOST}:{self.port}/{self.secret}/"

    @property
    def ssh_line(self) -> str:
        """The command on another machine, after which the address works there too."""
        return f"ssh -L {self.port}:{HOST}:{self.port} {_user()}@{socket.gethostname()}"

    def start(self, session: Session, pages: Pages) -> None:
        """Show the scene on every page that opens."""
        warnings.filterwarnings("ignore", "Queued a .* on a closed connection")  # Pages close.
        first, scene = session.first, self.viser.scene
        scene.set_up_direction(first.up)
        scene.world_axes.visible = False
        start = self.viser.initial_camera
        start.position, start.look_at = first.pose.position, first.target
        start.up, start.fov = first.up, first.pose.fov
        start.near, start.far = 1e-3 * first.size, 1e3 * first.size
        self.viser.on_client_connect(pages.opened)
        self.viser.on_client_disconnect(pages.gone)

    def close(self) -> None:
        """Stop to listen, and close all pages."""
        with redirect_stdout(io.StringIO()):
            self.viser.stop()


def bound(port: int, key: str = "port") -> socket.socket:
    """A socket that listens on the port, or on the first free one.

    Args:
        port: 0 for the first free one.
        key: key of the port, for the message.

    Raises:
        ConfigError: the port is taken, or may not be used.
    """
    last: OSError | None = None
    for candidate in [port] if port else [*range(FIRST_PORT, FIRST_PORT + TRIED_PORTS), 0]:
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            if os.name == "posix":  # Elsewhere it would take the port from who has it.
                listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNDERWAY)
            listening.bind((HOST, candidate))
            # Two sockets may be bound, but only one may listen.
            listening.listen(16)
            return listening
        except (OSError, OverflowError) as error:
            listening.close()
            last = error if isinstance(error, OSError) else None
    raise ConfigError(
        f"{key}={port}: this port cannot be used ({last.strerror if last else 'out of range'}).",
        f"Choose another with {key}=N, or leave it out: then the first free one is taken.",
    )


def _user() -> str:
    try:
        return getuser()
    except (KeyError, OSError):  # A container may have no name for its user.
        return "USER"


def _note(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Garbage on a socket fails in a task of viser's; the others go on."""
    logger.debug("a connection failed: %s", context.get("exception") or context.get("message"))
