"""Tests of gsfw.viewer.frame_service, with a page that is none."""

from types import SimpleNamespace

import pytest
import torch

from gsfw.viewer.frame_service import FrameService


@pytest.mark.unchecked  # The page is none.
def test_a_page_is_told_that_the_gpu_is_full_and_what_to_do():
    def fail(state: object, scale: float) -> None:
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.25 GiB.")

    told = []
    page = SimpleNamespace(
        wanted=lambda now, seconds: SimpleNamespace(state=None, scale=1.0),
        fail=lambda request, text: told.append(text),
    )
    service = FrameService([])
    service.maker = SimpleNamespace(make=fail)
    assert service._serve(page, 0.0)
    assert told == [
        "The GPU's memory is full: 2.25 GiB were asked for. Make the window smaller, or start the "
        "viewer with fewer Gaussians (budget=500000)."
    ]
