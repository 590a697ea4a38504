"""format=web: a folder that any host of files can serve."""

import re
from io import BytesIO

import pytest
import torch
from PIL import Image
from support.chromium import needs_chromium
from support.hosts import hosted
from support.web_player import Player, psnr, rendered
from support.web_scenes import ORIGIN, WithPreview, ball, cameras, read_scene

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Preview
from gsfw.formats.web.folder import WebExporter


def shown(content, title="Räume"):
    image = torch.full((90, 160, 3), 0.25)
    image[:, :80] = 0.75
    preview = Preview(title, cameras(2), ORIGIN, image)
    return WithPreview(content.motion_file(), preview)


def test_a_folder_holds_the_page_the_scene_and_what_embeds_it(tmp_path):
    site = tmp_path / "new" / "site"
    WebExporter().write(site, shown(ball(count=200)))
    assert {path.name for path in site.iterdir()} == {
        *("index.html", "scene.bin", "poster.webp", "social.png", "README.txt", "embed.html"),
        "gsfw-scene.js",
    }
    assert len(read_scene((site / "scene.bin").read_bytes()).splats) == 200
    snippet = (site / "embed.html").read_text(encoding="utf-8")
    assert 'title="Räume"' in snippet
    assert 'allow="fullscreen; xr-spatial-tracking"' in snippet
    assert "scene.bin" in (site / "README.txt").read_text(encoding="utf-8")


def test_a_scene_without_a_preview_has_a_folder_too(tmp_path):
    WebExporter(title="Ball").write(tmp_path, ball(count=50))
    assert not (tmp_path / "social.png").exists()
    assert "og:image" not in (tmp_path / "index.html").read_text()
    assert "social.png" not in (tmp_path / "README.txt").read_text()


def test_links_show_an_image_of_the_usual_size_by_its_whole_address(tmp_path):
    url = "https://example.org/scenes/ball"
    WebExporter(url=url).write(tmp_path, shown(ball(count=50), title='"<b>"'))
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert f'<meta property="og:image" content="{url}/social.png">' in text
    assert f'<meta property="og:url" content="{url}/">' in text
    assert '<meta property="og:title" content="&quot;&lt;b&gt;&quot;">' in text
    picture = Image.open(BytesIO((tmp_path / "social.png").read_bytes()))
    assert picture.size == (1200, 630)
    left, right = picture.getpixel((300, 300)), picture.getpixel((900, 300))
    assert left == (191, 191, 191)
    assert right == (64, 64, 64)


def test_another_scene_has_another_address(tmp_path):
    def address(count):
        WebExporter().write(tmp_path, ball(count=count))
        return re.findall(r"scene\.bin\?v=\w{12}", (tmp_path / "index.html").read_text())

    first = address(50)
    assert len(first) == 1
    assert address(50) == first != address(60)


def test_the_page_may_ask_its_own_host_only(tmp_path):
    WebExporter().write(tmp_path, shown(ball(count=50)))
    policy = re.search(r'Policy" content="([^"]*)"', (tmp_path / "index.html").read_text())[1]
    assert "default-src 'none'" in policy
    assert "connect-src 'self';" in policy
    assert "unsafe" not in policy


def test_an_address_that_is_none_is_refused():
    with pytest.raises(ConfigError, match=r"format\.url=example\.org: expected an address"):
        WebExporter(url="example.org")


@pytest.mark.slow
@needs_chromium
def test_a_host_of_files_is_enough_to_show_the_scene(browser, tmp_path):
    content = ball(count=1500)
    WebExporter().write(tmp_path / "site", shown(content))
    with hosted(tmp_path) as address:
        page = browser.open(f"{address}site/index.html", size=(480, 360))
        player = Player(page)
        camera = cameras(1, width=160, height=120)
        assert psnr(player.look(camera), rendered(content.splats, camera)) > 45
        places = {re.sub(r"\?.*", "", request) for request in page.requests()}
        names = ("index.html", "scene.bin", "poster.webp")
        assert places == {f"{address}site/{name}" for name in names}
        assert not page.errors()


@pytest.mark.slow
@needs_chromium
def test_a_budget_stops_the_download_early(browser, tmp_path):
    WebExporter().write(tmp_path, ball(count=100_000, degree=1))
    with hosted(tmp_path, bytes_a_second=200_000) as address:
        page = browser.open(f"{address}index.html?budget=30000", size=(240, 180))
        player = Player(page)
        assert player.stats()["splats"] == 1 << 15
        size = (tmp_path / "scene.bin").stat().st_size
        assert 0 < address.sent["/scene.bin"] < 0.7 * size


@pytest.mark.slow
@needs_chromium
def test_the_element_shows_the_scene_in_another_page(browser, tmp_path):
    WebExporter().write(tmp_path / "site", shown(ball(count=100)))
    (tmp_path / "other.html").write_text(
        "<!DOCTYPE html><link rel=icon href=data:,><script src='site/gsfw-scene.js'></script>"
        "<gsfw-scene label='A ball' budget='5000'></gsfw-scene>"
    )
    with hosted(tmp_path) as address:
        page = browser.open(f"{address}other.html", size=(640, 480))
        frame = "document.querySelector('gsfw-scene').shadowRoot.querySelector('iframe')"
        page.wait_for(f"{frame}.contentWindow.gsfw?.ready.then(() => true)")
        assert page.evaluate(f"{frame}.title") == "A ball"
        assert page.evaluate(f"{frame}.contentWindow.gsfw.stats().splats") == 100
        assert page.evaluate(f"{frame}.allow") == "fullscreen; xr-spatial-tracking"
        assert page.evaluate(f"{frame}.src").endswith("/site/index.html?budget=5000")
        box = page.evaluate(f"[{frame}.clientWidth, {frame}.clientHeight]")
        assert box[0] / box[1] == pytest.approx(16 / 9, rel=0.01)
        assert not page.errors()


@pytest.mark.slow
@needs_chromium
def test_from_disk_the_folder_says_what_it_needs(browser, tmp_path):
    WebExporter().write(tmp_path, ball(count=100))
    page = browser.open((tmp_path / "index.html").as_uri(), size=(480, 360))
    assert "python3 -m http.server" in Player(page).problem()
