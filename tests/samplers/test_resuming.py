"""Runs with samplers that know of times or losses are interrupted in the middle of an epoch."""

import pytest
from support.resuming import resumes_to_the_same_bits


@pytest.mark.slow
@pytest.mark.parametrize(
    "sampler",
    [
        ("sampler=sequential", "sampler.first_steps=9", "sampler.views_per_step=2"),
        (
            "sampler=progressive",
            "sampler.window=0.5",
            "sampler.growth=0.25",
            "sampler.grow_every=6",
        ),
        ("sampler=error-weighted", "sampler.uniform_share=0.1"),
    ],
    ids=["sequential", "progressive", "error-weighted"],
)
def test_a_run_resumes_to_the_same_bits(tmp_path, sampler):
    summary = resumes_to_the_same_bits(tmp_path, "method=spacetime", "strategy=none", *sampler)
    assert summary["skipped_steps"] == 0
