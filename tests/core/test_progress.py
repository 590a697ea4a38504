"""Progress: stages reach whoever watches, and cost nothing where nobody does."""

from contextlib import contextmanager

import pytest

from gsfw.core.progress import shown_by, stage, tracked


class Watcher:
    """Writes down what it is told."""

    def __init__(self):
        self.events = []

    @contextmanager
    def show(self, name, total):
        self.events.append((name, total))
        try:
            yield self.events.append
        finally:
            self.events.append(f"{name} ended")


def test_a_stage_that_nobody_watches_does_its_work():
    with stage("work", 3) as advance:
        advance(1)
    assert list(tracked("abc", "letters", 3)) == ["a", "b", "c"]


def test_an_item_of_a_loop_is_done_when_the_next_one_is_asked_for():
    watcher = Watcher()
    with shown_by(watcher.show):
        for _ in tracked("ab", "letters", 2):
            watcher.events.append("in")
    assert watcher.events == [("letters", 2), "in", 1, "in", 2, "letters ended"]


def test_stages_reach_the_innermost_watcher_and_then_the_former_one():
    outer, inner = Watcher(), Watcher()
    with shown_by(outer.show):
        with shown_by(inner.show), stage("first"):
            pass
        with stage("second"):
            pass
    with stage("third"):
        pass
    assert inner.events == [("first", 0), "first ended"]
    assert outer.events == [("second", 0), "second ended"]


def test_a_stage_that_fails_is_ended_and_its_error_is_passed_on():
    watcher = Watcher()
    with shown_by(watcher.show), pytest.raises(ValueError, match="broken"), stage("work"):
        raise ValueError("broken")
    assert watcher.events == [("work", 0), "work ended"]
