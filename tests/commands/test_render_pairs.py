"""Every pair of options of `gsfw render` is honoured, or refused with cause and remedy."""

import hashlib
from functools import cache

import pytest
import torch

from gsfw.commands.interface.arguments import read_options
from gsfw.commands.interface.render_rules import check_channels, check_options
from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.commands.render import RenderOptions, render_request
from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import installed
from gsfw.rendering import paths, pictures, request, trails
from gsfw.rendering.key_frames import CameraPath, KeyFrame, write_camera_path
from gsfw.rendering.paths import find_camera
from gsfw.rendering.request import render

FILE = "camera=walk.json"
GIVEN = (
    "what=views", "what=orbit", "what=path", "what=spiral", "what=time", "what=orbit-time",
    "split=train", "channel=depth", "channel=color,motion", "channel=photo", "colormap=gray",
    "range=0,2", "bars=false", "labels=false", "background=1,0,0", "frames=4", "fps=7", "scale=2",
    "width=40", "time=1", "camera=eval_001", FILE, "projection=stereo", "projection=panorama",
    "eye_distance=0.3", "tracks=true", "tracks_count=3", "tracks_frames=1", "images=png16",
    "images=exr", "video=webp", "video=none",
)  # fmt: skip
"""Each option away from its default, those of few values with all that differ in kind."""


def partners(token: str) -> list[str]:
    """The options that follow in the list, and are not the same with another value."""
    name = token.split("=", maxsplit=1)[0]
    return [other for other in GIVEN[GIVEN.index(token) :] if not other.startswith(f"{name}=")]


def options_of(*tokens: str) -> RenderOptions:
    options = read_options("render", RenderOptions, ["run", *tokens])
    check_options(options)
    check_channels(options)
    return options


def refused(*tokens: str) -> bool:
    try:
        options_of(*tokens)
    except ConfigError:
        return True
    return False


ALONE = {
    "channel=photo": "what=views",
    "colormap=gray": "channel=depth, channel=color,motion",
    "range=0,2": "channel=depth, channel=color,motion",
    "eye_distance=0.3": "projection=stereo",
    "tracks_count=3": "tracks=true",
    "tracks_frames=1": "tracks=true",
}
"""Options that go with these ones only."""

APART = {
    "what=views": "frames=4 fps=7 scale=2 width=40 time=1 camera=eval_001 camera=walk.json "
    "projection=stereo projection=panorama tracks=true video=webp",
    "what=orbit": "split=train camera=eval_001 camera=walk.json tracks=true",
    "what=path": "split=train camera=eval_001 tracks=true",
    "what=spiral": "split=train camera=eval_001 camera=walk.json tracks=true",
    "what=time": "split=train time=1 camera=walk.json",
    "what=orbit-time": "split=train time=1 camera=eval_001 camera=walk.json",
    "split=train": "camera=walk.json",
    "channel=depth": "background=1,0,0 tracks=true",
    "fps=7": "images=exr video=none",
    "scale=2": "width=40",
    "projection=stereo": "tracks=true",
    "projection=panorama": "tracks=true",
    "images=exr": "video=webp",
}
"""Pairs that are refused."""


def is_expected(first: str, second: str) -> bool:
    """True if the table has the pair as one that is refused."""
    alone = any(
        token in ALONE and other not in ALONE[token].split(", ")
        for token, other in ((first, second), (second, first))
    )
    return alone or second in APART.get(first, "").split()


@pytest.mark.parametrize("token", GIVEN)
def test_pairs_of_options_are_refused_that_do_not_go_together_and_no_others(token):
    found = {other for other in partners(token) if refused(token, other)}
    assert found == {other for other in partners(token) if is_expected(token, other)}
    assert refused(token) == (token in ALONE)


@pytest.mark.parametrize(
    ("tokens", "message"),
    [
        ("what=orbit camera=eval_001", "camera=eval_001 what=orbit: only what=time renders from "
         "the camera of a view.\nRender what=time, or leave camera out."),
        ("split=train camera=walk.json", "split=train camera=walk.json: a camera path has no views "
         "of a split.\nRender what=views, or leave split out."),
        ("what=views width=640", "width=640 what=views: views have the size of their photos.\n"
         "Render a camera path (what=path), or leave width out."),
        ("eye_distance=0.3", "eye_distance=0.3 projection=camera: only stereo has two eyes.\n"
         "Render projection=stereo, or leave eye_distance out."),
        ("range=0,2", "range=0,2: colour maps and ranges are for channels of values, and "
         "none is drawn.\n"
         "Render channel=color,depth or another one of values, or leave range out."),
    ],
)  # fmt: skip
def test_a_refusal_has_both_options_the_cause_and_the_remedy(tokens, message):
    with pytest.raises(ConfigError) as refusal:
        options_of(*tokens.split())
    assert str(refusal.value) == message


EFFECTLESS = ("bars=false", "labels=false", "video=none")
"""Options that leave out what is not always there."""

SAME = {("what=path", FILE)}
"""What a file of a camera path is."""

OF_THE_RUN = {(FILE, "tracks=true")}
"""Refused because this path shows one time."""


@pytest.fixture(scope="module")
def shown(moving_run, tmp_path_factory):
    """Gives what identifies the files of a command; nothing where the run has no such thing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "LEAST_HEIGHT", 10)
        patch.setattr(paths, "FRAMES", 3)
        patch.setattr(trails, "OPAQUE", 0.01)  # Five steps make nothing opaque.
        patch.setattr(request, "choose_format", lambda asked: asked)
        patch.setattr(request, "write_film", written_film)
        composition = restore_run(find_run(str(moving_run), print), installed()).composition
        folder = tmp_path_factory.mktemp("pairs")
        patch.chdir(folder)
        data = composition.parts.data
        camera = find_camera(data, "eval_001")
        pose = torch.linalg.inv(data.scene.world_from_scene.camera(camera.world_to_camera[0]))
        frames = tuple(KeyFrame(pose, fov) for fov in (50.0, 60.0))
        write_camera_path(folder / "walk.json", CameraPath(frames, 2.0, 1.0))

        @cache
        def found(*tokens: str) -> str | None:
            out = tmp_path_factory.mktemp("out")
            try:
                render(composition, render_request(options_of(*tokens)), out, print)
            except ConfigError:
                return None
            digest = hashlib.blake2b()
            for file in sorted(out.rglob("*.*")):
                if file.name != "frames.json":
                    digest.update(f"{file.relative_to(out)}\0".encode() + file.read_bytes())
            return digest.hexdigest()

        yield found


def written_film(stem, frames, fps, chosen):
    """Stands for a film: its settings, which alone matter here."""
    if chosen == "none":
        return []
    path = stem.with_name(f"{stem.name}.film")
    path.write_text(f"{len(frames)} {fps} {chosen}")
    return [path]


@pytest.mark.slow
@pytest.mark.parametrize("token", GIVEN)
def test_a_pair_that_is_not_refused_shows_both_options(shown, token):
    for other in partners(token):
        pair = (token, other)
        if refused(*pair) or pair in SAME:
            continue
        together = shown(*pair)
        assert (together is None) == (pair in OF_THE_RUN)
        if together is not None:
            for one, beside in (pair, pair[::-1]):
                effectless = one in EFFECTLESS
                assert effectless or together != shown(beside), f"{one} changes nothing: {pair}"
