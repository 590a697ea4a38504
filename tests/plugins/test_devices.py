"""What ``device`` may name, and what is said where there is no such device."""

import pytest
import torch
from support.small_scene import SMALL_SCENE

from gsfw.core.errors import ConfigError
from gsfw.kernels.cpu.native_module import NOT_BUILT, native
from gsfw.plugins.compose import compose
from gsfw.plugins.devices import find_device
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve


def refusal(name: str) -> str:
    with pytest.raises(ConfigError) as caught:
        find_device(name)
    return str(caught.value)


@pytest.fixture
def gpus(monkeypatch):
    """A machine with as many GPUs as asked for, and a torch that is built for them."""

    def pretend(count: int, current: int = 0) -> None:
        monkeypatch.setattr(torch.version, "cuda", "13.0")
        monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
        monkeypatch.setattr(torch.cuda, "current_device", lambda: current)

    return pretend


def test_the_cpu_has_no_number():
    assert find_device("cpu") == find_device("cpu:0") == torch.device("cpu")


@pytest.mark.parametrize("name", ["gpu", "cuda:-1", "cuda:one", "mps", "meta", ""])
def test_other_names_are_refused(name):
    assert refusal(name) == (
        f"device={name}: expected auto, cpu, cuda, or cuda:N with the number of a GPU."
    )


def test_cuda_is_the_gpu_that_is_current(gpus):
    gpus(2, current=1)
    assert find_device("cuda") == torch.device("cuda:1")
    assert find_device("cuda:0") == torch.device("cuda:0")


def test_a_number_too_high_names_those_there_are(gpus):
    gpus(1)
    assert refusal("cuda:1") == (
        "device=cuda:1: this machine has cuda:0 alone.\nUse device=cpu, or see gsfw doctor."
    )
    gpus(3)
    assert refusal("cuda:7").startswith("device=cuda:7: this machine has cuda:0 to cuda:2.")


def test_without_a_gpu_torch_or_the_machine_is_named(gpus, monkeypatch):
    gpus(0)
    assert refusal("cuda") == (
        "device=cuda: torch (built for CUDA 13.0) sees no GPU on this machine.\n"
        "Use device=cpu, or see gsfw doctor."
    )
    monkeypatch.setattr(torch.version, "cuda", None)
    assert refusal("cuda:0") == (
        f"device=cuda:0: this torch ({torch.__version__}) is built without CUDA.\n"
        "Use device=cpu, or see gsfw doctor."
    )


def test_a_run_says_in_one_sentence_why_the_gpu_is_not_used(monkeypatch):
    if torch.cuda.is_available() or native() is None:
        pytest.skip(NOT_BUILT if native() is None else "there is a GPU here")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    scene = dict(item.split("=") for item in SMALL_SCENE)
    said = []
    for device in ("auto", "cpu"):
        values = {"method": "3dgs", "device": device, **scene}
        run = compose(resolve(installed(), [Layer(COMMAND_LINE, values)]), installed())
        assert run.parts.device == torch.device("cpu")
        said.append([note for note in run.notes() if "GPU" in note])
        run.parts.data.close()
    ((note,), nothing) = said
    assert note.startswith("there is a GPU, but rasterizer cuda cannot use it: ")
    assert nothing == [], "the CPU was asked for"
