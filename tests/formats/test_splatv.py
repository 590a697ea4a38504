"""splaTV: an independent reading shows the same splats at all times; damaged files are refused."""

import json
import random
import struct
from dataclasses import replace

import numpy as np
import pytest
import torch
from support.moving_models import sliced
from support.moving_splats import moving_scene, spacetime

from gsfw.core.errors import DataError
from gsfw.core.exchange import Motion, MotionFile, SplatFile
from gsfw.core.maths.rotations import unit_matrices
from gsfw.core.maths.similarity import Similarity
from gsfw.core.maths.spherical_harmonics import C0
from gsfw.core.motion.evaluation import in_world, splats_at
from gsfw.core.motion.fit import fit_motion
from gsfw.core.splats import Splats
from gsfw.formats.splatv import RECORD, SplatvExporter, SplatvImporter
from gsfw.studies.stress.case import random_splats

TIMES = (0.0, 0.21, 0.5, 0.83, 1.0)
HALF = 2.0**-11
"""Relative rounding error of half floats."""


def moving(model=None) -> MotionFile:
    """The motion of a small model, in a world with another unit and place."""
    scene = replace(moving_scene(), time_range=(2.0, 4.0), up="z")
    file = fit_motion(model or spacetime(), scene, (0.0, 0.5, 1.0), antialiased=True).file
    return in_world(file, Similarity(4.0, translation=torch.tensor([6.0, -2, 3.5]).double()))


@pytest.fixture(scope="module")
def source():
    return moving()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.splatv"


@pytest.fixture
def written(source, path):
    SplatvExporter().write(path, source)
    return path


def as_players_read(path, time):
    """What splaTV's shader computes from a file, by its layout and without our code."""
    content = path.read_bytes()
    magic, length = struct.unpack("<II", content[:8])
    assert magic == 0x674B
    (part,) = json.loads(content[8 : 8 + length])
    assert part["size"] == part["texwidth"] * part["texheight"] * 16
    texture = np.frombuffer(content[8 + length :], "<u4").reshape(-1, 16)
    assert len(texture) == part["size"] // 64
    halves = texture.copy().view("<f2").astype(float).reshape(-1, 16, 2)
    found = []
    for words, pairs in zip(texture, halves, strict=True):
        if not words.any():
            continue
        pair = pairs.ravel()
        elapsed = time - pairs[15, 0]
        factor = np.exp(-((elapsed / pairs[15, 1]) ** 2))
        motion = pair[16:25].reshape(3, 3)
        mean = words[:3].copy().view("<f4") + motion.T @ elapsed ** np.arange(1, 4)
        quat = pair[6:10] + pair[26:30] * elapsed
        rgba = np.array([words[7] >> shift & 255 for shift in (0, 8, 16, 24)]) / 255
        found.append(
            [*mean, *quat / np.linalg.norm(quat), *pair[10:13], *rgba[:3], rgba[3] * factor]
        )
    return torch.tensor(np.array(found)).split([3, 4, 3, 3, 1], dim=1)


@pytest.mark.parametrize("time", TIMES)
def test_a_player_shows_the_splats_of_the_model_at_every_time(written, source, time):
    expected = splats_at(source, time)
    means, quats, scales, rgb, opacities = as_players_read(written, time)
    reach = source.motion.path.abs().amax((1, 2), keepdim=False)[:, None]
    assert bool(((means - expected.means).abs() <= 3 * HALF * reach + 1e-5).all())
    assert float((scales / expected.scales - 1).abs().max()) <= HALF
    turned = unit_matrices(quats) - unit_matrices(expected.quats)
    assert float(turned.abs().max()) < 16 * HALF
    color = (0.5 + C0 * expected.colors.coefficients[:, 0]).clamp(0, 1)
    assert float((rgb - color).abs().max()) <= 0.5 / 255 + 1e-6
    # Half a level, and the slope of the narrowest window at its rounded centre and width.
    slope = float((1 / source.motion.width).max())
    assert float((opacities[:, 0] - expected.opacities).abs().max()) <= 0.5 / 255 + 2 * HALF * slope


