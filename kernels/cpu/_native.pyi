from torch import Tensor

from gsfw.kernels.render_arguments import (
    KernelGradients,
    KernelInputs,
    KernelOutputs,
    KernelSettings,
)

def instruction_sets() -> list[str]:
    """Instruction sets this machine can run, the best first; "scalar" is the last."""

def instruction_set() -> str:
    """The one that is used."""

def use_instruction_set(name: str) -> bool:
    """Use another one from now on; False when this machine cannot run it."""

def started_threads() -> int:
    """Threads that the pool has started so far, the callers' not counted."""

def fma_gflops() -> float:
    """Multiply-adds of one thread with the set in use, in 10^9 operations per second."""

def exponential_gexp() -> float:
    """Powers of two of one thread with the set in use, in 10^9 per second."""

PAIR_BYTES: int
SLOT_FIELDS: int

class TooManyPairs(RuntimeError):
    """An image has more pairs of a splat and a tile than it may; the argument says how many."""

class RenderPassFloat32:
    """One camera's image, and its backward pass."""

    def __init__(
        self,
        inputs: KernelInputs,
        settings: KernelSettings,
        outputs: KernelOutputs,
        threads: int,
    ) -> None: ...
    def backward(self, gradients: KernelGradients) -> None: ...
    def times(self) -> dict[str, tuple[float, float]]: ...
    @property
    def pairs(self) -> int: ...

class RenderPassFloat64(RenderPassFloat32): ...

def keep_freed_memory() -> None:
    """Let the process's allocator keep what is freed instead of giving it back."""

def set_last_words(cause: str, advice: str, exit_code: int) -> None:
    """Say something in place of a stack trace if the process aborts."""

def clear_last_words() -> None:
    """Let the process abort as it did before."""

def l1_dssim(
    rendered: Tensor, target: Tensor, valid: Tensor | None, gradient: Tensor | None, threads: int
) -> tuple[float, float]:
    """Mean absolute difference and 1 - SSIM of [c, h, w, d] over the valid pixels (uint8).

    The latter's gradient is written to ``gradient`` where one is given.
    """

def l1_dssim_backward(
    rendered: Tensor,
    target: Tensor,
    valid: Tensor | None,
    dssim_gradient: Tensor,
    l1: float,
    dssim: float,
    gradient: Tensor,
    threads: int,
) -> None:
    """Write to ``gradient`` what flows back for these gradients of the two losses."""

def adam(
    values: Tensor,
    gradient: Tensor,
    first: Tensor,
    second: Tensor,
    rows: Tensor | None,
    beta1: float,
    beta2: float,
    bias2: float,
    rate: float,
    epsilon: float,
    gradient_limit: float,
    threads: int,
) -> bool:
    """One step of Adam in place on [n, ...], over all rows or over some (int64).

    False, and nothing is done, if the numbers of a row lie apart or shapes differ.
    """

def all_finite(numbers: Tensor, threads: int) -> bool:
    """True if all numbers of a contiguous array are finite."""

def add_noise(
    means: Tensor,
    quats: Tensor,
    log_scales: Tensor,
    opacity_logits: Tensor,
    noise: Tensor,
    rate: float,
    opacity: float,
    sharpness: float,
    threads: int,
) -> None:
    """Add noise shaped by covariances to ``means`` [n, 3], in place; all are contiguous."""

def plane_product(
    places: Tensor,
    planes: list[Tensor],
    lines: list[Tensor],
    scale: float,
    features: Tensor,
    threads: int,
) -> None:
    """Write to ``features`` [n, levels * d] the products of six features at ``places`` [n, 3]."""

def plane_product_backward(
    places: Tensor,
    planes: list[Tensor],
    lines: list[Tensor],
    scale: float,
    gradient: Tensor,
    places_gradient: Tensor,
    planes_gradients: list[Tensor],
    lines_gradients: list[Tensor],
    threads: int,
) -> None:
    """Add the gradients of places, planes and lines to arrays of zeros."""

def network(
    inputs: Tensor,
    weights: list[Tensor],
    biases: list[Tensor],
    trunk: int,
    least: Tensor | None,
    gate: int,
    outputs: list[Tensor],
    threads: int,
) -> None:
    """Write the outputs of heads; where head ``gate`` is below ``least``, the others are 0."""

def network_backward(
    inputs: Tensor,
    weights: list[Tensor],
    biases: list[Tensor],
    trunk: int,
    gradients: list[Tensor],
    inputs_gradient: Tensor | None,
    weights_gradient: Tensor,
    threads: int,
) -> None:
    """Write the gradients of each layer's weights and biases in turn, and add the inputs'."""

def hash_features(
    places: Tensor,
    time: float,
    tables: list[Tensor],
    sizes: list[tuple[int, int]],
    primes: list[int],
    features: Tensor,
    threads: int,
) -> None:
    """Write to ``features`` [n, levels * d] the rows of ``tables`` interpolated at ``places``."""

def hash_features_backward(
    places: Tensor,
    time: float,
    tables: list[Tensor],
    sizes: list[tuple[int, int]],
    primes: list[int],
    gradient: Tensor,
    tables_gradients: list[Tensor],
    threads: int,
) -> None:
    """Add the gradients of the tables to arrays of zeros."""

def slice(
    left: Tensor,
    right: Tensor,
    scales: Tensor,
    covariances: Tensor,
    velocities: Tensor,
    variances: Tensor,
    threads: int,
) -> None:
    """Write the slices [n, 9], [n, 3], [n] of Gaussians with two quaternions and four scales."""

def slice_backward(
    left: Tensor,
    right: Tensor,
    scales: Tensor,
    covariances: Tensor,
    velocities: Tensor,
    variances: Tensor,
    to_left: Tensor,
    to_right: Tensor,
    to_scales: Tensor,
    threads: int,
) -> None:
    """Write the gradients of quaternions and scales for those of the slices."""

def grid_variation(
    grid: Tensor,
    order: int,
    first_weight: float,
    second_weight: float,
    gradient: Tensor | None,
    threads: int,
) -> float:
    """Weighted sum of squared differences of [o, a, b, i] along a and b (order 1) or a (2)."""

def grid_distance(
    values: Tensor, center: float, weight: float, gradient: Tensor | None, threads: int
) -> float:
    """Sum of |value - center|; ``gradient`` receives ``weight`` times its sign."""

def sweep_views(
    images: list[Tensor],
    poses: Tensor,
    intrinsics: Tensor,
    chosen: list[int],
    neighbors: list[list[int]],
    near: list[float],
    far: list[float],
    planes: list[int],
    depths: list[Tensor],
    scores: list[Tensor],
    contrasts: list[Tensor],
    threads: int,
) -> None:
    """Write depth, match and contrast [h, w] of the pixels of the ``chosen`` views."""

def fuse_views(
    depths: list[Tensor],
    poses: Tensor,
    intrinsics: Tensor,
    empty: list[Tensor],
    neighbors: list[list[int]],
    depth_tolerance: float,
    pixel_tolerance: float,
    confirmations: int,
    contradictions: int,
    points: list[Tensor],
    kinds: list[Tensor],
    threads: int,
) -> None:
    """Write points [h, w, 3] that views agree on; pixels are 1 if confirmed, 2 if kept."""
