"""XML of other programs is read without what could be anything."""

import pytest

from gsfw.core.errors import DataError
from gsfw.datamanagers.xml_file import read_xml

ENTITIES = '<!DOCTYPE a [<!ENTITY b "b"><!ENTITY c "&b;&b;&b;&b;">]><a>&c;</a>'
OUTSIDE = '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><a>&b;</a>'


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (ENTITIES.encode(), "it declares a document type"),
        (ENTITIES.encode("utf-16"), "it declares a document type"),
        (OUTSIDE.encode(), "it declares a document type"),
        (b"<a>" * 100_000, "nested more than 100 levels deep"),
        (b"<a>&b;</a>", "undefined entity"),
        (b'<?xml version="1.0" encoding="klingon"?><a/>', "unknown encoding|klingon"),
        (b'<?xml version="1.0" encoding="big5"?><a/>', "multi-byte encodings"),
        (b"", "no element found"),
        (b"<a>\0</a>", "not well-formed"),
    ],
)
def test_what_is_no_plain_tree_is_refused_in_words(tmp_path, content, words):
    path = tmp_path / "a.xml"
    path.write_bytes(content)
    with pytest.raises(DataError, match=f"cannot be read as XML: .*({words})") as error:
        read_xml(path, "Export it again.")
    assert error.value.advice == "Export it again."


def test_a_plain_tree_is_read(tmp_path):
    path = tmp_path / "a.xml"
    path.write_text('<?xml version="1.0" encoding="UTF-8"?><a><b c="1">text</b><b/></a>')
    root = read_xml(path, "")
    assert [(item.tag, item.get("c"), item.text) for item in root] == [
        ("b", "1", "text"),
        ("b", None, None),
    ]


def test_a_folder_of_that_name_is_refused_in_words(tmp_path):
    with pytest.raises(DataError, match="cannot be read as XML"):
        read_xml(tmp_path, "")
