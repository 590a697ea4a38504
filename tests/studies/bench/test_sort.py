"""Both sorts get the same pairs, and give the same order."""

import torch
from emulation.launcher import EmulatedLauncher

from gsfw.studies.bench import sort


def test_both_sorts_are_measured_and_agree(monkeypatch):
    monkeypatch.setattr(sort, "REPEATS", 1)
    monkeypatch.setattr(sort, "WARM_UP", 1)
    depth, tile = sort.compare_sorts(EmulatedLauncher(0), torch.device("cpu"), 300)
    assert (depth["sort"], depth["keys"], depth["bits"]) == ("depth", 300, 32)
    # 1920x1080 has 120 x 68 tiles, and each splat meets nine.
    assert (tile["sort"], tile["keys"], tile["bits"]) == ("tile", 2700, 13)
    for found in (depth, tile):
        assert found["same"] is True
        assert found["radix_sort_ms"] > 0.0
        assert found["torch_sort_spread_ms"] == 0.0
