"""Learning rates as functions of the step."""

import pytest

from gsfw.core.learning_rate import COOLED, Cooldown, LearningRate


def test_it_decays_log_linearly_and_then_stays():
    rate = LearningRate(1.6e-4, 1.6e-6, steps=1000)
    assert rate.at(0) == pytest.approx(1.6e-4)
    assert rate.at(500) == pytest.approx(1.6e-5)
    assert rate.at(1000) == pytest.approx(1.6e-6)
    assert rate.at(5000) == pytest.approx(1.6e-6)


def test_without_a_final_value_it_is_constant():
    assert LearningRate(5e-3).at(0) == LearningRate(5e-3).at(10_000) == 5e-3


def test_it_is_zero_before_its_phase_and_counts_from_there():
    rate = LearningRate(1.0, 0.01, steps=10, start=100)
    assert rate.at(99) == 0.0
    assert rate.at(100) == 1.0
    assert rate.at(105) == pytest.approx(0.1)


def test_a_rate_of_zero_stays_zero():
    assert LearningRate(0.0, 1.0, steps=10).at(5) == 0.0


def test_no_steps_at_all_means_the_final_value_from_the_second_step_on():
    assert LearningRate(1.0, 0.1, steps=0).at(1) == pytest.approx(0.1)


def test_a_cooldown_falls_linearly_at_the_end_and_then_stays():
    cooldown = Cooldown(start=80, end=100)
    factors = [cooldown.factor(step) for step in (0, 80, 90, 100, 500)]
    assert factors == pytest.approx([1.0, 1.0, (1 + COOLED) / 2, COOLED, COOLED])


def test_no_steps_of_cooldown_are_none():
    assert Cooldown().factor(0) == Cooldown(100, 100).factor(100) == 1.0
