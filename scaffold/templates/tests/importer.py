"""Tests of importer my-part."""

import pytest
from gsfw.api import DataError
from gsfw.testing import conformance

from my_part.importer import COLUMNS, MyPartImporter

FILE = ",".join(COLUMNS) + "\n1,2,3,0.1,0.1,0.1,1,0,0,0,0.5,1,0,0\n"

test_conforms = conformance("importer", "my-part")


def test_a_line_is_a_splat(tmp_path):
    (tmp_path / "splats.csv").write_text(FILE)
    assert MyPartImporter.recognises(tmp_path / "splats.csv")
    splats = MyPartImporter().read(tmp_path / "splats.csv").splats
    assert splats.means.tolist() == [[1.0, 2.0, 3.0]]
    assert splats.opacities.tolist() == [0.5]


def test_a_damaged_line_is_named(tmp_path):
    (tmp_path / "splats.csv").write_text(FILE + "1,2\n")
    with pytest.raises(DataError, match="line 3"):
        MyPartImporter().read(tmp_path / "splats.csv")
