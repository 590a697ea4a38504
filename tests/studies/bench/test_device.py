"""What measuring asks of a GPU costs nothing on the CPU."""

import torch

from gsfw.studies.bench.device import begin_peak, gpu, peak_mb, warm_up

CPU = torch.device("cpu")


def test_the_cpu_has_no_peak_no_name_and_is_warm():
    assert begin_peak(CPU) == peak_mb(CPU) == 0.0
    assert gpu(CPU) is None
    warm_up(CPU)
