"""The pages of format=html in a browser: they show what our rasterizer does, and obey."""

import numpy as np
import pytest
import torch
from support.chromium import needs_chromium
from support.web_player import Player, psnr, rendered, watching
from support.web_scenes import ORIGIN, WithPreview, at_time, ball, cameras, moving_ball

from gsfw.core.exchange import Preview, SplatFile
from gsfw.formats.web.html import HtmlExporter

pytestmark = [pytest.mark.slow, needs_chromium]


def write(tmp_path, content, **options):
    path = tmp_path / "scene.html"
    HtmlExporter(**options).write(path, content)
    return path


def test_a_still_scene_looks_as_our_rasterizer_draws_it(page, tmp_path):
    content = ball(count=3000, degree=3)
    with watching(page, write(tmp_path, content, background="0.2,0.4,0.3")) as player:
        for camera in map(cameras(3).select, ([0], [1], [2])):
            drawn = rendered(content.splats, camera, background=(0.2, 0.4, 0.3))
            assert drawn.std() > 0.1
            assert psnr(player.look(camera), drawn) > 45


def test_the_poster_lies_where_the_scene_will_be(page, tmp_path):
    content, views = ball(count=1000), cameras(1)
    image = torch.from_numpy(rendered(content.splats, views))
    path = write(tmp_path, WithPreview(content.motion_file(), Preview("", views, ORIGIN, image)))
    with watching(page, path):
        page.resize(480, 480)
        page.evaluate(
            """(() => {
              const bare = new CSSStyleSheet();
              bare.replaceSync("*{transition:none!important} header,footer,#loading{display:none}");
              document.adoptedStyleSheets = [bare];
            })()"""
        )
        live = page.screenshot() / 255
        page.evaluate("document.getElementById('poster').classList.remove('gone')")
        poster = page.screenshot() / 255
    assert live.std() > 0.1
    assert not np.array_equal(live, poster)
    # Above and below the poster the page shows more of the scene.
    inside = slice(61, 419)
    assert psnr(live[inside], poster[inside]) > 30


def test_a_scene_that_was_trained_with_antialiasing_is_drawn_with_it(page, tmp_path):
    content = ball(count=2000, degree=1)
    content.splats.scales.mul_(0.1)
    (camera,) = [cameras(1, width=160, height=120)]
    path = write(tmp_path, SplatFile(content.splats, antialiased=True))
    with watching(page, path) as player:
        found = player.look(camera)
    assert psnr(found, rendered(content.splats, camera, antialias=True)) > 40
    assert psnr(found, rendered(content.splats, camera)) < 35


def test_a_moving_scene_looks_as_its_formulas_say_at_every_time(page, tmp_path):
    content = moving_ball(count=1500)
    camera = cameras(2).select([1])
    with watching(page, write(tmp_path, content)) as player:
        images = [player.look(camera, time) for time in (0.0, 0.499, 0.5, 1.0)]
        for image, time in zip(images, (0.0, 0.499, 0.5, 1.0), strict=True):
            assert psnr(image, rendered(at_time(content, time), camera)) > 45
        assert psnr(images[0], images[3]) < 25


def test_windows_of_any_shape_show_all_of_a_view(page, tmp_path):
    views = cameras(1)
    source = WithPreview(ball(count=300).motion_file(), Preview("ball", views, target=ORIGIN))
    fx, fy = views.intrinsics[0, 0, 0].item(), views.intrinsics[0, 1, 1].item()
    cx, cy = views.intrinsics[0, :2, 2].tolist()
    with watching(page, write(tmp_path, source)):
        for width, height in ((960, 540), (640, 480), (360, 780)):
            found = page.evaluate(f"page.scene.camera.projection({width}, {height})")
            zoom = found["focal"][0] / fx
            assert found["focal"][1] == pytest.approx(zoom * fy)
            left, top = found["middle"][0] - zoom * cx, found["middle"][1] - zoom * cy
            assert min(left, top) == pytest.approx(0, abs=1e-3)
            assert left + zoom * views.width == pytest.approx(width - left, abs=1e-3)
            assert top + zoom * views.height == pytest.approx(height - top, abs=1e-3)


