"""Worker threads: order, bounds and errors."""

import pytest

from gsfw.datamanagers.images import Header
from gsfw.preparation.writing import worker_threads
from gsfw.preparation.writing.worker_threads import in_order, workers_for


def test_results_come_in_the_order_of_the_items():
    assert list(in_order(lambda item: item * item, range(50), 4)) == [i * i for i in range(50)]


def test_no_more_items_are_taken_than_are_worked_on():
    taken = []

    def items():
        for item in range(20):
            taken.append(item)
            yield item

    results = in_order(abs, items(), 3)
    next(results)
    assert len(taken) == 4
    results.close()
    assert len(taken) == 4


def test_an_error_comes_where_its_result_would_have():
    def work(item):
        if item == 2:
            raise ValueError("two")
        return item

    results = in_order(work, range(9), 2)
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(ValueError, match="two"):
        next(results)


def header(width: int, height: int, has_alpha: bool = False) -> Header:
    return Header(width, height, has_alpha, 1)


def test_large_images_are_worked_on_one_at_a_time(monkeypatch):
    monkeypatch.setattr(worker_threads, "free_memory", lambda: 8e9)
    assert workers_for([header(3, 2), header(10_000, 10_000)], 8) == 1
    assert workers_for([header(4000, 3000)], 8) == 6
    assert workers_for([header(4000, 3000)], 2) == 2
    assert workers_for([header(4000, 3000), header(4000, 3000, has_alpha=True)], 8) == 4
    monkeypatch.setattr(worker_threads, "free_memory", lambda: 1e9)
    assert workers_for([header(4000, 3000)], 8) == 3
