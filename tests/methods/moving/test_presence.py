"""When Gaussians in time are there."""

import pytest
import torch

from gsfw.methods.moving.presence import Presence

CASES = ((0.5, 0.2), (0.0, 0.1), (1.3, 0.4), (-2.0, 1.0), (0.4, 1e-3), (0.5, 10.0))


def presence(n: int = 1) -> Presence:
    centers, deviations = torch.tensor(CASES, dtype=torch.float64).T.repeat(1, n)
    return Presence(centers, deviations.square())


def weights(times: torch.Tensor) -> torch.Tensor:
    """Of every case at every time."""
    centers, deviations = torch.tensor(CASES, dtype=torch.float64).T
    return torch.exp(-0.5 * ((times[:, None] - centers) / deviations) ** 2)


def test_means_and_peaks_are_those_of_the_weights_over_the_sequence():
    over_time = weights(torch.linspace(0, 1, 200_001, dtype=torch.float64))
    torch.testing.assert_close(presence().means(), over_time.mean(0), rtol=0, atol=2e-5)
    torch.testing.assert_close(presence().peaks(), over_time.amax(0))


def test_times_are_drawn_in_proportion_to_the_weights():
    times = presence(20_000).draw(torch.Generator().manual_seed(0)).view(20_000, len(CASES))
    assert bool(((times >= 0) & (times <= 1)).all())
    grid = torch.linspace(0, 1, 20_001, dtype=torch.float64)
    density = weights(grid) / weights(grid).sum(0)
    torch.testing.assert_close(times.mean(0), (grid[:, None] * density).sum(0), rtol=0, atol=0.01)


@pytest.mark.parametrize("center", [-3.0, 4.0])
@pytest.mark.parametrize("deviation", [1e-8, 1e-3])
def test_what_is_never_there_is_drawn_at_the_nearest_end(center: float, deviation: float):
    never = Presence(torch.tensor([center]), torch.tensor([deviation**2]))
    assert never.means().tolist() == never.peaks().tolist() == [0.0]
    assert never.draw(torch.Generator().manual_seed(0)).tolist() == [float(center > 0)]


@pytest.mark.parametrize("deviation", [1e-8, 1e8])
def test_the_shortest_and_the_longest_have_times_too(deviation: float):
    extreme = Presence(torch.full((100,), 0.25), torch.full((100,), deviation**2))
    times = extreme.draw(torch.Generator().manual_seed(0))
    assert bool(times.isfinite().all())
    if deviation < 1:
        torch.testing.assert_close(times, torch.full((100,), 0.25))
    else:
        assert float(times.std()) == pytest.approx(12**-0.5, abs=0.04)
        assert float(extreme.means()[0]) == pytest.approx(1.0)
