"""Steps are read from text, applied in order, counted, and kept in a file that repeats them."""

import json
from pathlib import Path

import pytest
import torch
from support.editing import WORLD, edited, nothing_around, piece_of
from support.scenes import random_splats

from gsfw.commands.edit.verb import EditOptions
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.maths.frame import transform_splats
from gsfw.editing.operations.catalogue import OPERATIONS
from gsfw.editing.script import Step, apply, read_steps, write_steps
from gsfw.plugins.keys import keys


def splats(count=40):
    return transform_splats(random_splats(count, 1, dtype=torch.float64), WORLD)


def test_every_operation_has_an_option_an_explanation_and_an_example_that_it_understands():
    explained = {key.name: key.help for key in keys(EditOptions(file=""))}
    assert explained.keys() >= OPERATIONS.keys()
    for name, operation in OPERATIONS.items():
        Step.of(name, operation.example)
        assert f"{name}=" in explained[name]
    others = {
        "file",
        "out",
        "format",
        "edits",
        "views",
        "time",
        "over_time",
        "step",
        "data",
        "device",
        "dry_run",
    }
    assert explained.keys() == OPERATIONS.keys() | others | {"json", "debug"}


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("crop.box", "1,2,3", "expected x,y,z,x,y,z of two corners, found '1,2,3'"),
        ("crop.box", "", "expected x,y,z,x,y,z of two corners, found ''"),
        ("crop.sphere", "0,0,0,-1", "expected a radius of at least 0, found -1"),
        ("move", "1,2,inf", "expected x,y,z, found '1,2,inf'"),
        ("rotate", "w,90", "'w' is no axis: expected x, y, z, -x, -y or -z"),
        ("rotate", "90", "expected x,y,z of the axis,degrees, found '90'"),
        ("scale", "-2", "expected a factor above 0, found '-2'"),
        ("true_size", "0,0,0,0,0,0,1", "the two points are the same"),
        ("align", "sun", "expected cameras or floor, found 'sun'"),
        ("prune.opacity", "2", "expected an opacity in [0, 1], found '2'"),
        ("prune.contribution", "1", "expected a part of the Gaussians, from 0 to below 1"),
        ("prune.views", "0", "expected a number of views, at least 1, found '0'"),
        ("clean", "dust", "expected all or some of not_finite, invisible, degenerate, needles"),
        ("sh_degree", "5", "expected a degree from 0 to 4, found '5'"),
        ("decimate.count", "many", "expected a number of Gaussians, at least 1, found 'many'"),
        ("color.white", "1,0,1", "the colour 1,0,1: expected parts above 0"),
    ],
)
def test_a_wrong_value_says_what_was_expected_and_gives_an_example(name, text, message):
    with pytest.raises(ConfigError) as refusal:
        Step.of(name, text)
    assert str(refusal.value).startswith(f"{name}={text}: {message}")
    assert refusal.value.advice == f"For example: {name}={OPERATIONS[name].example}"


def test_steps_are_applied_in_order_and_each_is_counted():
    lines, piece = [], piece_of(splats())
    steps = [Step.of("move", "0,0,100"), Step.of("crop.sphere", "4,5,94,3")]
    left = apply(steps, piece, nothing_around(), lambda result: lines.append(str(result)))
    assert 0 < len(left) < 40
    assert lines == ["move: 40 Gaussians", f"crop.sphere: 40 -> {len(left)} Gaussians"]
    with pytest.raises(DataError, match="sphere=4,5,94,3 leaves none of the 40 Gaussians"):
        apply(steps[::-1], piece, nothing_around(), lambda result: None)


@pytest.mark.parametrize(
    ("name", "text", "advice"),
    [
        ("cut.sphere", "0,0,0,99", "Values are in the units of the world"),
        ("prune.opacity", "1", "Leave the step out, or give a value that keeps more of them."),
    ],
)
def test_a_step_that_leaves_nothing_gives_the_advice_of_its_kind(name, text, advice):
    with pytest.raises(DataError) as refusal:
        apply([Step.of(name, text)], piece_of(splats()), nothing_around(), lambda result: None)
    assert refusal.value.advice.startswith(advice)


