"""The constants of a step's kernels, which Python repeats."""

import re

from gsfw.kernels.cuda import step_jobs
from gsfw.kernels.cuda.source_files import headers


def test_constants_are_those_of_the_kernels():
    found = re.findall(r"constexpr int (\w+) = (\d+);", headers()["step_stages.h"])
    assert len(found) == 10
    assert {name: getattr(step_jobs, name) for name, _ in found} == {
        name: int(value) for name, value in found
    }


def test_a_warp_is_as_the_kernels_have_it():
    assert f"constexpr int WARP = {step_jobs.WARP};" in headers()["platform.h"]
