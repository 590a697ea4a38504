"""A host of files on this machine, as any static host on the web."""

import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

PIECE = 1 << 15


class Address(str):
    """Address of a host, with a slash at the end."""

    sent: Counter[str]
    """Bytes that it has sent, by path; a browser may drop some of them."""


class _Files(SimpleHTTPRequestHandler):
    def __init__(self, *arguments, address: Address, pause: float, **named) -> None:
        self.address, self.pause = address, pause
        super().__init__(*arguments, **named)

    def copyfile(self, source, outputfile) -> None:
        path = self.path.partition("?")[0]
        try:
            while piece := source.read(PIECE):
                outputfile.write(piece)
                self.address.sent[path] += len(piece)
                time.sleep(self.pause)
        except ConnectionError:
            pass  # The browser wants no more.

    def log_message(self, format, *arguments) -> None:
        """Nothing is printed."""


@contextmanager
def hosted(folder: Path, bytes_a_second: float = float("inf")) -> Iterator[Address]:
    """Serve a folder, at some speed at most."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Files)
    address = Address(f"http://127.0.0.1:{server.server_address[1]}/")
    address.sent = Counter()
    server.RequestHandlerClass = partial(
        _Files, directory=str(folder), address=address, pause=PIECE / bytes_a_second
    )
    thread = Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    try:
        yield address
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
