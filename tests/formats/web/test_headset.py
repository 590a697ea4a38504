"""Pages in a headset: both eyes see what our rasterizer draws, and the page is left as it was."""

import numpy as np
import pytest
from support.chromium import needs_chromium
from support.headset import Headset, eyes_of, pose
from support.web_player import psnr, rendered, watching
from support.web_scenes import ORIGIN, WithPreview, at_time, ball, cameras, moving_ball

from gsfw.core.exchange import Preview
from gsfw.formats.web.html import HtmlExporter

pytestmark = [pytest.mark.slow, needs_chromium]

METRE = float((cameras(1).centers - ORIGIN).norm()) / 2
"""World units of a metre, of pages that know no other: the first view is 2 m from the ball."""
UP = np.array([0.0, 0.0, 1.0])
START = pose([0.4, 1.6, -0.2], yaw=0.7, pitch=0.4)
"""First pose of the head in its room: away from the middle, turned, and looking up."""


@pytest.fixture
def headset(page):
    return Headset(page)


def write(tmp_path, content, **options):
    path = tmp_path / "scene.html"
    source = WithPreview(content.motion_file(), Preview("ball", cameras(1), target=ORIGIN))
    HtmlExporter(**options).write(path, source)
    return path


def room_at(view, head, metre=METRE):
    """[4, 4] from the room, in world units, to the world: the head is at the view, and level."""

    def level(forward, up):
        ahead = forward - up * (forward @ up)
        ahead /= np.linalg.norm(ahead)
        return np.stack([np.cross(ahead, up), up, ahead], axis=1)

    camera = np.linalg.inv(view.world_to_camera[0].numpy())
    room = np.eye(4)
    room[:3, :3] = level(camera[:3, 2], UP) @ level(-head[:3, 2], np.array([0, 1.0, 0])).T
    room[:3, 3] = camera[:3, 3] - metre * room[:3, :3] @ head[:3, 3]
    return room


def seen(splats, head, room, metre=METRE, size=(160, 120)):
    """What the rasterizer draws for each eye."""
    return [rendered(splats, eye.camera(room, metre, *size)) for eye in eyes_of(head)]


def test_each_eye_sees_what_the_rasterizer_draws_for_it(page, headset, tmp_path):
    content = ball(count=3000, degree=3)
    with watching(page, write(tmp_path, content)):
        headset.enter()
        room = room_at(cameras(1), START)
        beyond = START[:3, 3] - 4 * pose([0, 0, 0], yaw=0.7)[:3, 2]
        behind = pose(beyond, yaw=0.7 + np.pi, pitch=0.4)
        for head in (START, pose([0.1, 1.2, -0.5], yaw=0.5, pitch=0.45), behind):
            found, expected = headset.look(head), seen(content.splats, head, room)
            for image, drawn in zip(found, expected, strict=True):
                assert drawn.std() > 0.1
                assert (image[..., 3] == 1).all()
                assert psnr(image[..., :3], drawn) > 45
            assert psnr(found[0][..., :3], expected[1]) < 25


def test_a_moving_scene_plays_on(page, headset, tmp_path):
    content = moving_ball(count=1500)
    with watching(page, write(tmp_path, content)) as player:
        page.press(" ", 32)
        player.look(cameras(1), time=0.25)
        page.press(" ", 32)
        headset.enter()
        headset.image(START)
        begun = player.stats()["time"]
        headset.image(START, milliseconds=20, count=30)
        time = player.stats()["time"]
        assert time == pytest.approx(begun + 30 * 0.02 / 2)  # It takes 2 seconds.
        found = headset.look(START)
        expected = seen(at_time(content, time), START, room_at(cameras(1), START))
        assert all(
            psnr(image[..., :3], drawn) > 45 for image, drawn in zip(found, expected, strict=True)
        )


def test_metres_are_those_of_the_author_and_sticks_move_turn_and_enlarge(page, headset, tmp_path):
    content = ball(count=1500)
    with watching(page, write(tmp_path, content, metre=1.25)):
        headset.enter()
        room = room_at(cameras(1), START, 1.25)
        found, expected = headset.look(START), seen(content.splats, START, room, 1.25)
        assert psnr(found[0][..., :3], expected[0]) > 45
        start = headset.head()
        headset.push("left", 0.0, -1.0)
        headset.image(START, milliseconds=50, count=20)
        moved = headset.head()
        way = np.subtract(moved["position"], start["position"])
        assert np.allclose(way, 1.25 * 1.5 * np.array(start["axes"][2]), atol=1e-4)
        headset.push("right", 1.0, 0.0)
        headset.image(START, count=20)
        turned = headset.head()
        assert np.allclose(turned["position"], moved["position"], atol=1e-4)
        assert (heading(turned) - heading(moved)) % 360 == pytest.approx(330, abs=1e-3)
        headset.push("right", 0.0, 0.0)
        headset.image(START)
        headset.push("right", -1.0, 0.0)
        headset.image(START, count=20)
        assert np.allclose(headset.head()["axes"], start["axes"], atol=1e-5)
        headset.push("right", 0.0, -1.0)
        headset.image(START, milliseconds=50, count=20)
        assert np.allclose(headset.head()["position"], moved["position"], atol=1e-4)
        headset.push("right", 0.0, 0.0)
        aside = pose(START[:3, 3] + START[:3, 0], yaw=0.7, pitch=0.4)
        headset.image(aside)
        way = np.subtract(headset.head()["position"], moved["position"])
        assert np.linalg.norm(way) == pytest.approx(1.25 / np.e, rel=1e-3)
        page.evaluate("headset.session.dispatchEvent(new Event('select'))")
        headset.image(START)
        assert np.allclose(headset.head()["position"], start["position"], atol=1e-5)