def test_the_importer_reads_the_motion_back(written, source):
    found = SplatvImporter().read_motion(written)
    assert (found.time_range, found.frames) == ((2.0, 4.0), 3)
    assert (found.content.up, found.content.antialiased) == ("z", True)
    assert len(found.content.splats) == len(source.content.splats)
    for time in TIMES:
        one, other = splats_at(source, time), splats_at(found, time)
        assert float((one.means - other.means).norm(dim=1).max()) < 0.01
        assert float((one.opacities - other.opacities).abs().max()) < 0.01


def test_reading_without_motion_gives_the_first_time(written, source):
    importer = SplatvImporter()
    assert importer.recognises(written)
    content = importer.read(written)
    expected = splats_at(importer.read_motion(written), 0.0)
    assert torch.equal(content.splats.means, expected.means)
    assert content.splats.rows is None
    assert content.properties == {"moves": "yes; these are its splats at the first time"}


def test_temporal_centres_that_are_no_half_floats_cost_nothing_on_the_path(path):
    """At full speed a rounded centre alone would shift a splat by 2^-11 of its path."""
    source = moving(sliced())
    fast = replace(source, motion=replace(source.motion, path=source.motion.path * 100))
    SplatvExporter().write(path, fast)
    found = SplatvImporter().read_motion(path)
    center = source.motion.center
    assert float((center - found.motion.center).abs().max()) > 1e-5
    shift = (found.motion.center - center)[:, None]
    expected = fast.content.splats.means + shift * fast.motion.path[:, 0]
    assert float((found.content.splats.means - expected).abs().max()) < 1e-4


def test_splats_at_rest_stay_at_rest(path):
    splats = random_splats(5, degree=0, dtype=torch.float64)
    SplatvExporter().write(path, SplatFile(splats))
    found = SplatvImporter().read_motion(path)
    assert found.is_still
    assert torch.equal(splats_at(found, 0.0).means, splats_at(found, 1.0).means)
    assert SplatvImporter().read(path).properties == {"moves": "no"}


def test_a_rotation_that_passes_through_0_is_the_identity_there(written):
    content = written.read_bytes()
    start = 8 + struct.unpack("<I", content[4:8])[0]
    records = np.frombuffer(content[start:], RECORD).copy()
    records["spin"][0], records["center"][0] = records["quats"][0], 1.0
    written.write_bytes(content[:start] + records.tobytes())
    first = SplatvImporter().read(written).splats.quats
    assert first[0].tolist() == [1, 0, 0, 0]
    assert first.isfinite().all()


def test_a_file_of_another_tool_needs_no_more_than_the_layout(written):
    content = written.read_bytes()
    length = struct.unpack("<I", content[4:8])[0]
    parts = json.loads(content[8 : 8 + length])
    del parts[0]["gsfw"], parts[0]["cameras"]
    text = json.dumps([{"type": "notes", "size": 3}, *parts]).encode()
    written.write_bytes(
        struct.pack("<II", 0x674B, len(text)) + text + b"abc" + content[8 + length :]
    )
    found = SplatvImporter().read_motion(written)
    assert found.time_range == (0.0, 1.0)
    assert len(found.content.splats) == 20


@pytest.mark.parametrize("up", ["banana", "y\nelement vertex 7", "Y-up"])
def test_an_up_direction_that_names_no_axis_is_unknown(written, up):
    content = written.read_bytes()
    length = struct.unpack("<I", content[4:8])[0]
    parts = json.loads(content[8 : 8 + length])
    assert SplatvImporter().read(written).up == "z"
    parts[0]["gsfw"]["up"] = up
    written.write_bytes(header(parts) + content[8 + length :])
    assert SplatvImporter().read(written).up == ""


