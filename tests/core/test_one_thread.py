"""Work in one thread of torch leaves torch's threads as they were."""

import threading

import torch

from gsfw.core.one_thread import one_thread


def test_work_in_two_threads_leaves_the_number_of_threads_as_it_was():
    before, both_work, one_is_done = torch.get_num_threads(), threading.Event(), threading.Event()
    found: list[int] = []

    def first() -> None:
        with one_thread():
            other.start()
            both_work.wait(10)
        one_is_done.set()

    def second() -> None:
        with one_thread():
            both_work.set()
            one_is_done.wait(10)

    other = threading.Thread(target=second)
    torch.set_num_threads(2)
    try:
        for target in (first, lambda: found.append(torch.get_num_threads())):
            thread = threading.Thread(target=target)
            thread.start()
            thread.join()
            other.join()
    finally:
        torch.set_num_threads(before)
    assert found == [2]


def test_work_inside_of_work_keeps_to_its_thread_and_its_share():
    before = torch.get_num_threads()
    torch.set_num_threads(4)
    try:
        with one_thread() as outer:
            with one_thread() as inner:
                assert (outer, inner) == (4, 4)
            assert torch.get_num_threads() == 1
            other: list[int] = []

            def work() -> None:
                with one_thread() as share:
                    other.append(share)

            thread = threading.Thread(target=work)
            thread.start()
            thread.join()
            assert other == [2]
        assert torch.get_num_threads() == 4
    finally:
        torch.set_num_threads(before)
