"""The plan for very large scenes: formulas against counted bytes, and simulated faults."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scaling_faults as faults
import scaling_formulas as formulas
from hypothesis import given
from hypothesis import strategies as st
from scaling_checks import counted_copies
from scaling_costs import case
from scaling_formulas import Costs, Machine, View
from scaling_ways import MACHINE, Planner, with_failures
from support.memory_training import Recorder, trainer, with_parts
from support.thread_group import in_threads

from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.methods.gaussians3d.initialisation import from_splats
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.parallel.data_parallel import DataParallel
from gsfw.partition.costs import CostRule
from gsfw.studies.bench.steps import COLUMNS, RATE, LearningRate, with_harmonics

COSTS = Costs(
    view_row=3e-7, step_row=1e-7, splat=6e-7, pair=4e-9, pixel=5e-8, fixed=4e-3, decode=5e-9,
    latency=2e-4, bytes_per_second=6e8,
)  # fmt: skip
VIEW = View(width=1280, height=800)
ALONE = Machine(cores=1, memory_mb=1e4, network=1e9)

MOMENTS = ("first", "second")

rows = st.floats(1e3, 1e10)
sizes = st.integers(1, 512)


# Counted.


def test_a_checkpoint_holds_the_tensors_and_moments_of_the_optimizer():
    splats = with_harmonics(case(30, 16, 16).splats)
    rates = {name: LearningRate(RATE) for name in COLUMNS}
    model = StaticGaussians(from_splats(splats, 3), rates)
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    tensors = optimizer.tensors()
    moments = optimizer.state_dict()["moments"].values()
    saved = [item[name].nbytes for group in moments for item in group for name in MOMENTS]
    held = [tensor.nbytes for tensor in tensors]
    assert sum(held + saved) == formulas.checkpoint_bytes(30)


def test_memory_is_that_by_which_scenes_are_cut():
    rule = CostRule(pixels=100, views_per_point=2.0, all_points=5000, cache_mb=0)
    costs = rule.of(views=2, points=5000)
    assert costs.memory_mb == pytest.approx(formulas.memory_bytes(costs.gaussians, 5000) / 1e6)


@pytest.mark.unchecked
@pytest.mark.parametrize(("size", "views"), [(2, 4), (3, 4)])
@pytest.mark.parametrize(("strategy", "statistics"), [("none", 0), ("adc", 3)])
def test_bytes_of_data_parallelism_are_those_that_are_sent(
    tmp_path, size, views, strategy, statistics
):
    steps = 3

    def run(group):
        own = trainer(
            tmp_path / f"{group.rank}", strategy, Recorder(), steps=steps, views_per_step=views
        )
        own = with_parts(own, team=DataParallel(group))
        own.fit()
        return group.bytes_sent, sum(t.numel() for t in own.parts.optimizer.tensors())

    sent, parameters = in_threads(size, run)[0]
    expected = formulas.data_parallel_bytes(
        parameters, size, views, rows=100, statistics=statistics
    )
    # The agreement before each step and the losses come on top: some hundred bytes.
    assert expected * steps <= sent <= (expected + 1000 * size) * steps + 1000 * size


@pytest.mark.parametrize("size", [1, 2, 8, 64])
def test_bands_that_splats_touch_are_counted(size):
    scene = case(2000, 160, 120)
    # Splats at the borders of the picture touch fewer bands than others.
    assert counted_copies(scene, size) == pytest.approx(
        formulas.band_copies(scene.view, size), rel=0.25
    )


def test_sixteen_machines_send_nearly_as_many_bytes_of_gaussians_as_two():
    """Each has fewer splats, and their number is about that of the bands."""
    two, many = (formulas.gaussian_parallel_bytes(1e8, size, VIEW, 1) for size in (2, 16))
    assert 0.2 * two < many < 2 * two


# Formulas.


@given(rows, sizes)
def test_more_processes_never_need_more_memory_each_of_gaussians(count, size):
    fewer, more = (formulas.gaussian_parallel_memory(count, n, VIEW, 0.0) for n in (size, 2 * size))
    assert more <= fewer + 1e-6


@given(rows, sizes)
def test_a_process_alone_sends_nothing(count, size):
    assert formulas.data_parallel_bytes(count, 1, size, count, 3) == 0
    assert formulas.gaussian_parallel_bytes(count, 1, VIEW, size) == 0


@given(rows, st.floats(1.1, 100.0), sizes)
def test_more_gaussians_take_longer(count, factor, size):
    for seconds in (formulas.data_parallel_seconds, formulas.gaussian_parallel_seconds):
        few, many = (seconds(COSTS, ALONE, VIEW, n, size, size) for n in (count, factor * count))
        assert many >= few


@given(rows, sizes)
def test_without_a_network_gaussians_in_parallel_compute_no_longer_than_alone(count, size):
    free = replace(COSTS, latency=0.0, bytes_per_second=math.inf)
    machine = replace(ALONE, network=math.inf)
    together = formulas.gaussian_parallel_seconds(free, machine, VIEW, count, size, 4)
    assert together <= formulas.one_process_seconds(free, machine, VIEW, count, 4) * (1 + 1e-9)


@given(rows, st.floats(1e3, 1e6))
def test_blocks_fit_and_one_fewer_does_not(count, memory):
    blocks = formulas.blocks_for(count, memory, 0.0)
    assert blocks is not None
    assert formulas.memory_bytes(formulas.block_rows(count, blocks)) <= memory * 1e6 * (1 + 1e-9)
    if blocks > 2:
        fewer = formulas.memory_bytes(formulas.block_rows(count, blocks - 1))
        assert fewer > memory * 1e6 * (1 - 1e-9)


def test_points_alone_can_fill_a_machine():
    assert formulas.blocks_for(1e10, 200_000, points=5e9) is None


# Faults.


def test_simulated_jobs_take_as_long_as_the_formula_says():
    generator = np.random.default_rng(1)
    job = (3e5, 2000.0, 60.0, 100.0, 20_000.0)
    found = [faults.simulated_time(*job, generator) for _ in range(200)]
    assert np.mean(found) == pytest.approx(faults.time_with_failures(*job), rel=0.02)


@given(st.floats(1.0, 1000.0), st.floats(1e4, 1e7))
def test_other_intervals_of_checkpoints_are_not_better(checkpoint, between):
    best = faults.daly_interval(checkpoint, between)

    def time(interval):
        return faults.time_with_failures(1e6, interval, checkpoint, 60.0, between)

    assert all(time(best) <= 1.001 * time(best * factor) for factor in (0.5, 0.8, 1.25, 2.0))


def test_processes_wait_for_the_slowest():
    steps = [1.0] * 9 + [2.0]
    generator = np.random.default_rng(0)
    factors = [faults.straggling(steps, size, generator) for size in (1, 2, 10, 1000)]
    mean = 1.1
    expected = [1.0, (1 + 1 - 0.9**2) / mean, (2 - 0.9**10) / mean, 2 / mean]
    assert factors == pytest.approx(expected, rel=0.03)


# The plan.


def test_no_plan_is_made_that_does_not_fit():
    planner = Planner(COSTS, [1.0])
    for images, count in ((1e4, 1e6), (1e6, 1e9), (1e7, 1e10)):
        plans = [*planner.plans(images, count)]
        assert {"one process", "data parallel", "Gaussian parallel"} <= {p.mode for p in plans}
        for plan in plans:
            assert plan.works == (plan.memory_mb <= 1.001 * MACHINE.memory_mb), plan
            assert plan.hours > 0


def test_failures_cost_more_on_more_machines():
    hours = [with_failures(1e6, 1e7, size) for size in (1, 16, 128)]
    assert 1e6 < hours[0] < hours[1] < hours[2] < 1.5e6
