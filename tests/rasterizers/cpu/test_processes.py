"""The pool of threads among processes, signals, and Python's own threads."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gsfw.kernels.cpu.native_module import NOT_BUILT, instruction_sets

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not instruction_sets(), reason=NOT_BUILT),
    pytest.mark.skipif(sys.platform == "win32", reason="forks and signals are Unix's"),
]

PRELUDE = """
import multiprocessing, signal, threading, time

# What a shell has started in the background ignores SIGINT, and then Python does too.
signal.signal(signal.SIGINT, signal.default_int_handler)
import torch
from dataclasses import replace
from support.scenes import front_camera, random_splats
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.kernels.cpu.native_module import native
from gsfw.rasterizers.cpu import rasterizer
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer

rasterizer.num_threads = lambda: 2  # Whatever this machine has.
SMOOTH = RenderSettings(profile=DEFAULT.without_cutoffs())

def draw(count=3000, size=64, settings=None):
    splats = random_splats(count, 1).map(lambda tensor: tensor.requires_grad_())
    color = CpuRasterizer().render(splats, front_camera(size, size), settings).color
    color.sum().backward()
    return color.detach(), splats.means.grad
"""
"""What each program here starts with; two threads, because one has no pool."""


def run(program: str) -> str:
    """What a fresh interpreter prints."""
    tests = str(Path(__file__).parents[2])
    result = subprocess.run(
        [sys.executable, "-c", PRELUDE + program],
        env=os.environ | {"PYTHONPATH": tests + os.pathsep + os.environ.get("PYTHONPATH", "")},
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_a_forked_child_draws_the_same_as_its_parent():
    program = """
torch.set_num_threads(1)  # OpenMP, on which torch's own threads run, does not survive a fork.
expected = draw()
assert native().started_threads() == 1

def child(queue):
    found = draw()
    same = all(torch.equal(*pair) for pair in zip(found, expected))
    queue.put((same, native().started_threads()))

context = multiprocessing.get_context("fork")
for _ in range(3):
    queue = context.SimpleQueue()
    process = context.Process(target=child, args=(queue,))
    process.start()
    print(queue.get())
    process.join()
    print(process.exitcode)
assert torch.equal(draw()[0], expected[0])
"""
    assert run(program) == "(True, 1)\n0\n" * 3


def test_an_interrupt_during_an_image_is_delivered_when_it_is_done():
    program = """
drawn = []
began = time.perf_counter()
draw(3000, 96, SMOOTH)
seconds = time.perf_counter() - began

def interrupt():
    time.sleep(1.5 * seconds)
    signal.raise_signal(signal.SIGINT)

try:
    threading.Thread(target=interrupt).start()
    for _ in range(100):
        drawn.append(draw(3000, 96, SMOOTH)[0])
except KeyboardInterrupt:
    print("interrupted", len(drawn) < 100)
print(draw()[0].isfinite().all().item())
"""
    assert run(program) == "interrupted True\nTrue\n"


def test_other_python_threads_go_on_while_an_image_is_drawn():
    program = """
ticks, drawing = [], threading.Event()
splats = random_splats(4000, 1)

def tick():
    drawing.wait()
    while drawing.is_set():
        ticks.append(time.perf_counter())
        time.sleep(0.001)

thread = threading.Thread(target=tick)
thread.start()
drawing.set()
start = time.perf_counter()
CpuRasterizer().render(splats, front_camera(200, 200), SMOOTH)
end = time.perf_counter()
drawing.clear()
thread.join()
# Were the interpreter held, there would be none between the ends.
inside = [tick for tick in ticks if 0.25 < (tick - start) / (end - start) < 0.75]
print(len(inside) > 3)
"""
    assert run(program) == "True\n"


def test_images_of_several_python_threads_are_those_of_one():
    program = """
expected = [draw(1000 + 500 * i) for i in range(4)]
found = [None] * 4

def work(i):
    for _ in range(3):
        found[i] = draw(1000 + 500 * i)

threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print([all(torch.equal(*pair) for pair in zip(a, b)) for a, b in zip(found, expected)])
"""
    assert run(program) == "[True, True, True, True]\n"
