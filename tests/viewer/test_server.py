"""The server: who may see the page, and what the others cannot do."""

import http.client
import socket
import time

import pytest
from support.viewer_page import open_page
from support.viewing import served, still_model
from websockets.exceptions import ConnectionClosed, InvalidStatus

from gsfw.core.errors import ConfigError, UnavailableError
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


def status(port, path):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    try:
        connection.request("GET", path)
        return connection.getresponse().status
    finally:
        connection.close()


def gets_a_frame(small):
    with open_page(small.server.address) as page:
        page.look(FRONT)
        return page.wait_for_frame(width=64)


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
    assert f"-L {small.server.port}:127.0.0.1:{small.server.port}" in small.server.ssh_line


def test_a_taken_port_is_a_sentence(small):
    with pytest.raises(ConfigError, match=f"port={small.server.port}") as caught:
        bound(small.server.port)
    assert "port=N" in caught.value.advice
    with pytest.raises(ConfigError, match=f"viewer.port={small.server.port}"):
        ViewerConfig(enabled=True, port=small.server.port).check()


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
