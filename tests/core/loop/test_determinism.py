"""What torch is switched to while a run lasts, and back from."""

import threading

import pytest
import torch

from gsfw.core.loop.determinism import deterministic


def switches() -> tuple[bool, bool | str]:
    cudnn = torch.backends.cudnn
    digits = cudnn.conv.fp32_precision if hasattr(cudnn, "conv") else cudnn.allow_tf32
    return torch.are_deterministic_algorithms_enabled(), digits


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_what_was_switched_is_as_before_even_after_an_error(device):
    before = switches()
    with pytest.raises(KeyError), deterministic(torch.device(device)):
        raise KeyError
    assert switches() == before


def test_algorithms_are_deterministic_on_the_cpu_alone():
    before = switches()
    with deterministic(torch.device("cpu")):
        assert torch.are_deterministic_algorithms_enabled()
    with deterministic(torch.device("cuda")):
        assert switches()[0] == before[0]


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_threads_that_are_inside_together_switch_back_when_the_last_one_leaves(device):
    before, entered, first_left = switches(), threading.Event(), threading.Event()
    inside = []

    def enter_while_the_other_is_inside():
        with deterministic(torch.device(device)):
            entered.set()
            first_left.wait(60)
            inside.append(switches())

    thread = threading.Thread(target=enter_while_the_other_is_inside)
    with deterministic(torch.device(device)):
        thread.start()
        assert entered.wait(60)
        on = switches()
    first_left.set()
    thread.join()
    assert inside == [on]
    assert switches() == before


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
