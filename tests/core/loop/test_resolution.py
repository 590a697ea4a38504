"""When images grow: monotone, full in good time, later where there is little detail."""

import numpy as np
import pytest
import torch
from support.scenes import front_camera

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.loop.resolution import (
    FACTORS,
    FULL_SIZE,
    MEASURED_VIEWS,
    MIN_SIDE,
    ResolutionSchedule,
    measured,
    planned,
    reduced_size,
)
from gsfw.core.scene import Scene

BLACK = torch.zeros(3)


class Pictures(DataManager):
    """Grey images, with masks where they are given."""

    def __init__(self, pictures, masks=None) -> None:
        self.pictures, self.masks, self.loaded = pictures, masks, []
        cameras = tuple(front_camera(picture.shape[1], picture.shape[0]) for picture in pictures)
        self.train = Views(tuple(f"t{i}" for i in range(len(pictures))), cameras)

    @property
    def scene(self) -> Scene:
        raise NotImplementedError

    def views(self, split: Split) -> Views:
        assert split is Split.TRAIN
        return self.train

    def load(self, split, indices, device) -> list[Batch]:
        self.loaded += indices
        return [
            Batch(
                torch.from_numpy(self.pictures[i]).float()[None, :, :, None].expand(-1, -1, -1, 3),
                self.train.cameras[i],
                (i,),
                mask=None
                if self.masks is None
                else torch.from_numpy(self.masks[i])[None, ..., None],
            )
            for i in indices
        ]