def test_keys_pointers_and_fingers_move_the_camera(page, tmp_path):
    preview = Preview("ball", cameras(3), target=ORIGIN)
    source = WithPreview(ball(count=300).motion_file(), preview)
    with watching(page, write(tmp_path, source)) as player:
        first = player.forward()
        assert np.allclose(first, preview.views.world_to_camera[0, 2, :3], atol=1e-6)
        page.press("ArrowLeft", 37)
        assert turned(first, player.forward()) > 0.1
        page.press("r", 82)
        page.wait_for("!page.scene.camera.path")
        assert turned(first, player.forward()) < 1e-3
        page.drag((200, 150), (260, 180))
        assert turned(first, player.forward()) > 10
        assert np.allclose(
            player.position() + player.distance() * player.forward(), ORIGIN, atol=1e-3
        )
        before = player.distance()
        page.wheel(200, 150, 300)
        assert player.distance() > 1.2 * before
        before = player.distance()
        touch(page, "touchStart", (150, 150), (250, 150))
        touch(page, "touchMove", (100, 150), (300, 150))
        touch(page, "touchEnd")
        assert player.distance() == pytest.approx(before / 2)
        place = player.position()
        touch(page, "touchStart", (150, 150))
        for step in range(1, 6):
            touch(page, "touchMove", (150 + 10 * step, 150))
        touch(page, "touchEnd")
        assert np.linalg.norm(player.position() - place) > 0.1
        page.press("2", 50)
        page.wait_for("!page.scene.camera.path")
        assert np.allclose(player.forward(), preview.views.world_to_camera[1, 2, :3], atol=1e-6)


def turned(before, after):
    """Angle between two directions, in degrees."""
    return np.degrees(np.arccos(np.clip(before @ after, -1, 1)))


def touch(page, kind, *fingers):
    points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(fingers)]
    page.command("Input.dispatchTouchEvent", type=kind, touchPoints=points)


def test_a_double_click_goes_to_what_is_under_the_pointer(page, tmp_path):
    with watching(page, write(tmp_path, ball(count=2000))) as player:
        before = player.distance()
        page.click((240, 180))
        page.click((240, 180))
        page.wait_for("!!page.scene.camera.path")
        page.wait_for("!page.scene.camera.path")
        target = player.position() + player.distance() * player.forward()
        assert 0.6 < np.linalg.norm(target - ORIGIN.numpy()) < 1.2
        assert player.distance() < before


def test_the_slider_and_the_space_bar_steer_time(page, tmp_path):
    with watching(page, write(tmp_path, moving_ball(count=200))) as player:
        assert page.evaluate("document.body.classList.contains('playing')")
        page.press(" ", 32)
        assert not page.evaluate("document.body.classList.contains('playing')")
        stopped = player.stats()["time"]
        page.evaluate(
            "(() => { const slider = document.getElementById('time'); slider.value = 0.25;"
            " slider.dispatchEvent(new Event('input')); })()"
        )
        assert player.stats()["time"] == 0.25 != stopped
        assert page.evaluate("document.getElementById('now').textContent") == "3.00"
        page.press(".", 190)
        assert player.stats()["time"] == pytest.approx(0.25 + 1 / 30)
        page.press(" ", 32)
        page.wait_for("gsfw.stats().time > 0.4")


def test_nothing_plays_by_itself_where_less_motion_is_wanted(page, tmp_path):
    feature = {"name": "prefers-reduced-motion", "value": "reduce"}
    page.command("Emulation.setEmulatedMedia", features=[feature])
    with watching(page, write(tmp_path, moving_ball(count=200))) as player:
        assert not page.evaluate("document.body.classList.contains('playing')")
        assert player.stats()["time"] == 0


def test_a_title_is_text_whatever_it_contains(page, tmp_path):
    title = "<script>alert(1)</script> \"Ö\" & 'x' </title> {{scene}}"
    with watching(page, write(tmp_path, ball(count=50), title=title)):
        assert page.evaluate("document.title") == title
        assert title in page.text()


def test_a_part_of_a_scene_is_a_message_and_not_an_empty_page(page, tmp_path):
    path = write(tmp_path, ball(count=20000))
    text = path.read_text()
    start = text.index('octet-stream">') + len('octet-stream">')
    path.write_text(text[: start + 40000] + text[text.index("</script>", start) :])
    with watching(page, path) as player:
        assert "damaged or cut short" in player.problem()
    text = text[:start] + "QUJD" * 100 + text[start + 400 :]
    path.write_text(text)
    with watching(page, path) as player:
        assert "damaged or cut short" in player.problem()


def test_a_browser_without_webgl_says_so(page, tmp_path):
    page.command(
        "Page.addScriptToEvaluateOnNewDocument",
        source="HTMLCanvasElement.prototype.getContext = () => null;",
    )
    with watching(page, write(tmp_path, ball(count=50))) as player:
        assert "no WebGL 2" in player.problem()


def test_a_budget_shows_the_most_important_blocks_only(page, tmp_path):
    path = write(tmp_path, ball(count=40000, degree=0))
    page.open(f"{path.as_uri()}?budget=1000")
    player = Player(page)
    assert player.stats()["splats"] == 1 << 15
