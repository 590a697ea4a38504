"""Affine changes of colour: the identity at the start, in the mean, and of the background."""

import json

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.exposures import Exposures
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

BACKGROUND = torch.tensor([0.2, 0.9, 0.4])


def exposures(changes=None, views: int = 3) -> Exposures:
    made = Exposures(tuple(f"view_{i}" for i in range(views)), LearningRate(1e-2))
    if changes is not None:
        with torch.no_grad():
            made.changes.copy_(changes)
    return made


def random_changes(views: int = 3):
    return 0.2 * torch.randn(views, 3, 4, generator=torch.Generator().manual_seed(2))


@pytest.fixture
def rendered() -> RenderOutput:
    settings = RenderSettings(background=BACKGROUND)
    return ReferenceRasterizer().render(random_splats(20, degree=0), front_camera(), settings)


def test_nothing_changes_at_the_start_to_the_bit(rendered):
    assert torch.equal(
        exposures().apply_to(rendered, torch.tensor([1]), BACKGROUND).color, rendered.color
    )


def test_what_splats_show_is_mapped_and_the_background_is_not(rendered):
    made = exposures(random_changes())
    matrix = made.matrices[2]
    behind = (1 - rendered.alpha) * BACKGROUND
    # Where splats cover a part of a pixel, that part of the pixel is mapped.
    shown = (rendered.color - behind) / rendered.alpha.clamp_min(1e-3)
    wanted = rendered.alpha * (shown @ matrix[:, :3].T + matrix[:, 3]) + behind
    found = made.apply_to(rendered, torch.tensor([2]), BACKGROUND).color
    clear = (rendered.alpha > 1e-3).expand_as(found)
    torch.testing.assert_close(found[clear], wanted[clear], atol=1e-6, rtol=0)
    empty = (rendered.alpha == 0).expand_as(found)
    assert empty.any()
    assert torch.equal(found[empty], rendered.color[empty])


def test_only_the_views_of_a_batch_have_a_gradient(rendered):
    made = exposures()
    made.apply_to(rendered, torch.tensor([1]), BACKGROUND).color.square().sum().backward()
    assert made.changes.grad[1].abs().min() > 0
    assert made.changes.grad[[0, 2]].abs().max() == 0


def test_the_mean_of_all_maps_is_held_at_the_identity():
    made = exposures(random_changes())
    apart = made.changes[0].detach() - made.changes[1].detach()
    made.project_()
    torch.testing.assert_close(made.matrices.mean(dim=0), torch.eye(3, 4))
    torch.testing.assert_close(made.changes[0].detach() - made.changes[1].detach(), apart)


def test_the_document_is_plain_data_by_name():
    document = json.loads(json.dumps(exposures(views=1).document()))
    identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
    assert document["exposures"] == {"view_0": identity}


def length_of_a_visit(views: int) -> float:
    """How far Adam moves the map of an image whose gradient changes sign from visit to visit."""
    made, lengths = exposures(views=views), []
    rate = made.group().learning_rate.at(0)
    adam = torch.optim.Adam([made.changes], rate, eps=1e-15)
    for visit in range(6):
        before = made.changes[0].detach().clone()
        for step in range(views):
            made.changes.grad = torch.zeros_like(made.changes)
            made.changes.grad[0] = (-1.0) ** visit * (step == 0)
            adam.step()
        lengths.append(float((made.changes[0].detach() - before).abs().mean()))
    return sum(lengths[2:]) / len(lengths[2:])


@pytest.mark.slow
def test_a_visit_moves_a_map_as_far_among_many_images_as_among_few():
    few = length_of_a_visit(20)
    assert length_of_a_visit(200) == pytest.approx(few, rel=0.3)
    assert exposures(views=3).group().learning_rate.at(0) == 1e-2