def noisy(width: int = 300, height: int = 280, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((height, width))


def smooth(width: int = 300, height: int = 280) -> np.ndarray:
    rows, columns = np.linspace(-1, 1, height)[:, None], np.linspace(-1, 1, width)
    return 0.5 + 0.5 * np.cos(3 * rows) * np.sin(4 * columns)


def natural(width: int = 300, height: int = 280, seed: int = 0) -> np.ndarray:
    """Magnitudes fall with frequency, as those of photographs do."""
    spectrum = np.fft.fft2(noisy(width, height, seed))
    rows, columns = np.fft.fftfreq(height)[:, None], np.fft.fftfreq(width)
    picture = np.fft.ifft2(spectrum / np.maximum(np.hypot(rows, columns), 1 / width)).real
    return (picture - picture.min()) / np.ptp(picture)


def factors(schedule: ResolutionSchedule, steps: int = 10_000) -> list[float]:
    return [schedule.factor(step) for step in range(steps)]


def of(*pictures: np.ndarray, steps: int = 9000) -> ResolutionSchedule:
    return measured(Pictures(pictures), BLACK, steps)


def test_images_only_grow_and_are_full_in_the_end():
    for schedule in (of(natural()), of(smooth()), of(noisy())):
        assert factors(schedule) == sorted(factors(schedule), reverse=True)
        assert factors(schedule)[9000:] == [1.0] * 1000
        assert schedule.factor(schedule.full_from) == 1.0


def test_photographs_start_coarse_and_grow_in_several_steps():
    schedule = of(natural())
    assert schedule.factor(0) >= 2.8
    assert len(schedule.stages) >= 4
    assert 0.4 * 9000 < schedule.full_from < 0.9 * 9000


def test_a_smooth_image_is_trained_coarse_for_longer_than_a_noisy_one():
    flat, rich = of(smooth()), of(noisy())
    assert flat.full_from > of(natural()).full_from > rich.full_from > 0
    assert sum(factors(flat)) > 1.5 * sum(factors(rich))


def test_each_size_gets_the_share_of_steps_by_which_it_adds_detail():
    schedule = planned({4.0: 0.4, 2.0: 0.7, 2**0.5: 0.9}, steps=1000)
    assert schedule.stages == ((0, 4.0), (400, 2.0), (700, 2**0.5), (900, 1.0))
    assert [schedule.factor(step) for step in (0, 399, 400, 899, 900)] == [4, 4, 2, 2**0.5, 1]


def test_training_starts_at_the_smallest_size_that_keeps_a_quarter_of_the_detail():
    schedule = planned({4.0: 0.24, 2.0: 0.25, 2**0.5: 0.25}, steps=1000)
    assert schedule.stages == ((0, 2.0), (250, 1.0))
    assert planned({2.0: 0.2}, steps=1000) == FULL_SIZE


def test_an_image_without_detail_is_full_after_the_given_steps():
    assert of(np.full((600, 600), 0.5)).stages == ((0, FACTORS[-1]), (9000, 1.0))


def test_short_runs_and_small_images_are_full_from_the_start():
    assert of(natural(), steps=299) == FULL_SIZE
    assert of(natural(), steps=0) == FULL_SIZE
    assert of(natural(90, 300)) == FULL_SIZE
    assert factors(FULL_SIZE, 5) == [1.0] * 5
    assert FULL_SIZE.full_from == 0


def test_it_is_the_same_whenever_it_is_measured():
    data = Pictures([natural(seed=i) for i in range(20)])
    first = measured(data, BLACK, 9000)
    assert data.loaded == [0, 2, 5, 7, 10, 12, 15, 17]
    assert len(data.loaded) == MEASURED_VIEWS
    assert measured(data, BLACK, 9000) == first


def test_what_a_mask_hides_does_not_count_as_detail():
    mask = np.ones((280, 300), dtype=bool)
    mask[:, 150:] = False
    half = np.where(mask, natural(), noisy())
    hidden = measured(Pictures([half], [mask]), BLACK, 9000)
    assert hidden.full_from > of(half).full_from


@pytest.mark.parametrize(
    ("size", "factor", "expected"),
    [
        ((640, 359), 4.0, (160, 90)),
        ((640, 359), 2**0.5, (453, 254)),
        ((640, 359), 8.0, (114, 64)),
        ((64, 200), 4.0, (64, 200)),
        ((30, 20), 8.0, (30, 20)),
        ((640, 359), 1.0, (640, 359)),
    ],
)
def test_the_short_side_keeps_its_least_size(size, factor, expected):
    assert reduced_size(*size, factor) == expected


def test_views_of_several_sizes_are_each_reduced_as_far_as_they_may_be():
    large, small = natural(512, 512), natural(100, 70)
    data = Pictures([large, small])
    schedule = measured(data, BLACK, 9000)
    assert schedule.factor(0) > 2
    reduced = [schedule.reduce(data.load(Split.TRAIN, [i], None)[0], 0) for i in range(2)]
    assert reduced[0].images.shape[1] == round(512 / schedule.factor(0))
    assert reduced[1].images.shape[1:3] == (MIN_SIDE, round(100 * MIN_SIDE / 70))
    assert [batch.cameras.height for batch in reduced] == [
        batch.images.shape[1] for batch in reduced
    ]


def test_full_images_are_passed_on_as_they_are():
    (batch,) = Pictures([natural()]).load(Split.TRAIN, [0], None)
    assert FULL_SIZE.reduce(batch, 0) is batch
    assert of(natural()).reduce(batch, 9000) is batch


def test_intrinsics_follow_by_the_exact_ratio_per_axis():
    (batch,) = Pictures([natural(641, 359)]).load(Split.TRAIN, [0], None)
    cameras: Cameras = ResolutionSchedule(((0, 2.0),)).reduce(batch, 0).cameras
    ratios = torch.tensor([cameras.width / 641, cameras.height / 359, 1.0])
    assert torch.equal(cameras.intrinsics[0], batch.cameras.intrinsics[0] * ratios[:, None])


def test_notes_say_where_images_start_and_when_they_are_full():
    assert planned({4.0: 0.4, 2**0.5: 0.9}, steps=1000).note(1000) == (
        "Images start at 1/4 of their size and reach full size after 900 steps "
        "(resolution_schedule=auto)."
    )
    assert planned({2.0**1.5: 0.4}, steps=1000).note(1000).startswith("Images start at 1/2.8 of")
    assert FULL_SIZE.note(150) == (
        "resolution_schedule=auto leaves all images at full size: it takes resolution_steps of "
        "at least 300 (here 150), and images of at least 91 pixels on the short side that keep "
        "a quarter of their detail when they shrink."
    )
