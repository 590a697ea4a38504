"""Groups of processes: errors of torch.distributed become one sentence."""

import pytest

from gsfw.core.errors import LostProcessError
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
