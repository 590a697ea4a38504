"""A survey makes one measurement after the other."""

from collections.abc import Iterator
from contextlib import closing, contextmanager

import pytest

from gsfw.core.datamanager import DataRequest
from gsfw.core.progress import Advance, shown_by
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.preparation.check.survey import Survey


@pytest.mark.parametrize("first", ["agreement", "cross_check", "view_dependence", "time_order"])
def test_a_measurement_that_needs_others_begins_after_them(first):
    running: list[str] = []
    together: list[list[str]] = []

    @contextmanager
    def show(name: str, total: int) -> Iterator[Advance]:
        running.append(name)
        together.append([*running])
        yield lambda done: None
        running.remove(name)

    config = SyntheticConfig(views=4, eval_views=1, width=64, height=48, points=50)
    with closing(config.build(DataRequest(None))) as data, shown_by(show):
        getattr(Survey(data), first)
    assert together
    assert max(map(len, together)) == 1, together
