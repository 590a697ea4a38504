"""Data sets at addresses: what is fetched, how much stays, and what happens where it fails."""

import subprocess
import sys
import threading
import zlib
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import fsspec
import numpy as np
import pytest
import torch
from PIL import Image
from support.small_captures import ring, write_transforms

from gsfw.commands.main import main
from gsfw.core.datamanager import DataRequest, Split
from gsfw.core.errors import DataError, UnavailableError
from gsfw.core.files import mirror, remote
from gsfw.core.files.mirror import HEADS, Mirror, local_place
from gsfw.core.files.remote import is_remote
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.plugins.automatic import choose_datamanager
from gsfw.plugins.registry import installed

WIDTH, HEIGHT, VIEWS = 160, 120, 6


@pytest.fixture
def scene(tmp_path):
    """A data set whose images are larger than what is fetched for their headers."""
    folder = tmp_path / "scene"
    capture = ring(VIEWS)
    write_transforms(folder / "transforms.json", capture, w=WIDTH, h=HEIGHT)
    generator = np.random.default_rng(0)
    for name in capture.names:
        noise = generator.integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
        Image.fromarray(noise).save(folder / name)
    return folder


@pytest.fixture(autouse=True)
def fresh(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(remote, "WAIT", 0.001)
    monkeypatch.setattr(mirror, "_open", {})


@pytest.fixture
def in_memory(scene):
    files = fsspec.filesystem("memory")
    files.put(str(scene), "/scene", recursive=True)
    yield "memory://scene"
    files.store.clear()
    files.pseudo_dirs[:] = [""]


class Handler(SimpleHTTPRequestHandler):
    failing, status, asked = 0, 500, 0

    def do_GET(self):
        kind = type(self)
        if self.path.endswith(".png"):
            kind.asked += 1
            if kind.failing:
                kind.failing -= 1
                self.send_error(kind.status)
                return
        super().do_GET()

    def log_message(self, *arguments):
        pass


@pytest.fixture
def server(scene):
    class Own(Handler):
        pass

    served = ThreadingHTTPServer(("127.0.0.1", 0), partial(Own, directory=str(scene.parent)))
    thread = threading.Thread(target=served.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{served.server_port}/scene", Own
    served.shutdown()
    served.server_close()
    thread.join()


def opened(place):
    return TransformsConfig().build(DataRequest(place, eval_every_nth=0))


def pixels(data, index):
    (batch,) = data.load(Split.TRAIN, [index], torch.device("cpu"))
    return batch.images


def whole(place):
    return sorted(path.name for path in place.glob("*.png") if path.stat().st_size > HEADS[0])


@pytest.mark.parametrize("text", ["s3://a/b", "https://host/x", "memory://x", "zip::s3://a/b.zip"])
def test_addresses_are_told_from_paths(text):
    assert is_remote(text)
    assert not any(map(is_remote, ("data/x", "/data/x", "C:\\data", "C:/data", "~/x", "")))


def test_images_are_fetched_when_they_are_needed_and_are_those_of_the_store(in_memory, scene):
    place = local_place(in_memory)
    assert choose_datamanager(in_memory, installed()).name == "transforms"
    data, local = opened(place), opened(scene)
    assert data.scene.name == "scene"
    assert whole(place) == []
    assert torch.equal(pixels(data, 2), pixels(local, 2))
    assert whole(place) == ["view_002.png"]
    assert any("come as they are needed" in note for note in data.notes())
    data.close(), local.close()


def test_whole_images_keep_within_their_bound(in_memory, scene):
    size = (scene / "view_000.png").stat().st_size
    place = local_place(in_memory, int(2.5 * size))
    data, local = opened(place), opened(scene)
    for index in (0, 1, 2, 3, 4, 5, 0):
        assert torch.equal(pixels(data, index), pixels(local, index))
        assert len(whole(place)) <= 2
    data.close(), local.close()


def test_an_image_that_is_in_use_is_not_cut(in_memory):
    place = local_place(in_memory, 1)
    with mirror.held(place / "view_000.png", whole=True):
        with mirror.held(place / "view_001.png", whole=True):
            assert whole(place) == ["view_000.png", "view_001.png"]
        with mirror.held(place / "view_002.png", whole=True):
            assert "view_000.png" in whole(place)


READER = """
import sys
from pathlib import Path
from PIL import Image
from gsfw.core.files.mirror import held, local_place

place, scene = local_place(sys.argv[1], 1), Path(sys.argv[2])
names = sorted(path.name for path in scene.glob("*.png"))
for name in (names if sys.argv[3] == "up" else names[::-1]) * 10:
    with held(place / name, whole=False), Image.open(place / name) as image:
        assert image.size == (160, 120)
    with held(place / name, whole=True):
        assert (place / name).read_bytes() == (scene / name).read_bytes(), name
"""


@pytest.mark.slow
def test_two_processes_share_a_folder_and_neither_cuts_what_the_other_reads(scene):
    command = [sys.executable, "-c", READER, f"file://{scene}", str(scene)]
    started = [subprocess.Popen([*command, way]) for way in ("up", "up", "down")]
    assert [process.wait() for process in started] == [0, 0, 0]


def test_an_image_that_another_run_has_cut_is_fetched_again(in_memory, scene):
    runs = Mirror(in_memory, 1), Mirror(in_memory, 1)
    names = [runs[0].path / f"view_{index:03}.png" for index in (0, 1)]
    for _ in range(3):
        for mine, other in (runs, runs[::-1]):
            with mine.held(names[0], whole=True):
                for path in names[::-1]:
                    with other.held(path, whole=True):
                        assert path.read_bytes() == (scene / path.name).read_bytes()
                assert names[0].read_bytes() == (scene / names[0].name).read_bytes()


def test_an_image_is_not_cut_within_its_header(in_memory, scene):
    long = (scene / "view_000.png").read_bytes()
    start = long[:33]  # The signature, and the chunk with the size.
    filler = (40_000).to_bytes(4, "big") + b"teSt" + bytes(40_000)
    filler += zlib.crc32(filler[4:]).to_bytes(4, "big")
    fsspec.filesystem("memory").pipe("/scene/view_000.png", start + filler + long[33:])
    found = Mirror(in_memory, 1)
    path = found.path / "view_000.png"
    for name in ("view_000.png", "view_001.png", "view_002.png"):
        with found.held(found.path / name, whole=True):
            pass
    assert path.stat().st_size > 40_000
    with Mirror(in_memory, 1).held(path, whole=False), Image.open(path) as image:
        assert image.size == (WIDTH, HEIGHT)


def test_a_web_server_is_read_and_what_is_there_is_not_fetched_again(server, scene):
    address, handler = server
    place = local_place(address)
    data = opened(place)
    assert torch.equal(pixels(data, 3), pixels(opened(scene), 3))
    asked = handler.asked
    assert asked == VIEWS + 1
    mirror._open.clear()
    again = opened(local_place(address))
    assert torch.equal(pixels(again, 3), pixels(opened(scene), 3))
    assert handler.asked == asked


def test_what_has_changed_is_fetched_again(in_memory, scene):
    place = local_place(in_memory)
    pixels(opened(place), 0)
    Image.new("RGB", (WIDTH, HEIGHT), "red").save(scene / "view_000.png")
    fsspec.filesystem("memory").put(str(scene / "view_000.png"), "/scene/view_000.png")
    mirror._open.clear()
    assert torch.equal(pixels(opened(local_place(in_memory)), 0), pixels(opened(scene), 0))


def test_a_data_set_can_be_named_by_its_file(in_memory):
    place = local_place(f"{in_memory}/transforms.json")
    assert place.name == "transforms.json"
    assert len(opened(place).views(Split.TRAIN)) == VIEWS


def test_a_connection_that_fails_for_a_while_is_tried_again(server):
    address, handler = server
    data = opened(local_place(address))
    handler.failing = remote.ATTEMPTS - 1
    assert pixels(data, 1).shape[0] == 1


def test_a_connection_that_is_lost_ends_in_one_sentence(server):
    address, handler = server
    data = opened(local_place(address))
    handler.failing = 1000
    with pytest.raises(
        DataError, match=r"view_001.png could not be read in 4 attempts.*\n.*resume"
    ):
        pixels(data, 1)
    handler.failing = 0
    assert pixels(data, 2).shape[0] == 1


@pytest.mark.parametrize(("status", "words"), [(404, "nothing at this address"), (403, "may not")])
def test_what_is_gone_or_not_allowed_is_said_at_once(server, status, words):
    address, handler = server
    data = opened(local_place(address))
    handler.failing, handler.status, handler.asked = 1000, status, 0
    with pytest.raises(DataError, match=words):
        pixels(data, 1)
    assert handler.asked == 1


def test_an_address_with_nothing_is_named():
    with pytest.raises(DataError, match=r"data=memory://nowhere|nothing at this address"):
        local_place("memory://nowhere")


def test_an_unknown_kind_of_address_is_named():
    with pytest.raises(DataError, match="cannot be read"):
        local_place("carrier-pigeon://loft/scene")


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "fsspec.core", None)
    with pytest.raises(UnavailableError, match=r"gsfw\[cloud\]"):
        local_place("s3://bucket/scene")


def test_more_than_the_bound_is_not_fetched_at_once(in_memory, monkeypatch):
    monkeypatch.setattr(mirror, "SMALL", 4000)
    fsspec.filesystem("memory").pipe("/scene/film.mp4", b"0" * 5000)
    with pytest.raises(DataError, match=r"film.mp4"):
        Mirror(in_memory, 4000)


def test_names_that_lead_elsewhere_are_left_out(in_memory, monkeypatch):
    found = remote.RemoteSource(in_memory)
    listed = {"/scene/../../evil": {"size": 1}, "/scene/good.txt": {"size": 1}}
    with monkeypatch.context() as patched:
        patched.setattr(found._files, "find", lambda *given, **more: listed)
        assert list(found.files()) == ["good.txt"]


@pytest.mark.slow
@pytest.mark.unchecked
def test_a_run_whose_connection_is_lost_keeps_its_checkpoint(server, tmp_path, capsys):
    address, handler = server
    out = tmp_path / "run"
    words = [
        "train",
        "method=3dgs",
        f"data={address}",
        f"out={out}",
        "rasterizer=cpu",
        "device=cpu",
    ]
    words += ["steps=12", "checkpoint_every=1", "cache_mb=0", "data_cache_mb=0"]
    asked = handler.asked
    handler.status = 503

    def lose():
        while not list(out.glob("checkpoints/step_00000000[2-9].pt")):
            if stop.wait(0.02):
                return
        handler.failing = 1_000_000

    stop = threading.Event()
    watch = threading.Thread(target=lose)
    watch.start()
    try:
        assert main(words) == 2
    finally:
        stop.set()
        watch.join()
    assert handler.asked > asked
    assert "could not be read in 4 attempts" in capsys.readouterr().err
    assert list(out.glob("checkpoints/step_*.pt"))
    handler.failing = 0
    assert main(["resume", str(out)]) == 0


def test_local_paths_stay_as_they_are(scene):
    assert local_place(str(scene)) == Path(scene)
    assert mirror.notes_on(scene) == ()
