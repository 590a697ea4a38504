"""Compact codes give back what they took, within their steps, and refuse other bytes."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as some

from gsfw.core.column import Layout
from gsfw.formats.compact.byte_blocks import ByteReader, packed
from gsfw.formats.compact.column_code import (
    FileColumn,
    decode_exactly,
    decode_steps,
    encode_exactly,
    encode_steps,
)
from gsfw.formats.compact.integer_code import BASES, decode_integers, encode_integers
from gsfw.formats.compact.position_code import Lattice
from gsfw.formats.compact.steps import Form
from gsfw.formats.compact.value_forms import COLORS, quantised, restored
from gsfw.formats.morton_order import morton_cells, morton_codes


def read_integers(content, count):
    reader = ByteReader(content)
    found = decode_integers(reader, count)
    reader.finish()
    return found


@settings(max_examples=30)
@given(some.lists(some.integers(-(2**62), 2**62 - 1) | some.integers(-4, 4), max_size=300))
def test_integers_of_any_size_come_back(values):
    values = np.array(values, dtype=np.int64)
    assert np.array_equal(read_integers(encode_integers(values), len(values)), values)


@pytest.mark.parametrize(("spread", "most"), [(0.1, 0.13), (0.5, 0.30), (30, 0.95)])
def test_integers_take_little_more_than_their_entropy(spread, most):
    """Bytes for each value; the entropies are 0.09, 0.26 and 0.92 bytes."""
    values = np.rint(np.random.default_rng(0).laplace(0, spread, 20_000)).astype(np.int64)
    _, counts = np.unique(values, return_counts=True)
    shares = counts / counts.sum()
    entropy = -(shares * np.log2(shares)).sum() / 8
    size = len(encode_integers(values)) / len(values)
    assert size <= 1.12 * entropy + 0.03
    assert size <= most


def test_a_constant_takes_next_to_nothing():
    assert len(encode_integers(np.full(50_000, 7))) < 100


def test_cells_come_back_from_the_morton_curve():
    cells = np.random.default_rng(0).integers(0, 1 << 21, (500, 3)).astype(np.uint64)
    assert np.array_equal(morton_cells(morton_codes(cells)), cells)


def some_lattice(count, generator):
    means = generator.normal(size=(count, 3)) * np.exp(3 * generator.normal(size=(count, 1)))
    pitches = np.exp(2 * generator.normal(size=count) - 5)
    return means, pitches, Lattice.of(means, pitches)


@pytest.mark.parametrize("count", [0, 1, 2, 1000])
def test_positions_come_back_in_their_order_within_half_a_pitch(count):
    means, pitches, lattice = some_lattice(count, np.random.default_rng(count))
    order = lattice.order()
    reader = ByteReader(lattice.take(order).encode())
    found = Lattice.decode(reader, count)
    reader.finish()
    assert np.array_equal(found.cells, lattice.cells[order])
    lost = np.abs(found.centers() - means[order])
    assert (lost <= found.pitches()[:, None] / 2 * (1 + 1e-12)).all()
    # A power of two that is nearest to the pitch, unless the cells could not be numbered.
    reach = np.abs(means[order]).max(axis=1, initial=0) / ((1 << 20) - 1)
    most = np.maximum(np.sqrt(2) * pitches[order], 2 * reach)
    assert (found.pitches() <= most * (1 + 1e-9)).all()


def test_positions_take_less_than_their_coordinates():
    generator = np.random.default_rng(0)
    lattice = Lattice.of(generator.random((20_000, 3)), np.full(20_000, 2.0**-10))
    size = 8 * len(lattice.take(lattice.order()).encode()) / 20_000
    # 30 bits of three coordinates, less log2(n!) / n = 12.8 of the order that is not stored.
    assert size < 30 - 12.8 + 0.4


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("layout", list(Layout))
def test_values_come_back_within_half_a_step(form, layout):
    generator = np.random.default_rng(1)
    count, width = 40, {Form.UNIT_QUATS: (4,), Form.COLORS: (1, 3)}.get(form, (2,))
    lengths = generator.integers(0, 3, count) if layout is Layout.RAGGED else None
    rows = {Layout.STACKED: (3, count), Layout.DENSE: (count,)}.get(layout)
    shape = (*((int(lengths.sum()),) if rows is None else rows), *width)
    values = generator.normal(size=shape).astype(np.float32)
    steps = np.exp(generator.normal(size=count) - 3)
    content = encode_steps(FileColumn(layout, values, lengths), steps, form)
    found = np.zeros(shape, np.float32)
    decode_steps(content, FileColumn(layout, found, lengths), steps, form)
    axes = (..., *(None,) * len(width))
    bound = (np.repeat(steps, lengths) if lengths is not None else steps)[axes] / 2
    if form is Form.PLAIN:
        assert (np.abs(found - values) <= bound + 1e-6).all()
    elif form is Form.COLORS:
        assert (np.abs((found - values) @ COLORS.T) <= bound + 1e-6).all()
    elif form is Form.OPACITIES:
        angles = [np.arcsin(np.sqrt(1 / (1 + np.exp(-x.astype(float))))) for x in (found, values)]
        assert (np.abs(angles[0] - angles[1]) <= np.maximum(bound, 0.011) + 1e-6).all()
    else:
        units = values / np.linalg.norm(values, axis=-1, keepdims=True)
        apart = 1 - np.abs((units * found).sum(axis=-1))
        # Three components, and the largest, which is at least as long as each of them: 6 s^2.
        assert (apart <= 6 * bound[..., 0] ** 2 / 2 + 1e-6).all()


def test_numbers_that_need_too_many_steps_have_no_code():
    column = FileColumn(Layout.DENSE, np.array([[1e30]], np.float32))
    assert encode_steps(column, np.array([1e-3]), Form.PLAIN) is None


@pytest.mark.parametrize("stacked", [False, True])
@pytest.mark.parametrize("kind", ["<f2", "<f4", "<f8", "|i1", "<i2", "<i8", "|u1", "|b1"])
def test_numbers_of_any_type_come_back_exactly(kind, stacked):
    values = (100 * np.random.default_rng(0).normal(size=(3, 4, 2))).astype(kind)
    found = decode_exactly(encode_exactly(values, stacked), values.shape, np.dtype(kind), stacked)
    assert found.dtype == values.dtype
    assert found.tobytes() == values.tobytes()


def test_scalars_and_nothing_come_back_exactly():
    for values in (np.full((), 0.5, "<f4"), np.zeros((0, 3), "<f4")):
        found = decode_exactly(encode_exactly(values), values.shape, values.dtype)
        assert found.shape == values.shape
        assert found.tobytes() == values.tobytes()


def test_quaternions_of_length_zero_become_the_identity():
    counts = quantised(np.zeros((1, 4)), np.array([0.01]), Form.UNIT_QUATS)
    assert np.array_equal(restored(counts, np.array([0.01]), Form.UNIT_QUATS), [[1, 0, 0, 0]])


@pytest.mark.parametrize(
    ("content", "count", "problem"),
    [
        (b"", 1, "1 more bytes were expected, found 0"),
        (bytes([len(BASES)]), 1, "integers have the base 4"),
        (bytes([0]) + packed(b"12"), 1, "a block should have 1 bytes, found 2"),
        (bytes([0]) + packed(b"1"), 2, "a block should have 2 bytes, found 1"),
        (bytes([0]) + packed(bytes(1 << 24)), 5, "a block should have 5 bytes, found 6"),
        (bytes([0]) + packed(b"\xff") + bytes([9]), 1, "integers of 9 bytes"),
        (bytes([0, 3, 0, 0, 0]) + b"\x03\x03\x03", 10, "a block is not LZMA"),
        (bytes([0, 200, 0, 0, 0]), 1, "200 more bytes were expected, found 0"),
    ],
)
def test_bytes_that_are_no_integers_are_refused(content, count, problem):
    with pytest.raises(ValueError, match=problem):
        read_integers(content, count)


def test_mutated_positions_are_refused_or_stay_on_their_lattice():
    _, _, lattice = some_lattice(60, np.random.default_rng(3))
    whole = lattice.take(lattice.order()).encode()
    generator, refused = np.random.default_rng(0), 0
    for _ in range(150):
        changed = bytearray(whole)
        changed[generator.integers(len(whole))] ^= 1 << int(generator.integers(8))
        try:
            found = Lattice.decode(ByteReader(bytes(changed)), 60)
        except ValueError:
            refused += 1
            continue
        assert np.isfinite(found.centers()).all()
        assert (np.abs(found.cells) <= 1 << 20).all()
    assert refused > 10


def test_rows_of_every_layout_follow_an_order():
    rows = np.array([2, 0, 1])
    values = np.arange(6.0).reshape(3, 2)
    assert np.array_equal(FileColumn(Layout.DENSE, values).take(rows).values, values[rows])
    stacked = FileColumn(Layout.STACKED, values.T[..., None]).take(rows)
    assert np.array_equal(stacked.values, values.T[:, rows, None])
    ragged = FileColumn(Layout.RAGGED, np.arange(3.0), np.array([1, 0, 2])).take(rows)
    assert ragged.values.tolist() == [1.0, 2.0, 0.0]
    assert ragged.lengths.tolist() == [2, 1, 0]
    back = ragged.take(np.argsort(rows))
    assert torch.equal(torch.from_numpy(back.values), torch.arange(3.0).double())
