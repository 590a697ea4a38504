"""The server: who may see the page, and what the others cannot do."""

import http.client
import re
import socket
import stat
import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import viser
from support.viewer_page import open_page, pose_message
from support.viewing import served, still_model
from websockets.client import ClientProtocol
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.protocol import State
from websockets.uri import parse_uri

from gsfw.commands.main import main
from gsfw.core.errors import ConfigError, UnavailableError
from gsfw.viewer.browser import browser_on
from gsfw.viewer.config import ViewerConfig
from gsfw.viewer.guard import guarded, without_secret
from gsfw.viewer.server import ViewerServer, bound, check_installed
from gsfw.viewer.view_state import Pose

FRONT = Pose((0.0, 0.0, -4.0), (1.0, 0.0, 0.0, 0.0), 0.8)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A session that several tests talk to."""
    with served(tmp_path_factory.mktemp("viewer"), still_model()) as session:
        yield session


def status(port, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    try:
        connection.request("GET", path, headers=headers)
        return connection.getresponse().status
    finally:
        connection.close()


def gets_a_frame(small):
    with open_page(small.server.address) as page:
        page.look(FRONT)
        return page.wait_for_frame(width=64)


@pytest.mark.slow
def test_a_page_gets_the_frame_of_its_camera(small):
    assert gets_a_frame(small).shape == (48, 64, 3)


def test_a_camera_that_moves_changes_the_frame(small):
    with open_page(small.server.address) as page:
        page.look(FRONT)
        first = page.wait_for_frame(width=64)
        page.look(Pose((1.0, 0.5, -4.0), (1.0, 0.0, 0.0, 0.0), 0.8))
        second = page.wait_for_frame(width=64)
    assert (first.astype(int) - second).any()


@pytest.mark.parametrize("path", ["/", "/wrong/", "/index.html", "//", "/%2e%2e/"])
def test_nothing_is_served_without_the_secret(small, path):
    assert status(small.server.port, path) == 403


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},  # A name that leads here: DNS rebinding.
        {"Origin": "https://evil.example", "Upgrade": "websocket", "Connection": "Upgrade"},
    ],
)
def test_pages_of_others_do_not_know_the_secret_and_are_refused(small, headers):
    assert status(small.server.port, "/", **headers) == 403


def test_the_page_is_served_with_the_secret(small):
    assert status(small.server.port, f"/{small.server.secret}/") == 200


def test_files_beside_the_page_are_not_served(small):
    assert status(small.server.port, f"/{small.server.secret}/../../_viser.py") == 404


def test_a_websocket_with_a_wrong_secret_is_refused_and_others_go_on(small):
    wrong = small.server.address.replace(small.server.secret, "x" * len(small.server.secret))
    with pytest.raises(InvalidStatus, match="403"), open_page(wrong):
        pass
    assert gets_a_frame(small).any()


@pytest.mark.parametrize("garbage", [b"\x00\xff" * 500, "text", b"", b"\x81\xa4type\xa4Nope"])
def test_garbage_of_a_page_harms_no_other(small, garbage):
    with open_page(small.server.address) as page:
        page.send(garbage)
        time.sleep(0.1)
    assert gets_a_frame(small).any()
    assert small.thread.is_alive()


def test_garbage_on_the_socket_harms_no_page(small):
    with socket.create_connection(("127.0.0.1", small.server.port)) as raw:
        raw.sendall(b"\x16\x03\x01" + b"\xff" * 4000)
    assert gets_a_frame(small).any()


def test_a_page_that_dies_in_mid_frame_harms_no_other(small):
    for _ in range(3):
        with open_page(small.server.address, (320, 240)) as page:
            page.look(FRONT)
            page._socket.socket.close()  # Without a farewell.
    assert gets_a_frame(small).any()


def test_ten_pages_are_all_served(small):
    from contextlib import ExitStack

    with ExitStack() as stack:
        pages = [stack.enter_context(open_page(small.server.address)) for _ in range(10)]
        for page in pages:
            page.look(FRONT)
        assert all(page.wait_for_frame(width=64).any() for page in pages)


def test_closed_pages_are_forgotten(small):
    assert gets_a_frame(small).any()
    end = time.monotonic() + 20
    while small.session.service.pages and time.monotonic() < end:
        time.sleep(0.02)
    assert small.session.service.pages == 0


def test_it_listens_on_this_machine_alone(small):
    with bound(0) as listening:
        assert listening.getsockname()[0] == "127.0.0.1"
    assert small.server.address.startswith("http://127.0.0.1:")
    with pytest.raises(OSError, match=r"refused|unreachable"):
        socket.create_connection((other_address(), small.server.port), timeout=2).close()


def other_address() -> str:
    """An address of this machine that is not 127.0.0.1; that of its network, if it has one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # Nothing is sent.
            found: str = probe.getsockname()[0]
        except OSError:
            return "127.0.0.2"
    return found


def test_the_ssh_line_forwards_the_port_and_names_user_and_machine(small):
    line = re.fullmatch(r"ssh -L (\d+):127\.0\.0\.1:(\d+) (\S+)@(\S+)", small.server.ssh_line)
    assert line is not None
    assert line[1] == line[2] == str(small.server.port)
    assert line[4] == socket.gethostname()


