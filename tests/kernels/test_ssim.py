"""The fused L1 and SSIM of all kernels."""

import pytest
import torch
from support.losses import images, relative_error
from torch import Tensor
from torch.autograd import forward_ad

from gsfw.core.operators import Operators


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("brightness", [0.0, 1.0])
def test_equal_flat_images_lose_nothing(operators, dtype, brightness):
    flat = torch.full((1, 20, 30, 3), brightness, dtype=dtype)
    l1, dssim = operators.l1_dssim(flat, flat.clone())
    assert float(l1) == 0.0
    assert float(dssim) == 0.0
    rendered = flat.clone().requires_grad_()
    sum(operators.l1_dssim(rendered, flat)).backward()
    assert float(rendered.grad.abs().max()) < 1e-7


def test_no_valid_pixel_gives_no_l1_and_no_gradient(operators):
    rendered, target, valid = images((1, 12, 12, 3), torch.float32)
    l1, dssim = operators.l1_dssim(rendered, target, torch.zeros_like(valid))
    (l1 + dssim).backward()
    assert l1.item() == 0.0
    assert dssim.item() == 1.0
    assert not rendered.grad.any()


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_what_is_not_finite_is_not_hidden(operators, bad, masked):
    rendered, target, valid = images((1, 30, 30, 3), torch.float32)
    valid[0, 4, 5] = False  # Even there.
    broken = rendered.detach().clone()
    broken[0, 4, 5, 1] = bad
    l1, dssim = operators.l1_dssim(broken, target, valid if masked else None)
    assert not (l1 + dssim).isfinite()


def test_images_that_are_not_contiguous_are_taken_too(operators):
    rendered, target, valid = images((1, 20, 24, 3), torch.float64)
    turned, other, mask = (tensor.transpose(1, 2) for tensor in (rendered, target, valid))
    found = operators.l1_dssim(turned, other, mask)
    expected = Operators().l1_dssim(rendered, target, valid)
    assert [value.item() for value in found] == pytest.approx([value.item() for value in expected])


def test_backward_may_run_twice(operators):
    rendered, target, valid = images((1, 20, 24, 3), torch.float32)
    l1, dssim = operators.l1_dssim(rendered, target, valid)
    (first,) = torch.autograd.grad(l1 + dssim, rendered, retain_graph=True)
    (second,) = torch.autograd.grad(l1 + dssim, rendered)
    assert torch.equal(first, second)


def test_second_derivatives_come_from_torch(operators):
    rendered, target, _ = images((1, 6, 6, 1), torch.float64)

    def curvature(operators: Operators) -> Tensor:
        _, dssim = operators.l1_dssim(rendered, target)
        (gradient,) = torch.autograd.grad(dssim, rendered, create_graph=True)
        return torch.autograd.grad(gradient.square().sum(), rendered)[0]

    assert relative_error(curvature(operators), curvature(Operators())) < 1e-12


@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated")  # Torch's own use of it.
def test_derivatives_carried_forward_come_from_torch(operators):
    rendered, target, _ = images((1, 6, 6, 1), torch.float64)
    with forward_ad.dual_level():
        dual = forward_ad.make_dual(rendered.detach(), torch.ones_like(target))
        _, dssim = operators.l1_dssim(dual, target)
        assert forward_ad.unpack_dual(dssim).tangent is not None


def test_a_target_that_needs_a_gradient_gets_it(operators):
    rendered, target, _ = images((1, 6, 6, 1), torch.float64)
    sum(operators.l1_dssim(rendered.detach(), target.requires_grad_())).backward()
    assert target.grad.any()


def test_half_precision_goes_to_torch(operators):
    rendered, target, _ = images((1, 20, 20, 3), torch.float32)
    half, other = rendered.detach().bfloat16(), target.bfloat16()
    found = operators.l1_dssim(half, other)
    assert [float(v) for v in found] == [float(v) for v in Operators().l1_dssim(half, other)]


def test_no_pixel_at_all_goes_to_torch(operators):
    empty = torch.ones(0, 6, 6, 3)
    valid = torch.ones(0, 6, 6, 1, dtype=torch.bool)
    assert [float(v) for v in operators.l1_dssim(empty, empty, valid)] == [0.0, 1.0]
