"""Chromium without a screen, driven over its DevTools protocol; for tests of pages."""

from __future__ import annotations

import base64
import http.client
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from websockets.sync.client import ClientConnection, connect

EXECUTABLE = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)

needs_chromium = pytest.mark.skipif(
    EXECUTABLE is None, reason="no Chromium on this machine; Debian's package is chromium"
)
"""Mark of the tests that open a page."""

FLAGS = (
    *("--headless=new", "--no-sandbox", "--no-first-run", "--mute-audio", "--hide-scrollbars"),
    # WebGL in software; a page's own pictures do not need a GPU either.
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu"),
    # The machine may have little shared memory, and no network.
    *("--disable-dev-shm-usage", "--disable-background-networking", "--disable-sync"),
    *("--disable-component-update", "--disable-default-apps", "--disable-extensions"),
    # A page in the background is to be as lively as the one in front: several are tested at once.
    *("--disable-background-timer-throttling", "--disable-renderer-backgrounding"),
    "--disable-backgrounding-occluded-windows",
)

REST_SECONDS = 0.25
"""Time without a move after which an element stands still: several frames, in seconds."""

START_SECONDS = 60.0
"""Longest start of the browser; a busy machine needs more than ten."""


@dataclass(frozen=True)
class Message:
    """A line of a page's console."""

    level: str
    """"log", "warning", "error", ...; "error" too for an exception that nothing caught."""
    text: str


class PageError(RuntimeError):
    """JavaScript that raised, or a command that the browser refused."""