def test_what_half_floats_cannot_hold_is_refused(path, source):
    exporter, motion = SplatvExporter(), source.motion
    fast = replace(source, motion=replace(motion, path=motion.path * 1e6))
    with pytest.raises(ValueError, match=r"path: row \d+ is .*half floats cannot hold"):
        exporter.write(path, fast)
    cut = replace(source, motion=replace(motion, begin=torch.zeros_like(motion.begin)))
    with pytest.raises(ValueError, match="in pieces of their motion"):
        exporter.write(path, cut)
    nothing = replace(source.content.splats, opacities=source.content.splats.opacities * torch.nan)
    with pytest.raises(ValueError, match="not finite"):
        exporter.write(path, replace(source, content=replace(source.content, splats=nothing)))
    assert not path.exists()


def header(parts):
    text = parts if isinstance(parts, bytes) else json.dumps(parts).encode()
    return struct.pack("<II", 0x674B, len(text)) + text


SPLAT = {"type": "splat", "size": 65536, "texwidth": 4096, "texheight": 1}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "magic number"),
        (b"ply\nformat", "magic number"),
        (struct.pack("<II", 0x674B, 2**32 - 1) + b"[", "its header does not end"),
        (struct.pack("<II", 0x674B, 100) + b"[]", "its header does not end"),
        (header(b"[" * 100_000), "its header is no JSON"),
        (header(b"\xff\xfe"), "its header is no JSON"),
        (header({"type": "splat"}), "expected a list of parts"),
        (header([3]), "expected a list of parts"),
        (header([]), "no part of type 'splat'"),
        (header([{"type": "splat"}]), r"parts\[0\].size of its header is missing"),
        (header([{**SPLAT, "size": -16}]), "expected a whole number"),
        (header([{**SPLAT, "size": 2**50}]), "announces 4096 texels"),
        (header([{**SPLAT, "texheight": 2**40, "size": 2**56}]), "expected a whole number"),
        (header([{**SPLAT, "texheight": 2**20, "size": 2**36}]), "is cut short"),
        (header([SPLAT]), "is cut short"),
        (header([{"size": 2**50}, SPLAT]), "is cut short"),
        (header([SPLAT]) + bytes(65536), "it has no rows"),
        (header([{**SPLAT, "gsfw": {"up": 3}}]) + b"\x00<" * 32768, "first_time"),
        (header([SPLAT]) + b"\xff" * 65536, "none of its rows is finite"),
    ],
)
def test_a_damaged_file_is_refused_with_its_cause(path, content, message):
    path.write_bytes(content)
    with pytest.raises(DataError, match=message):
        SplatvImporter().read(path)


def test_bytes_that_change_or_are_missing_do_no_harm(written):
    content, draw = written.read_bytes(), random.Random(0)
    used = len(content) - 65536 + 20 * RECORD.itemsize
    for _ in range(150):
        changed = bytearray(content)
        for _ in range(draw.randint(1, 4)):
            changed[draw.randrange(used)] = draw.randrange(256)
        written.write_bytes(changed[: draw.choice([len(content), draw.randrange(len(content))])])
        try:
            found = SplatvImporter().read(written)
        except DataError:
            continue
        assert found.splats.means.isfinite().all()


def test_rows_that_are_not_finite_are_dropped_and_counted(written):
    content = bytearray(written.read_bytes())
    first = len(content) - 65536
    content[first : first + 4] = struct.pack("<f", float("nan"))
    written.write_bytes(content)
    found = SplatvImporter().read_motion(written)
    assert (len(found.content.splats), found.content.num_dropped) == (19, 1)


def test_many_splats_are_written_part_by_part(path, monkeypatch):
    monkeypatch.setattr("gsfw.formats.splatv.CHUNK", 700)
    splats = random_splats(1500, degree=0, dtype=torch.float64)
    SplatvExporter().write(path, MotionFile(SplatFile(splats), Motion.none(1500)))
    found: Splats = SplatvImporter().read(path).splats
    assert float((found.means - splats.means).abs().max()) < 1e-6
    length = struct.unpack("<I", path.read_bytes()[4:8])[0]
    assert path.stat().st_size == 8 + length + 2 * 65536
