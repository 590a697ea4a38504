"""Waiting for a device, and bringing a saved state to it."""

import torch

from gsfw.core.loop.device import moved, wait_for


def test_there_is_nothing_to_wait_for_on_the_cpu():
    wait_for(torch.device("cpu"))


def test_every_tensor_of_a_nested_state_moves_and_the_rest_stays():
    state = {"a": torch.ones(2), "b": [{"c": torch.zeros(3)}, 7, "text"], "d": (None, 1.5)}
    there = moved(state, torch.device("meta"))
    assert there["a"].is_meta
    assert there["b"][0]["c"].is_meta
    assert there["b"][1:] == [7, "text"]
    assert there["d"] == (None, 1.5)
    assert not state["a"].is_meta
