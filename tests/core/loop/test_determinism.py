"""What torch is switched to while a run lasts, and back from."""

import pytest
import torch

from gsfw.core.loop.determinism import deterministic


def switches() -> tuple[bool, bool]:
    return torch.are_deterministic_algorithms_enabled(), torch.backends.cudnn.allow_tf32


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_what_was_switched_is_as_before_even_after_an_error(device):
    before = switches()
    with pytest.raises(KeyError), deterministic(torch.device(device)):
        raise KeyError
    assert switches() == before


def test_algorithms_are_deterministic_on_the_cpu_alone():
    with deterministic(torch.device("cpu")):
        assert torch.are_deterministic_algorithms_enabled()
    with deterministic(torch.device("cuda")):
        assert not torch.are_deterministic_algorithms_enabled()


def test_convolutions_on_a_gpu_keep_all_digits():
    with deterministic(torch.device("cuda")):
        cudnn = torch.backends.cudnn
        new = getattr(cudnn, "conv", None)
        assert not cudnn.allow_tf32 if new is None else new.fp32_precision == "ieee"


@pytest.mark.cuda
def test_ssim_on_a_gpu_is_that_of_the_cpu():
    if not torch.cuda.is_available():
        pytest.skip("torch sees no GPU here")
    from gsfw.core.maths.ssim import ssim

    pictures = torch.rand(2, 1, 64, 80, 3, generator=torch.Generator().manual_seed(0))
    near = pictures[0] + 1e-3 * pictures[1]
    with deterministic(torch.device("cuda")):
        there = float(ssim(pictures[0].cuda(), near.cuda()))
    assert there == pytest.approx(float(ssim(pictures[0], near)), abs=1e-5)
