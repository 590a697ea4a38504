import pytest
import torch

from gsfw.compat import cuda_on_cpu
from gsfw.compat.cuda_on_cpu import CudaOnCpu

pytestmark = pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU to name")


@pytest.mark.slow
def test_tensors_that_are_asked_for_on_cuda_are_on_the_cpu(tmp_path):
    torch.save(torch.ones(2), tmp_path / "tensor.pt")
    with CudaOnCpu():
        made = [
            torch.zeros(2, device="cuda"),
            torch.tensor([1.0], device=torch.device("cuda")),
            torch.ones(2).cuda(),
            torch.ones(2).to("cuda"),
            torch.ones(2).pin_memory(),
            torch.ones(2).type("torch.cuda.DoubleTensor"),
            torch.cuda.FloatTensor(2).fill_(0),
            torch.rand(2, generator=torch.Generator(device="cuda"), device="cuda"),
            torch.load(tmp_path / "tensor.pt", map_location="cuda:0"),
            torch.load(f=tmp_path / "tensor.pt", map_location="cuda:0"),
            torch.nn.Linear(2, 2).cuda().weight,
            torch.ones(2).to(torch.device("cuda:0"), torch.float64),
        ]
    assert {tensor.device.type for tensor in made} == {"cpu"}
    assert made[-1].dtype == torch.float64


@pytest.mark.slow
def test_calls_that_need_a_gpu_do_nothing_and_come_back_afterwards():
    before = torch.cuda.Event, torch.cuda.synchronize, torch.load, torch.Generator
    with CudaOnCpu():
        start, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        start.record()
        torch.cuda.synchronize()
        end.record()
        assert start.elapsed_time(end) >= 0
        torch.cuda.set_device(torch.device("cuda:0"))
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats()
        assert torch.cuda.max_memory_allocated() == 0
        assert 0 < torch.cuda.mem_get_info()[0] <= torch.cuda.mem_get_info()[1]
        with torch.cuda.device(0), torch.cuda.stream(torch.cuda.Stream()):
            torch.cuda.current_stream().wait_stream(torch.cuda.Stream())
        assert not torch.cuda.is_available()
    assert before == (torch.cuda.Event, torch.cuda.synchronize, torch.load, torch.Generator)


def test_a_script_that_requires_a_gpu_is_told_of_one_only_where_it_is_claimed():
    with CudaOnCpu(claim_gpu=True):
        assert torch.cuda.is_available()
        assert torch.cuda.device_count() == 1
        assert not torch.cuda.is_current_stream_capturing()
        assert torch.accelerator.current_accelerator() is None
        torch.manual_seed(3)
        weights = torch.nn.Linear(2, 2).cuda()
        weights(torch.ones(1, 2, device="cuda")).sum().backward()
        torch.optim.Adam(weights.parameters()).step()
        with torch.autocast("cuda", dtype=torch.bfloat16):
            assert torch.ones(2, device="cuda").sum() == 2
    assert not torch.cuda.is_available()
    assert torch.cuda.device_count() == 0


def test_a_default_device_of_cuda_is_the_cpu():
    try:
        with CudaOnCpu():
            torch.set_default_device("cuda")
            assert torch.zeros(2).device.type == "cpu"
    finally:
        torch.set_default_device(None)


def test_a_device_has_properties_and_its_random_state_is_that_of_the_cpu():
    with CudaOnCpu():
        found = torch.cuda.get_device_properties("cuda:0")
        assert (found.name, found.total_memory) == ("cpu", torch.cuda.mem_get_info()[1])
        assert torch.cuda.get_device_capability(0) == (found.major, found.minor)
        state = torch.cuda.get_rng_state("cuda")
        first = torch.rand(3, device="cuda")
        torch.cuda.set_rng_state(state)
        assert torch.equal(first, torch.rand(3, device="cuda"))


def test_memory_has_a_figure_where_the_system_does_not_tell(monkeypatch):
    monkeypatch.delattr(cuda_on_cpu.os, "sysconf")
    assert cuda_on_cpu._memory() == (cuda_on_cpu.ASSUMED_MEMORY,) * 2
