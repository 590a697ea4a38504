"""PLY files: what other writers make is read by parts, and damage is named by line and row."""

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from gsfw.core.errors import DataError
from gsfw.core.files.ply_file import ROWS, ply_header, read_ply_header

KINDS = [("x", "f4"), ("y", "f8"), ("small", "i1"), ("byte", "u1"), ("short", "i2"), ("big", "u4")]
TEXT = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty uchar red\nend_header\n"


def table(count, kinds=KINDS):
    chance, rows = np.random.default_rng(0), np.zeros(count, kinds)
    for name, kind in kinds:
        limits = (-1e6, 1e6) if kind[0] == "f" else (np.iinfo(kind).min, np.iinfo(kind).max)
        rows[name] = chance.uniform(*limits, count)
    return rows


def faces():
    return np.array([([0, 1, 2],), ([0, 1],)], dtype=[("vertex_indices", "O")])


def write(path, encoding, *elements):
    described = [PlyElement.describe(rows, name) for name, rows in elements]
    text = encoding == "text"
    PlyData(described, text=text, byte_order="=" if text else encoding).write(str(path))
    return path


def read(path, name="vertex"):
    return np.concatenate([*read_ply_header(path).rows(name)])


def refusal(path, name="vertex"):
    with pytest.raises(DataError) as caught:
        read(path, name)
    return str(caught.value).replace(str(path), "FILE").splitlines()[0]


@pytest.mark.parametrize("encoding", ["<", ">", "text"])
def test_all_types_of_another_writer_are_read_whatever_stands_around_them(tmp_path, encoding):
    rows, first = table(50), table(3, KINDS[:2])
    path = write(tmp_path / "a.ply", encoding, ("a", first), ("vertex", rows), ("face", faces()))
    header = read_ply_header(path)
    assert [*header.elements] == ["a", "vertex", "face"]
    assert header.names("vertex") == {name for name, _ in KINDS}
    assert header.names("edge") == frozenset()
    for name, expected in (("a", first), ("vertex", rows)):
        found = read(path, name)
        for field in expected.dtype.names:
            tolerance = 1e-6 if encoding == "text" and expected[field].dtype == "f4" else 0
            assert np.allclose(found[field], expected[field], rtol=tolerance, atol=0), field


@pytest.mark.parametrize("encoding", ["<", "text"])
def test_rows_come_in_parts(tmp_path, encoding):
    rows = table(ROWS + 5, [("x", "f8")])
    path = write(tmp_path / "a.ply", encoding, ("vertex", rows))
    parts = [*read_ply_header(path).rows("vertex")]
    assert [len(part) for part in parts] == [ROWS, 5]
    assert np.array_equal(np.concatenate(parts)["x"], rows["x"])


@pytest.mark.parametrize("line_break", ["\n", "\r\n", "\r"])
def test_all_line_breaks_are_read(tmp_path, line_break):
    path = tmp_path / "a.ply"
    text = TEXT.replace(
        "\nend", "\ncomment Vertical axis: z\nobj_info 3 é\n\nend".replace("\n\n", "\n")
    )
    path.write_bytes((text + "1.5 7\n\n2.5 255").replace("\n", line_break).encode())
    assert read(path)["red"].tolist() == [7, 255]
    assert read_ply_header(path).comments == ("Vertical axis: z", "3 é")


def test_a_written_header_is_read_by_others(tmp_path):
    path, rows = tmp_path / "a.ply", table(4, [("x", "f4"), ("n", "u4")])
    header = ply_header(["made here"], {"vertex": (4, [("float", "x"), ("uint", "n")])})
    path.write_bytes(header + rows.tobytes())
    other = PlyData.read(str(path))
    assert other.comments == ["made here"]
    assert np.array_equal(np.asarray(other["vertex"].data), rows)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("1.5 7\n2.5 256", "vertex row 1: red is 256, which is out of range"),
        ("1.5 7\nnorth 8", "vertex row 1: x is 'north', which is no number"),
        ("1.5 7 9\n2.5 8", "vertex row 0 has 3 values, not 2"),
        ("1.5 7              ", "vertex row 1 is missing"),
        ("             \n   ", "vertex row 0 is missing"),
    ],
)
def test_text_that_is_malformed_is_refused_with_its_row(tmp_path, rows, message):
    (tmp_path / "a.ply").write_text(TEXT + rows)
    assert refusal(tmp_path / "a.ply") == f"FILE is a damaged PLY: {message}."


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("vertex 2", "vertex -2", "line 3: expected a number of rows, found '-2'"),
        (
            "vertex 2",
            "vertex " + "9" * 5000,
            f"line 3: expected a number of rows, found '{'9' * 40}'",
        ),
        ("float x", "real x", "line 4: 'real' is no type"),
        (
            "float x",
            "list uchar x",
            "line 4: expected an element, or a property with a type and a name",
        ),
        ("uchar red", "uchar x", "line 5: vertex has 'x' twice"),
        ("property float", "color", "line 4: 'color x' is no statement that is expected there"),
        ("ascii", "utf8", "line 2: 'format utf8 1.0' is no statement that is expected there"),
        ("format ascii 1.0", "comment", "its header states no format"),
        (
            "element vertex 2",
            "comment",
            "line 4: expected an element, or a property with a type and a name",
        ),
    ],
)
def test_a_damaged_header_is_refused_with_its_line(tmp_path, before, after, message):
    (tmp_path / "a.ply").write_text(TEXT.replace(before, after, 1))
    assert refusal(tmp_path / "a.ply") == f"FILE is a damaged PLY: {message}."


def test_rows_behind_lists_of_a_binary_file_are_refused(tmp_path):
    rows = table(2)
    path = write(tmp_path / "a.ply", "<", ("face", faces()), ("vertex", rows))
    refused = (
        "FILE: the rows of its element '{}' cannot be found: lists, such as faces, stand among or"
    )
    assert refusal(path) == refused.format("vertex") + " before them."
    assert refusal(path, "face") == refused.format("face") + " before them."
    assert np.array_equal(
        read(write(path, "text", ("face", faces()), ("vertex", rows)))["y"], rows["y"]
    )


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_elements_without_properties_take_no_rows_whatever_their_counts(tmp_path, encoding):
    empty = "".join(f"element e{index} 999999999999999999\n" for index in range(12))
    text = TEXT.replace("ascii", encoding).replace("element", empty + "element", 1)
    rows = np.array([(1.5, 7), (2.5, 8)], [("x", "<f4"), ("red", "u1")])
    content = b"1.5 7\n2.5 8" if encoding == "ascii" else rows.tobytes()
    (tmp_path / "a.ply").write_bytes(text.encode() + content)
    assert read(tmp_path / "a.ply")["red"].tolist() == [7, 8]


def test_more_rows_than_bytes_are_refused_before_any_is_read(tmp_path):
    path = write(tmp_path / "a.ply", "<", ("vertex", table(2)))
    path.write_bytes(path.read_bytes().replace(b"vertex 2", b"vertex 99999999999999"))
    assert refusal(path) == (
        "FILE is cut short: its header announces 99999999999999 vertex rows, at least "
        "1999999999999980 bytes, and 40 follow."
    )
