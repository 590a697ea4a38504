"""The .splat of antimatter15: the values of its 32 bytes, their order, and damaged files."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.refusals import refusal_of
from support.scenes import random_splats
from support.splat_transform import needs_splat_transform, splat_transform

from gsfw.core.exchange import SplatFile
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.formats.splat import SplatExporter, SplatImporter
from gsfw.formats.stored_rows import stored_parts

MARGIN = 1e-6


def splats(n=40, degree=0, seed=0):
    return random_splats(n, degree, seed, dtype=torch.float64)


def write(path, given_):
    SplatExporter().write(path, SplatFile(given_))
    return path


def read(path):
    return SplatImporter().read(path)


refusal = refusal_of(read)


def stored(given_):
    return next(stored_parts(given_))


def by_importance(given_):
    return given_.take((given_.scales.prod(dim=1) * given_.opacities).argsort(descending=True))


def test_the_layout_is_that_of_the_viewer(tmp_path):
    given_ = by_importance(splats())
    raw = write(tmp_path / "a.splat", given_).read_bytes()
    assert len(raw) == 40 * 32
    floats = np.frombuffer(raw, "<f4").reshape(40, 8)
    octets = np.frombuffer(raw, "u1").reshape(40, 32)
    assert np.array_equal(floats[:, :3], given_.means.float())
    assert np.allclose(floats[:, 3:6], given_.scales, rtol=MARGIN)
    colors = (0.5 + 0.28209479177387814 * given_.colors.coefficients[:, 0]).clamp(0, 1)
    assert np.array_equal(octets[:, 24:27], (255 * colors).round())
    assert np.array_equal(octets[:, 27], (255 * given_.opacities).round())
    # As the viewer reads them: (byte - 128) / 128, wxyz.
    decoded = (octets[:, 28:].astype(np.float64) - 128) / 128
    turned = torch.nn.functional.normalize(given_.quats, dim=1).numpy()
    assert (np.abs((decoded * turned).sum(axis=1)) >= 1 - 1 / 128).all()


@settings(max_examples=15)
@given(count=st.integers(1, 60), seed=st.integers(0, 2**31), size=st.floats(1e-5, 1e5))
def test_any_splats_come_back_within_half_a_step(tmp_path_factory, count, seed, size):
    made = splats(count, 1, seed)
    made = replace(made, means=size * made.means, scales=size * made.scales)
    path = write(tmp_path_factory.mktemp("any") / "a.splat", made)
    before, after = stored(by_importance(made)), stored(read(path).splats)
    assert np.array_equal(before.means.astype(np.float32), after.means)
    assert np.allclose(before.log_scales, after.log_scales, rtol=MARGIN, atol=MARGIN)
    assert np.abs(before.rgb.clip(0, 1) - after.rgb).max() <= 1 / 510 + MARGIN
    assert np.abs(before.opacities - after.opacities).max() <= 1 / 510 + MARGIN
    # Components within 1 / 256 are a vector within 1 / 128: the sine of the angle between them.
    cosines = np.abs((before.quats * after.quats).sum(axis=1))
    assert cosines.min() >= math.sqrt(1 - 1 / 128**2) - MARGIN


def test_rotations_about_the_axes_are_exact(tmp_path):
    quats = (
        torch.eye(4, dtype=torch.float64).repeat(2, 1)
        * torch.tensor([1.0, -1.0])[torch.arange(8) // 4, None].double()
    )
    again = read(write(tmp_path / "a.splat", replace(splats(8), quats=quats))).splats
    assert np.allclose(again.quats.abs().amax(dim=1), 1, atol=1e-12)


def test_files_begin_with_the_splats_that_matter_most(tmp_path):
    again = read(write(tmp_path / "a.splat", splats(200))).splats
    importance = again.scales.prod(dim=1) * again.opacities
    # Opacities are rounded after the order is made.
    assert (importance.diff() <= again.scales.prod(dim=1)[:-1] / 255).all()


def test_files_are_recognised_by_their_suffix_unless_they_are_ply(tmp_path):
    path = write(tmp_path / "A.SPLAT", splats())
    assert SplatImporter.recognises(path)
    other = tmp_path / "a.bin"
    other.write_bytes(path.read_bytes())
    assert not SplatImporter.recognises(other)
    PlyExporter().write(tmp_path / "b.splat", SplatFile(splats()))
    assert not SplatImporter.recognises(tmp_path / "b.splat")
    (tmp_path / "c.splat").mkdir()
    assert not SplatImporter.recognises(tmp_path / "c.splat")


def test_files_of_another_size_or_content_are_refused(tmp_path):
    path = write(tmp_path / "a.splat", splats())
    assert refusal(tmp_path / "no.splat") == "FILE cannot be read: No such file or directory."
    raw = path.read_bytes()
    for size in (0, 1279):
        path.write_bytes(raw[:size])
        assert refusal(path) == (
            f"FILE is no complete .splat: it has {size} bytes, and each splat takes 32.\n"
            "It may have been cut short, or be of another format; get it again."
        )
    path.write_bytes(np.random.default_rng(0).bytes(32 * 1000))
    assert refusal(path).startswith("FILE contains no splats: 8")


def test_rows_that_are_not_finite_are_dropped_and_counted(tmp_path):
    path = write(tmp_path / "a.splat", splats())
    raw = bytearray(path.read_bytes())
    raw[32 * 3 : 32 * 3 + 4] = np.float32(np.nan).tobytes()
    raw[32 * 5 + 12 : 32 * 5 + 16] = np.float32(-1).tobytes()
    raw[32 * 7 + 12 : 32 * 7 + 16] = np.float32(0).tobytes()
    path.write_bytes(raw)
    content = read(path)
    assert (content.num_dropped, len(content.splats)) == (2, 38)
    assert float(content.splats.scales.min()) < 1e-40


def test_a_file_of_another_tool_is_read(shared_data):
    content = read(shared_data / "splats" / "fixtures" / "minimal.splat").splats
    assert content.means.tolist() == [[-1, 0, -1], [0, 0, -1], [-1, 0, 0], [0, 0, 0]]
    assert torch.allclose(content.scales, torch.tensor(0.1, dtype=torch.float64), rtol=1e-6)
    assert content.opacities.tolist() == pytest.approx([230 / 255] * 4)


@needs_splat_transform
@pytest.mark.slow
def test_splat_transform_reads_the_same_values(tmp_path):
    path = write(tmp_path / "a.splat", splats(300))
    splat_transform(path, tmp_path / "b.ply")
    theirs, ours = stored(PlyImporter().read(tmp_path / "b.ply").splats), stored(read(path).splats)
    assert np.array_equal(theirs.means, ours.means)
    assert np.allclose(theirs.log_scales, ours.log_scales, atol=1e-6)
    assert np.allclose(theirs.rgb, ours.rgb, atol=1e-6)
    assert np.allclose(theirs.opacities, ours.opacities, atol=2e-6)
    # It decodes 2 byte / 255 - 1: components differ from the viewer's by at most 1 / 128.
    cosines = np.abs((theirs.quats * ours.quats).sum(axis=1))
    assert cosines.min() >= math.sqrt(1 - 4 / 128**2)
