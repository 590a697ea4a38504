"""Tests of gsfw.studies.stress.claimed: a partial backend is judged on what it claims."""

from dataclasses import replace

import pytest
import torch

from gsfw.core.capabilities import Determinism, Feature
from gsfw.core.rasterizer import Rasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.entrants import Entrant
from gsfw.studies.stress.catalogue import CASES
from gsfw.studies.stress.measure import Oracle, measure

pytestmark = pytest.mark.unchecked

ABLE = ReferenceRasterizer.capabilities()


class Partial(Rasterizer):
    """The reference without some features, which it must not be asked for."""

    def __init__(self, lacking):
        self._able = replace(ABLE, features=ABLE.features - lacking, determinism=Determinism.NONE)

    @classmethod
    def capabilities(cls):
        return ABLE

    def _render(self, splats, cameras, settings):
        assert not settings.needs().features - self._able.features
        assert (
            Feature.POSE_GRADIENT in self._able.features
            or not cameras.world_to_camera.requires_grad
        )
        assert Feature.GRADIENT in self._able.features or not splats.means.requires_grad
        return ReferenceRasterizer().render(splats, cameras, settings)


def result_of(name, *lacking):
    backend = Partial(set(lacking))
    entrant = Entrant("partial", backend, backend._able, torch.device("cpu"), (1,))
    return measure(entrant, CASES[name], torch.float64, Oracle(ReferenceRasterizer()))


@pytest.mark.parametrize(
    "lacking",
    [
        (Feature.ANTIALIAS, Feature.ABSGRAD),
        (Feature.POSE_GRADIENT,),
        (Feature.GRADIENT, Feature.POSE_GRADIENT),
        (Feature.DEPTH, Feature.SH, Feature.CONTRIBUTION, Feature.SCREEN_GRADIENT),
    ],
)
def test_a_case_is_judged_without_what_a_backend_does_not_claim(lacking):
    result = result_of("shape/discs", *lacking)
    assert result.passed
    assert set(result.left_out) >= {feature.value for feature in lacking}


@pytest.mark.parametrize(
    ("name", "feature"),
    [
        ("shape/discs/expected-depth", Feature.DEPTH),
        ("shape/one-needle/antialias-floor", Feature.ANTIALIAS),
        ("colour/degree-2", Feature.SH),
        ("colour/ragged", Feature.RAGGED_SH),
        ("colour/extra-1e4", Feature.EXTRA),
        ("shape/needle-covariances", Feature.COVARIANCES),
    ],
)
def test_a_case_about_a_feature_is_not_for_a_backend_without_it(name, feature):
    result = result_of(name, feature)
    assert feature.value in result.not_claimed
    assert not result.left_out


def test_most_cases_of_claimed_cameras_are_for_a_backend_with_colours_alone():
    judged = [
        name
        for name in ("opacity/zero", "depth/equal", "position/far-1e6", "shape/needles")
        if name in CASES and not result_of(name, *(ABLE.features - {Feature.FLOAT64})).not_claimed
    ]
    assert len(judged) >= 3


def test_a_complete_backend_has_whole_cases():
    result = result_of("shape/discs")
    assert result.passed
    assert not result.left_out
    assert {"world_to_camera", "means"} <= result.gradient.keys()
    assert {"depth", "absgrad"} <= result.others.keys()
