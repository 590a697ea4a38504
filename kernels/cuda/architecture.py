"""Architecture: what to compile for a device, given what the compiler knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gsfw.kernels.cuda.errors import CudaError

OLDEST = 70
"""The first architecture whose threads of a warp wait for each other only where they are told to.

NVRTC 12 compiles for it, NVRTC 13 begins at 75.
"""


@dataclass(frozen=True)
class Target:
    """Target of a kernel's compilation."""

    kind: Literal["cubin", "ptx"]
    """Machine code, or text that the driver translates to machine code when it loads it."""
    architecture: int
    """Ten times the compute capability, such as 90."""

    @property
    def name(self) -> str:
        """As NVRTC's options spell it: sm_90 for machine code, compute_90 for PTX."""
        return f"{'sm' if self.kind == 'cubin' else 'compute'}_{self.architecture}"


def choose_target(device: int, supported: Sequence[int]) -> Target:
    """The best that a compiler which knows the architectures ``supported`` can do for a device.

    Machine code runs on later devices of the same major version too; a major version that the
    compiler does not know gets PTX.

    Raises:
        CudaError: the device is older than what the compiler or the kernels support.
    """
    usable = [known for known in supported if OLDEST <= known <= device]
    if not usable:
        oldest = min((known for known in supported if known >= OLDEST), default=OLDEST)
        raise CudaError(
            f"the GPU has compute capability {_capability(device)}; this CUDA compiler and these "
            f"kernels need {_capability(oldest)} or newer.",
            "Volta (7.0) needs a torch built for CUDA 12, older GPUs are not supported: "
            "use rasterizer=cpu.",
        )
    newest = max(usable)
    return Target("cubin" if newest // 10 == device // 10 else "ptx", newest)


def _capability(architecture: int) -> str:
    return f"{architecture // 10}.{architecture % 10}"