class Page:
    """One open page. Coordinates are CSS pixels from its upper left corner."""

    def __init__(self, browser: Chromium, target: str, address: str) -> None:
        self.target = target
        self._browser, self._numbers = browser, count(1)
        self._messages: list[Message] = []
        self._requests: list[str] = []
        self._socket: ClientConnection = connect(
            address, max_size=None, open_timeout=START_SECONDS, proxy=None, compression=None
        )
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.command(f"{domain}.enable")

    def command(self, method: str, seconds: float = 60.0, **parameters: Any) -> dict[str, Any]:
        """Send a DevTools command and wait for its result.

        Raises:
            PageError: the browser refused it.
            TimeoutError: there was no answer within ``seconds``.
        """
        number, end = next(self._numbers), time.monotonic() + seconds
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=max(0.0, end - time.monotonic())))
            if answer.get("id") != number:
                self._note(answer)
            elif "error" in answer:
                raise PageError(f"{method}: {answer['error']['message']}")
            else:
                return answer["result"]

    def open(self, url: str) -> None:
        """Go to an address, or open a file by ``path.as_uri()``; wait until it is loaded."""
        self.command("Page.navigate", url=url)
        self.wait_for("document.readyState === 'complete'")

    def evaluate(self, expression: str, seconds: float = 180.0) -> Any:
        """Value of a JavaScript expression as plain data; promises are awaited.

        Raises:
            PageError: it raised.
        """
        result = self.command(
            "Runtime.evaluate",
            seconds,
            expression=expression,
            returnByValue=True,
            awaitPromise=True,
            userGesture=True,
        )
        if "exceptionDetails" in result:
            raise PageError(_exception(result["exceptionDetails"]))
        return result["result"].get("value")

    def wait_for(self, expression: str, seconds: float = 180.0) -> Any:
        """Wait until a JavaScript expression is true, and return its value.

        Raises:
            AssertionError: it never was within ``seconds``; lists the console.
        """
        end = time.monotonic() + seconds
        while not (value := self.evaluate(expression)):
            if time.monotonic() > end:
                raise AssertionError(f"never true: {expression}; console: {self.messages()}")
            time.sleep(0.05)
        return value

    def text(self) -> str:
        """All visible text."""
        return str(self.evaluate("document.body.innerText"))

    def click(self, target: str | tuple[float, float]) -> None:
        """Click a place, or the middle of the element of a CSS selector."""
        x, y = self.middle(target) if isinstance(target, str) else target
        self.move(x, y)
        self._mouse("mousePressed", x, y, button="left", clickCount=1)
        self._mouse("mouseReleased", x, y, button="left", clickCount=1)

    def click_text(self, text: str, selector: str = "button, a, label, [role], summary") -> None:
        """Click the smallest visible element that has exactly this text, once it stands still.

        A click that misses, because the page moved the element meanwhile, is repeated once.
        """
        place = f"""(() => {{
              const found = [...document.querySelectorAll({json.dumps(selector)})].filter(
                (item) => item.innerText?.trim() === {json.dumps(text)}
                  && item.getClientRects().length);
              if (!found.length) return null;
              found.sort((a, b) => a.innerHTML.length - b.innerHTML.length);
              found[0].scrollIntoView({{block: "nearest"}});
              const box = found[0].getBoundingClientRect();
              return [box.x + box.width / 2, box.y + box.height / 2];
            }})()"""
        self.evaluate(
            f"""(() => {{
              window.hit = false;
              document.addEventListener("click", (event) => {{
                for (let item = event.target; item; item = item.parentElement)
                  if (item.innerText?.trim() === {json.dumps(text)}) window.hit = true;
              }}, {{capture: true, once: true}});
            }})()"""
        )
        self.click(self._at_rest(place))
        if not self.evaluate("window.hit"):
            self.click(self._at_rest(place))

    def _at_rest(self, place: str) -> tuple[float, float]:
        """The place that a JavaScript expression gives, when it has been the same for a while.

        What a page adds meanwhile moves its elements; a click would miss them.
        """
        before, now = None, self.wait_for(place)
        while now != before:
            time.sleep(REST_SECONDS)
            before, now = now, self.wait_for(place)
        return now[0], now[1]

    def middle(self, selector: str) -> tuple[float, float]:
        """Middle of the first element of a CSS selector, scrolled into view."""
        x, y = self.wait_for(
            f"""(() => {{
              const item = document.querySelector({json.dumps(selector)});
              if (!item) return null;
              item.scrollIntoView({{block: "nearest"}});
              const box = item.getBoundingClientRect();
              return [box.x + box.width / 2, box.y + box.height / 2];
            }})()"""
        )
        return x, y

    def move(self, x: float, y: float) -> None:
        """Move the mouse."""
        self._mouse("mouseMoved", x, y)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag with the left button, in ten moves."""
        self.move(*start)
        self._mouse("mousePressed", *start, button="left", buttons=1, clickCount=1)
        for part in range(1, 11):
            x, y = (a + (b - a) * part / 10 for a, b in zip(start, end, strict=True))
            self._mouse("mouseMoved", x, y, button="left", buttons=1)
        self._mouse("mouseReleased", *end, button="left", clickCount=1)

    def wheel(self, x: float, y: float, pixels: float) -> None:
        """Turn the wheel over a place; positive is down."""
        self._mouse("mouseWheel", x, y, deltaX=0, deltaY=pixels)

    def type(self, text: str) -> None:
        """Type text into what has the focus."""
        self.command("Input.insertText", text=text)

    def press(self, key: str, code: int) -> None:
        """Press a key by its DOM name and its Windows code: ``press("Enter", 13)``."""
        for kind in ("rawKeyDown", "keyUp"):
            self.command("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code)

    def resize(self, width: int, height: int, scale: float = 1.0) -> None:
        """Change the size of the page, in CSS pixels, and the device pixels per CSS pixel."""
        self.command(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=False,
        )

    def prefer(self, scheme: str) -> None:
        """Prefer "dark" or "light" pages."""
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.command("Emulation.setEmulatedMedia", features=[feature])

    def offline(self) -> None:
        """Cut the page off from every network."""
        self.command(
            "Network.emulateNetworkConditions",
            offline=True,
            latency=0,
            downloadThroughput=-1,
            uploadThroughput=-1,
        )

    def screenshot(self, path: Path | None = None) -> np.ndarray:
        """The visible part of the page as [h w 3] uint8; written to ``path`` as PNG too."""
        taken = self.command("Page.captureScreenshot")
        content = base64.b64decode(taken["data"])
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        return np.asarray(Image.open(BytesIO(content)).convert("RGB"))

    def to_front(self) -> None:
        """Bring the page to the front: only there the browser draws, and takes the mouse."""
        self.command("Page.bringToFront")

    def messages(self) -> list[Message]:
        """All lines of the console so far; what the browser itself says of the page included."""
        self.evaluate("0")  # Events come in order: those of before are read now.
        return list(self._messages)

    def errors(self, allowed: tuple[str, ...] = ()) -> list[str]:
        """Errors of the console that contain none of the allowed texts."""
        return [
            message.text
            for message in self.messages()
            if message.level == "error" and not any(part in message.text for part in allowed)
        ]

    def requests(self) -> list[str]:
        """Addresses of all requests so far, except those of content that the page itself holds."""
        self.evaluate("0")
        return list(self._requests)

    def close(self) -> None:
        """Close the page, and the connection to it."""
        self._socket.close()
        self._browser.request("GET", f"/json/close/{self.target}")

    def _mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        self.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def _note(self, event: dict[str, Any]) -> None:
        """Remember what an event says."""
        values = event.get("params", {})
        match event.get("method"):
            case "Runtime.consoleAPICalled":
                words = (item.get("value", item.get("description", "")) for item in values["args"])
                self._messages.append(Message(values["type"], " ".join(map(str, words))))
            case "Runtime.exceptionThrown":
                self._messages.append(Message("error", _exception(values["exceptionDetails"])))
            case "Log.entryAdded":
                entry = values["entry"]
                text = f"{entry['text']} {entry.get('url', '')}".strip()
                self._messages.append(Message(entry["level"], text))
            case "Network.requestWillBeSent":
                url = values["request"]["url"]
                if not url.startswith(("data:", "blob:")):
                    self._requests.append(url)
            case "Page.javascriptDialogOpening":  # It would stop the page for ever.
                command = {"method": "Page.handleJavaScriptDialog", "params": {"accept": True}}
                self._socket.send(json.dumps({"id": next(self._numbers), **command}))


class Chromium:
    """A running browser."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._pages: list[Page] = []

    def open(self, url: str = "about:blank", size: tuple[int, int] = (1280, 720)) -> Page:
        """A new page of this size, at an address."""
        created = json.loads(self.request("PUT", "/json/new?about:blank"))
        page = Page(self, created["id"], created["webSocketDebuggerUrl"])
        self._pages.append(page)
        page.resize(*size)
        if url != "about:blank":
            page.open(url)
        return page

    def request(self, verb: str, path: str) -> bytes:
        """Ask the browser itself, over HTTP."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=START_SECONDS)
        try:
            connection.request(verb, path)
            return connection.getresponse().read()
        finally:
            connection.close()

    def disconnect(self) -> None:
        """Close the connections to all pages."""
        for page in self._pages:
            page._socket.close()


@contextmanager
def chromium(profile: Path) -> Iterator[Chromium]:
    """Start a browser, and end it in any case.

    Args:
        profile: an empty folder for its files, such as ``tmp_path / "chromium"``.
    """
    assert EXECUTABLE is not None, "mark the test with needs_chromium"
    command = [EXECUTABLE, *FLAGS, f"--user-data-dir={profile}"]
    process = subprocess.Popen(
        [*command, "--remote-debugging-port=0", "about:blank"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        browser = Chromium(_port(process, profile / "DevToolsActivePort"))
        try:
            yield browser
        finally:
            browser.disconnect()
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _port(process: subprocess.Popen[bytes], file: Path) -> int:
    """The port of the DevTools, which the browser chooses and writes into its profile."""
    end = time.monotonic() + START_SECONDS
    while time.monotonic() < end and process.poll() is None:
        if file.is_file() and (lines := file.read_text().splitlines()):
            return int(lines[0])
        time.sleep(0.05)
    raise RuntimeError(f"{EXECUTABLE} did not start; exit code {process.poll()}")


def _exception(details: dict[str, Any]) -> str:
    """Text of a JavaScript exception."""
    thrown = details.get("exception", {})
    return str(thrown.get("description") or thrown.get("value") or details["text"])
