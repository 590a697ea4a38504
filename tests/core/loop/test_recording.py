"""Streams of recorded work, and of packages that know the default stream alone."""

from contextlib import contextmanager

import pytest
import torch

from gsfw.core.loop.recording import on_default_stream


class Streams:
    """The streams of a GPU, and what waits for what."""

    def __init__(self, monkeypatch) -> None:
        self.order: list[str] = []
        self.default, self.own = Stream("default", self.order), Stream("own", self.order)
        self.current = self.own

        @contextmanager
        def within(stream):
            before, self.current = self.current, stream
            yield
            self.current = before

        monkeypatch.setattr(torch.cuda, "current_stream", lambda device: self.current)
        monkeypatch.setattr(torch.cuda, "default_stream", lambda device: self.default)
        monkeypatch.setattr(torch.cuda, "stream", within)


class Stream:
    def __init__(self, name: str, order: list[str]) -> None:
        self.name, self._order = name, order

    def wait_stream(self, other) -> None:
        self._order.append(f"{self.name} waits for {other.name}")


def test_work_on_the_default_stream_is_in_order_with_the_work_around_it(monkeypatch):
    streams = Streams(monkeypatch)
    with on_default_stream(torch.device("cuda", 0)):
        streams.order.append(f"work on {streams.current.name}")
    assert streams.current is streams.own
    assert streams.order == ["default waits for own", "work on default", "own waits for default"]


def test_later_work_waits_for_what_failed(monkeypatch):
    streams = Streams(monkeypatch)
    with pytest.raises(RuntimeError), on_default_stream(torch.device("cuda", 0)):
        raise RuntimeError("out of memory")
    assert streams.order[-1] == "own waits for default"


def test_the_cpu_has_no_streams():
    with on_default_stream(torch.device("cpu")):
        pass
