"""The campaign without a network: it finds what reaches for others, in Python and natively."""

import sys
from pathlib import Path

import pytest
from contact_log import contact
from no_network import SCENE, USES, failed, possible, use_offline
from support.plugin_files import HEAD, hook
from without_network import has_strace, is_here, refusal, run_offline

from gsfw.plugins.registry import installed

needs_namespaces = pytest.mark.skipif(bool(refusal()), reason=refusal() or "can run offline")
needs_strace = pytest.mark.skipif(not has_strace(), reason="native calls are seen by strace alone")

ASKS = "import socket; socket.socket(socket.AF_INET, socket.SOCK_DGRAM).connect(('192.0.2.7', 9))"
"""A connection of datagrams: without a network it fails, and nothing is sent with one."""
ASKS_FOR_A_NAME = "import socket\ntry: socket.getaddrinfo('example.com', 80)\nexcept OSError: pass"
NATIVE = "import _socket; _socket.socket(2, 2).connect_ex(('192.0.2.8', 9))"
LISTENS = "import socket; socket.create_server(('', 0))"
LOCAL = """
import socket
server = socket.create_server(("127.0.0.1", 0))
socket.create_connection(server.getsockname()).close()
"""


def offline(folder: Path, program: str, *options: str):
    return run_offline((sys.executable, *options, "-c", program), folder)


def test_every_verb_has_a_use():
    assert {use[0] for use in USES} == set(installed().slot("command"))


def test_hosts_of_this_machine_are_told_from_others():
    here = ("127.0.0.1", "127.8.8.8", "::1", "::ffff:127.0.0.1", "[::1]", "localhost")
    elsewhere = ("0.0.0.0", "::", "10.0.0.1", "::ffff:10.0.0.1", "example.com", "192.0.2.7%eth0")
    assert all(map(is_here, here))
    assert not any(map(is_here, elsewhere))


def test_sockets_of_files_are_no_contacts():
    assert contact("socket.connect", (None, "/run/x.sock")) == ""
    assert contact("socket.connect", (None, ("192.0.2.7", 9))) == "192.0.2.7"
    assert contact("socket.getaddrinfo", (b"example.com", 80, 0, 0, 0)) == "example.com"
    assert contact("open", ("a.txt", "r", 0)) == ""


@needs_namespaces
def test_what_reaches_for_a_host_is_found(tmp_path):
    assert offline(tmp_path, ASKS).reached == ("192.0.2.7",)


@needs_namespaces
def test_who_asks_for_a_name_is_found(tmp_path):
    watched = offline(tmp_path, ASKS_FOR_A_NAME)
    assert watched.code == 0
    assert "example.com" in watched.reached


@needs_namespaces
@needs_strace
def test_without_the_hook_native_calls_are_found(tmp_path):
    assert offline(tmp_path, NATIVE, "-S").reached == ("192.0.2.8",)


@needs_namespaces
@needs_strace
def test_what_listens_on_every_interface_is_found(tmp_path):
    assert len(offline(tmp_path, LISTENS).open_to) == 1


@needs_namespaces
def test_loopback_is_there_and_is_no_contact(tmp_path):
    watched = offline(tmp_path, LOCAL)
    assert (watched.code, watched.reached, watched.open_to) == (0, (), ())


@pytest.mark.slow
@needs_namespaces
def test_verbs_work_without_a_network_and_a_plugin_that_connects_is_found(tmp_path):
    train = ("train", "method=3dgs", *SCENE, "steps=2", "report=false", "out=run")
    uses = (train, ("eval", "run"), ("view", "run"), ("export", "run", "out=a.ply"), ("doctor",))
    used, watched = use_offline(possible(uses), tmp_path)
    assert not failed(used, watched, possible(uses))
    assert (watched.reached, watched.open_to) == ((), ())

    plugin = tmp_path / "calls_home.py"
    calls = ASKS.replace("; ", "\ntry: ", 1) + "\nexcept OSError: pass\n"
    plugin.write_text(f"{HEAD}\n{calls}\n{hook('gsfw_samplers', 'return []')}")
    used, watched = use_offline([("plugins",)], tmp_path, {"GSFW_PLUGIN_PATH": str(plugin)})
    assert watched.reached == ("192.0.2.7",)


@pytest.mark.slow
@needs_namespaces
def test_a_use_that_fails_is_named(tmp_path):
    uses = [("info", "missing.ply"), ("plugins",)]
    used, watched = use_offline(uses, tmp_path)
    (line,) = failed(used, watched, uses)
    assert line.startswith("info missing.ply: exit 2: ")
    assert "error: data=missing.ply: there is no such file or folder." in line
