"""CUDA graphs on a GPU: captures that fail, and the memory of many."""

import pytest
import torch

from gsfw.core.loop.recording import CudaRecorder

pytestmark = [
    pytest.mark.cuda,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no GPU here"),
]

MEGABYTE = 2**20


@pytest.fixture
def device() -> torch.device:
    torch.cuda.empty_cache()
    return torch.device("cuda", torch.cuda.current_device())


def test_after_a_capture_that_failed_memory_is_given_back_and_others_succeed(device):
    recorder, values = CudaRecorder(device), torch.ones(3, device=device)
    with recorder.working():
        with pytest.raises(RuntimeError):
            recorder.record(lambda: values.add_(float(values.sum())))
        before = torch.cuda.memory_reserved(device)
        passing = torch.ones(64 * MEGABYTE, dtype=torch.uint8, device=device)
        passing.record_stream(torch.cuda.default_stream(device))
        del passing
        torch.cuda.synchronize(device)
        torch.cuda.empty_cache()
        assert torch.cuda.memory_reserved(device) <= before
        recorder.release(at_once=True)
        recording = recorder.record(lambda: values.add_(1.0))
        recording.replay()
        recording.replay()
    torch.cuda.synchronize(device)
    assert values.tolist() == [3.0, 3.0, 3.0]


def test_a_growing_model_keeps_memory_of_few_of_its_earlier_sizes(device):
    recorder = CudaRecorder(device)
    largest = 0
    with recorder.working():
        for size in range(32, 96, 2):  # In megabytes: each needs a block that is a little larger.
            total = torch.zeros((), device=device)

            def work(size=size, total=total) -> None:
                total.add_(torch.ones(size * MEGABYTE // 4, device=device).sum())

            recorder.record(work).replay()
            assert float(total) == size * MEGABYTE // 4
            recorder.release()
            largest = max(largest, torch.cuda.memory_reserved(device))
    assert largest < 6 * 96 * MEGABYTE