def test_a_file_of_steps_has_them_all(tmp_path):
    results = []
    steps = [Step.of("move", "0,0,1"), Step.of("prune.opacity", "0.3")]
    apply(steps, piece_of(splats()), nothing_around(), results.append)
    (tmp_path / "a.json").write_bytes(write_steps(results, "in.ply"))
    again = read_steps(tmp_path / "a.json")
    assert [(step.name, step.text) for step in again] == [
        ("move", "0,0,1"),
        ("prune.opacity", "0.3"),
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "this is no file of edits"),
        ("[]", "this is no file of edits"),
        ('{"format": "gsfw edits", "steps": [{"edit": "move", "value": 1}]}', "no file of edits"),
        ('{"format": "gsfw edits", "steps": [{"edit": "jump", "value": "1"}]}', "no edit 'jump'"),
    ],
)
def test_another_file_is_no_file_of_steps(tmp_path, content, message):
    path = tmp_path / "a.json"
    path.write_text(content)
    with pytest.raises(DataError, match=message):
        read_steps(path)
    with pytest.raises(DataError, match="there is no such file") as refusal:
        read_steps(tmp_path / "b.json")
    assert refusal.value.advice == (
        "Give the path of an .edits.json file that gsfw edit has written, absolute or from "
        f"{Path.cwd()}."
    )


def test_upright_needs_cameras_that_somebody_held():
    for name, text in (("align", "cameras"), ("prune.views", "2"), ("crop.views", "2")):
        with pytest.raises(ConfigError, match="holds splats, and no cameras") as refusal:
            edited(piece_of(splats(), invented=True), name, text)
        assert "views=RUN" in refusal.value.advice


def test_a_floor_needs_an_upward_direction():
    with pytest.raises(ConfigError, match="which way is up is not known") as refusal:
        edited(piece_of(splats()), "floor", "0")
    assert refusal.value.advice == "Align first: align=cameras"
    with pytest.raises(ConfigError, match="which way is up is not known"):
        edited(piece_of(splats(), up="Y-up"), "floor", "0")


def test_cameras_move_with_the_world():
    piece = piece_of(splats())
    count = len(edited(piece, "crop.views", "4").piece)
    assert 0 < count < 40
    moved = edited(edited(piece, "rotate", "1,2,3,77").piece, "scale", "3").piece
    assert len(edited(moved, "crop.views", "4").piece) == count
    before, after = piece.contributions(), moved.contributions()
    assert torch.allclose(before.total, after.total, rtol=1e-3, atol=1e-3)
    upright = edited(moved, "align", "cameras,-y").piece
    assert upright.up == "-y"
    again = edited(upright, "align", "cameras,-y")
    assert again.note.endswith("turned by 0.0 degrees to -y")


def test_what_nobody_sees_is_left_out():
    given = splats()
    hidden = given.means.clone()
    hidden[3] = hidden[3] + 1000
    piece = piece_of(given).with_splats(
        type(given)(hidden, given.opacities, given.colors, given.quats, given.scales)
    )
    seen = edited(piece, "prune.views", "1").piece
    assert not (seen.splats().means - hidden[3]).norm(dim=1).lt(1).any()
    assert len(edited(piece, "prune.contribution", "0.25").piece) == 30


def test_brightness_of_splats_keeps_their_degree_and_number():
    piece = edited(edited(piece_of(splats()), "color.brightness", "2").piece, "sh_degree", "0")
    assert piece.note == "SH degree 1 -> 0"
    assert piece.piece.degree == 0
    assert len(piece.piece) == 40


@pytest.mark.parametrize("name", [["crop.box"], {"a": 1}, 3, None])
def test_a_name_that_is_no_text_is_refused(tmp_path, name):
    path = tmp_path / "a.edits.json"
    steps = [{"edit": name, "value": "1"}]
    path.write_text(json.dumps({"format": "gsfw edits", "version": 1, "steps": steps}))
    with pytest.raises(DataError, match="there is no edit"):
        read_steps(path)
