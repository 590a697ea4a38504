"""The built site is looked through for what it would load from elsewhere."""

import pytest
from offline import external_links, foreign_loads


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.html", '<script async src="https://cdn.example/x.js"></script>'),
        ("a.html", '<link rel="stylesheet" href="//fonts.example/css?family=Inter">'),
        ("a.html", "<img alt='' src='http://images.example/1.png'>"),
        ("a.css", "@font-face { src: url(https://fonts.example/inter.woff2) }"),
        ("a.css", '@import "https://fonts.example/inter.css";'),
    ],
)
def test_what_would_be_loaded_from_elsewhere_is_named_with_its_file(name, text, tmp_path):
    (tmp_path / name).write_text(text)
    (found,) = foreign_loads(tmp_path)
    assert found.startswith(f"{name} loads ")


def test_links_and_own_files_are_no_loads(tmp_path):
    (tmp_path / "a.html").write_text(
        '<script src="_static/x.js"></script><img src="data:image/png;base64,AA==">'
        '<a href="https://pytorch.org/get-started">x</a><link rel="index" href="genindex.html">'
    )
    assert not list(foreign_loads(tmp_path))
    assert external_links(tmp_path) == ["https://pytorch.org/get-started"]