def heading(head):
    """Direction of a head around the vertical, in degrees to the left."""
    return np.degrees(np.arctan2(head["axes"][2][1], head["axes"][2][0]))


def test_leaving_a_session_restores_the_page(page, headset, tmp_path):
    with watching(page, write(tmp_path, ball(count=1500))) as player:
        page.drag((200, 150), (230, 160))
        position, before = player.position(), player.canvas()
        headset.enter()
        headset.push("left", 1.0, -1.0)
        headset.image(START, milliseconds=50, count=20)
        page.resize(500, 400)
        page.resize(480, 360)
        page.click("#vr")
        page.wait_for("!headset.session")
        assert np.array_equal(player.position(), position)
        assert np.array_equal(player.canvas(), before)
        page.press("ArrowLeft", 37)
        assert not np.array_equal(player.position(), position)
        headset.enter()
        headset.image(START)
        present = page.evaluate("page.scene.camera.position")
        assert np.allclose(headset.head()["position"], present, atol=1e-6)


def test_a_page_without_a_headset_has_no_buttons_for_it(page, tmp_path):
    with watching(page, write(tmp_path, ball(count=50))):
        assert page.evaluate("Boolean(navigator.xr)")
        assert not shown_buttons(page) & {"vr", "ar"}
    page.command(
        "Page.addScriptToEvaluateOnNewDocument",
        source="Object.defineProperty(navigator, 'xr', { value: undefined });",
    )
    with watching(page, write(tmp_path, ball(count=50))):
        assert not shown_buttons(page) & {"vr", "ar"}


def shown_buttons(page):
    """The names of the visible buttons."""
    buttons = "[...document.querySelectorAll('nav button')]"
    return set(
        page.evaluate(f"{buttons}.filter((b) => b.getClientRects().length).map((b) => b.id)")
    )


def test_a_headset_that_is_plugged_in_later_has_its_button(page, headset, tmp_path):
    with watching(page, write(tmp_path, ball(count=50))):
        page.wait_for("!document.getElementById('vr').hidden")
        assert "ar" not in shown_buttons(page)
        headset.offer()
        page.wait_for("document.getElementById('vr').hidden")
        headset.offer("immersive-ar")
        page.wait_for("!document.getElementById('ar').hidden")


def test_a_refused_session_is_a_message_that_the_next_press_removes(page, headset, tmp_path):
    with watching(page, write(tmp_path, ball(count=500))) as player:
        page.wait_for("!document.getElementById('vr').hidden")
        page.evaluate("headset.refusal = 'The visitor said no.'")
        page.click("#vr")
        page.wait_for("!document.getElementById('problem').hidden")
        assert player.problem() == (
            "VR did not start: the browser or the device refused it (The visitor said no). Allow "
            "VR for this page, check that the device is on and no other page uses it, and press VR "
            "again."
        )
        page.evaluate("headset.refusal = null; headset.incompatible = true")
        page.click("#vr")
        page.wait_for("document.getElementById('problem').textContent.includes('graphics card')")
        assert player.problem() == (
            "VR did not start: the graphics card of this page does not serve the device (no way "
            "from this card to the headset). Let the browser use the card that the device is "
            "connected to, and reload the page."
        )
        assert page.evaluate("headset.session === null")
        page.click((240, 100))
        assert not player.problem()
        page.evaluate("headset.incompatible = false")
        headset.enter()


def test_augmented_reality_leaves_the_room_visible(page, headset, tmp_path):
    with watching(page, write(tmp_path, ball(count=1500), background="white")):
        headset.offer("immersive-ar")
        headset.enter("ar")
        for eye in headset.look(START):
            assert (eye[-1] == 0).all()
            assert eye[..., 3].max() > 0.95


def test_slow_images_become_smaller_and_then_have_fewer_splats(page, headset, tmp_path):
    with watching(page, write(tmp_path, ball(count=80_000, degree=0))) as player:
        headset.enter()
        headset.image(START, count=200)
        assert page.evaluate("headset.scales") == [1]
        page.evaluate("headset.visibility = 'visible-blurred'")
        headset.image(START, milliseconds=100, count=50)
        assert page.evaluate("headset.scales") == [1]
        page.evaluate("headset.visibility = 'visible'")
        headset.image(START, milliseconds=40, count=50)
        assert page.evaluate("headset.scales") == [1, 0.8]
        assert headset.look(START)[0].shape == (96, 128, 4)
        assert player.stats()["drawn"] == 80_000
        headset.image(START, milliseconds=40, count=500)
        assert page.evaluate("headset.scales") == [1, 0.8, 0.65, 0.65, 0.5, 0.5]
        headset.look(START)
        assert player.stats()["drawn"] == 1 << 15  # A whole block, as its rows lie side by side.


def test_a_lost_graphics_card_ends_the_session(page, headset, tmp_path):
    with watching(page, write(tmp_path, ball(count=50))) as player:
        headset.enter()
        page.evaluate(
            "page.scene.renderer.context.getExtension('WEBGL_lose_context').loseContext()"
        )
        page.wait_for("headset.session === null")
        assert "has dropped the scene. Reload the page" in player.problem()