def test_a_taken_port_is_a_sentence(small):
    with pytest.raises(ConfigError, match=f"port={small.server.port}") as caught:
        bound(small.server.port)
    assert "port=N" in caught.value.advice
    with pytest.raises(ConfigError, match=f"viewer.port={small.server.port}"):
        ViewerConfig(enabled=True, port=small.server.port).check()


@pytest.mark.slow
def test_a_page_that_reads_nothing_gets_no_further_frame(small):
    """The frames that fit into the buffers of the system are sent; then it is left alone."""
    rendered, make = [], small.session.service.maker.make
    small.session.service.maker.make = lambda *given: rendered.append(1) or make(*given)
    try:
        with mute_page(small.server, (640, 360)) as look:
            before, stuck, end = -1, False, time.monotonic() + 60
            while not stuck and time.monotonic() < end:
                for turn in range(20):
                    look(replace(FRONT, position=(0.01 * turn, 0.0, -4.0)))
                    time.sleep(0.05)
                before, stuck = len(rendered), len(rendered) == before
            assert stuck
            assert small.session.service.pages  # It is still open: nobody has cut it off.
    finally:
        small.session.service.maker.make = make
    assert gets_a_frame(small).any()


@contextmanager
def mute_page(server, size):
    """A page that reports its poses and reads nothing; gives the function that does so."""
    with socket.socket() as raw:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        raw.connect(("127.0.0.1", server.port))
        protocol = ClientProtocol(
            parse_uri(server.address.replace("http://", "ws://")),
            subprotocols=[f"viser-v{viser.__version__}"],
        )
        protocol.send_request(protocol.connect())
        raw.sendall(b"".join(protocol.data_to_send()))
        while protocol.state is not State.OPEN:
            protocol.receive_data(raw.recv(1))

        def look(pose):
            protocol.send_binary(pose_message(pose, size))
            raw.sendall(b"".join(protocol.data_to_send()))

        yield look


@pytest.fixture
def home(tmp_path, monkeypatch) -> Path:
    """A home of its own, as environment variables tell it."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    return tmp_path / "home"


@pytest.mark.skipif(sys.platform == "win32", reason="modes of files are those of Unix")
def test_the_secret_is_in_a_file_of_the_user_and_not_on_a_command_line(monkeypatch, home):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    with browser_on("http://127.0.0.1:8080/secret/", home / "runs"):
        (given,) = opened
        assert "8080" not in given
        file = Path(given.removeprefix("file://"))
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        assert "url=http://127.0.0.1:8080/secret/" in file.read_text()
    assert not file.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="snaps are for Linux")
@pytest.mark.parametrize(
    ("folder", "expected"),
    [("runs/fox", "runs/fox"), (".hidden/fox", ".cache/gsfw"), ("../elsewhere", ".cache/gsfw")],
)
def test_a_browser_that_sees_only_the_visible_home_sees_the_file(
    monkeypatch, home, folder, expected
):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    (home / folder).mkdir(parents=True)
    with browser_on("http://127.0.0.1:8080/secret/", home / folder):
        assert Path(opened[0].removeprefix("file://")).parent == home / expected


def test_a_taken_port_is_said_before_anything_is_loaded(small, capsys, monkeypatch):
    monkeypatch.setattr("gsfw.commands.interface.runs.restore_run", None)  # It is not called.
    assert main(["view", "latest", f"port={small.server.port}"]) == 2
    assert f"port={small.server.port}: this port cannot be used" in capsys.readouterr().err


def test_training_with_a_taken_port_is_refused_before_data_is_read(small, capsys, tmp_path):
    out, taken = tmp_path / "run", f"viewer.port={small.server.port}"
    assert main(["train", "method=3dgs", "viewer=true", taken, f"out={out}"]) == 2
    told = capsys.readouterr().err
    assert f"{taken}: this port cannot be used" in told
    assert "viewer.port=N" in told
    assert not out.exists()


def test_without_viser_the_remedy_is_said(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UnavailableError, match="not installed") as caught:
        check_installed()
    assert caught.value.advice == "pip install 'gsfw[viewer]'"


def test_a_viser_that_starts_otherwise_is_not_left_open():
    with (
        socket.socket() as listening,
        pytest.raises(UnavailableError, match="who may see"),
        guarded(listening, "secret"),
    ):
        pass  # It started no server that can be guarded.


def test_the_secret_is_the_whole_first_part_of_a_path():
    assert without_secret("/secret/", "secret") == "/"
    assert without_secret("/secret", "secret") == "/"
    assert without_secret("/secret/a/b?c=d", "secret") == "/a/b"
    for path in ("/", "/secre/", "/secret2/", "/a/secret/", "/?secret", "secret"):
        assert without_secret(path, "secret") is None


def test_secrets_differ():
    first, second = ViewerServer(bound(0)), ViewerServer(bound(0))
    try:
        assert first.secret != second.secret
        assert len(first.secret) >= 20
    finally:
        first.close()
        second.close()


def test_a_closed_connection_is_no_frame(small):
    with open_page(small.server.address) as page, pytest.raises((ConnectionClosed, TimeoutError)):
        page.wait_for_frame(seconds=0.5)  # It never told a camera.
