"""Groups of processes: errors of torch.distributed become one sentence."""

from types import SimpleNamespace

import pytest

from gsfw.core.errors import LostProcessError, SilentProcessError
from gsfw.parallel import group
from gsfw.parallel.group import losses_named


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (
            "[gloo/pair.cc:1] Connection closed by peer. See the log.\nMore",
            "Connection closed by peer",
        ),
        ("", "RuntimeError"),
        ("[gloo/pair.cc:1] ", "RuntimeError"),
    ],
)
def test_a_lost_process_is_named_with_the_cause_or_the_kind_of_error(text, cause):
    with pytest.raises(LostProcessError) as caught, losses_named():
        raise RuntimeError(text)
    assert caught.value.message == (
        f"another process of this training has ended or does not answer ({cause})."
    )


@pytest.mark.parametrize(
    ("seconds", "kind"),
    [(0, LostProcessError), (110, LostProcessError), (119, SilentProcessError)],
)
def test_a_process_is_silent_if_nearly_the_longest_wait_has_passed(monkeypatch, seconds, kind):
    monkeypatch.setenv("GSFW_PATIENCE", "2")
    times = iter([1000.0, 1000.0 + seconds])
    monkeypatch.setattr(group, "time", SimpleNamespace(monotonic=lambda: next(times)))
    with pytest.raises(LostProcessError) as caught, losses_named():
        raise RuntimeError("Connection closed by peer")
    assert type(caught.value) is kind
