"""format=html: one page that holds everything, and may ask for nothing."""

import base64
import hashlib
import re
from html.parser import HTMLParser

import pytest
import torch
from support.web_scenes import ORIGIN, WithPreview, ball, cameras, moving_ball, read_scene

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Preview
from gsfw.formats.web import html as html_module
from gsfw.formats.web.html import HtmlExporter


class Elements(HTMLParser):
    """The elements of a page, with what is in its scripts and styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.inside: dict[str, list[str]] = {"script": [], "style": [], "title": []}
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag in self.inside:
            self.inside[tag].append("")

    def handle_endtag(self, tag):
        self.found.append((f"/{tag}", {}))

    def handle_data(self, data):
        if self.found and self.found[-1][0] in self.inside:
            self.inside[self.found[-1][0]][-1] += data

    def attributes(self, tag):
        return [attributes for found, attributes in self.found if found == tag]


def page(tmp_path, content, **options):
    path = tmp_path / "scene.html"
    HtmlExporter(**options).write(path, content)
    return path.read_text()


def payload(text):
    parts = re.findall(
        r'<script class="scene" type="application/octet-stream">(.*?)</script>', text
    )
    return b"".join(map(base64.b64decode, parts))


def shown(content):
    image = torch.full((90, 160, 3), 0.25)
    preview = Preview("Räume & <more>", cameras(2), ORIGIN, image, background=(1.0, 1.0, 1.0))
    return WithPreview(content.motion_file(), preview)


def test_a_page_holds_its_scene(tmp_path):
    read = read_scene(payload(page(tmp_path, ball(count=200))))
    assert len(read.splats) == 200
    assert not read.header["moving"]
    assert read_scene(payload(page(tmp_path, moving_ball(count=200)))).header["moving"]


def test_a_scene_comes_in_pieces_that_are_decoded_one_by_one(tmp_path, monkeypatch):
    monkeypatch.setattr(html_module, "PIECE", 3000)
    text = page(tmp_path, ball(count=500))
    assert text.count('<script class="scene"') > 3
    assert len(read_scene(payload(text)).splats) == 500


def test_a_page_runs_its_own_script_and_asks_for_nothing(tmp_path):
    text = page(tmp_path, shown(ball(count=50)))
    elements = Elements(text)
    policy = elements.attributes("meta")[1]["content"]
    assert "default-src 'none'" in policy
    assert "connect-src" not in policy
    assert "unsafe" not in policy
    (script,) = [inside for inside in elements.inside["script"] if "use strict" in inside]
    for content in (script, elements.inside["style"][0]):
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    assert not re.search(r"\beval\b|new Function|innerHTML|https?://", text)
    sources = [attributes.get("src", "data:") for _, attributes in elements.found]
    assert all(source.startswith("data:") for source in sources)


def test_names_of_scenes_are_escaped(tmp_path):
    text = page(tmp_path, shown(ball(count=50)))
    assert Elements(text).inside["title"] == ["Räume & <more>"]
    assert "<more>" not in text
    assert "<b>" not in page(tmp_path, ball(count=50), title='"><b>')
    mark = page(tmp_path, shown(ball(count=50)), title="{{poster}} {{scene}}")
    assert Elements(mark).inside["title"] == ["{{poster}} {{scene}}"]


def test_the_poster_and_the_background_are_those_of_the_source(tmp_path):
    text = page(tmp_path, shown(ball(count=50)))
    (poster,) = Elements(text).attributes("img")
    assert poster["src"].startswith("data:image/webp;base64,")
    assert read_scene(payload(text)).header["background"] == [1.0, 1.0, 1.0]
    plain = page(tmp_path, ball(count=50))
    assert not Elements(plain).attributes("img")
    assert read_scene(payload(plain)).header["background"] == [0.0, 0.0, 0.0]


def test_options_replace_what_the_source_says(tmp_path):
    text = page(
        tmp_path, shown(ball(count=50)), title="Mine", background="0.5,0,0", sh_degree=1, metre=2.5
    )
    header = read_scene(payload(text)).header
    assert Elements(text).inside["title"] == ["Mine"]
    assert (header["background"], header["degree"]) == ([0.5, 0.0, 0.0], 1)
    assert header["metre"] == 2.5


def test_wrong_options_are_refused_before_anything_is_written():
    with pytest.raises(ConfigError, match=r"format\.background=red"):
        HtmlExporter(background="red")
    with pytest.raises(ConfigError, match=r"format\.sh_degree=-1: expected 0 to 4"):
        HtmlExporter(sh_degree=-1)
    with pytest.raises(ConfigError, match=r"format\.metre=-1\.0: expected how many world units"):
        HtmlExporter(metre=-1.0)


def test_a_page_that_fails_leaves_no_file(tmp_path):
    content = ball(count=20)
    content.splats.opacities[4] = 2.0
    with pytest.raises(ValueError, match="opacities: row 4"):
        page(tmp_path, content)
    assert not list(tmp_path.iterdir())
