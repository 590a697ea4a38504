"""Moving measure: errors of a dynamic method in an extreme of time, against a float64 model."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from math import isnan, nan

import torch
from jaxtyping import Float, Float64, Int
from torch import Tensor

from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.model import PrimitiveModel
from gsfw.core.numerics import DEFAULT
from gsfw.core.splats import Splats
from gsfw.studies.stress.drawn import distance
from gsfw.studies.stress.judgement import HOPELESS, NO_WORSE
from gsfw.studies.stress.moving_case import MovingCase
from gsfw.studies.stress.result import CaseResult

ORDINARY = 1e-5
"""Largest error of splats in float32: positions and opacities absolutely or, where they are above
1, relative to themselves; covariances relative to their largest entry."""
GRADIENT = 1e-3
"""Largest error of the gradient of a column, in relative L2."""
WOBBLE = 2.0**-22
"""Size of the changes of parameters that measure the conditioning of a case: four roundings of
float32, as many as it takes to turn parameters into splats."""
NEGATIVE = 1e-6
"""Part of the largest entry by which an eigenvalue may be negative: the rounding of float32."""
FAINT = DEFAULT.alpha_min * 1.001
"""Opacity up to which splats may be left out or not."""


@dataclass(frozen=True)
class Instant:
    """Splats of a model at one time."""

    rows: Int[Tensor, " m"]
    """Rows of the model with splats."""
    values: Mapping[str, Tensor]
    """means [m, 3], opacities [m] and covariances [m, 3, 3]."""
    splats: Splats


def measure_moving(
    case: MovingCase, method: str, model: PrimitiveModel, dtype: torch.dtype
) -> CaseResult:
    """Evaluate a model at every time of a case; nothing is raised.

    Args:
        case: the extreme.
        method: whose model it is.
        model: in float32; it is left as it is.
        dtype: of the model that is looked at.
    """
    name = str(dtype).removeprefix("torch.")
    result = CaseResult(case.name, case.section.value, method, name, note=case.conditioning)
    lacking = case.lacking(model)
    if lacking:
        return replace(result, not_claimed=lacking, note="")
    try:
        narrow, wide = deepcopy(model), deepcopy(model)
        case.fill_(narrow)
        case.fill_(wide, truth=True)
        wide = wide.double()
        wobbled = _wobbled(wide) if case.conditioning else None
        return _looked_at(result, case, narrow.to(dtype), wide, wobbled)
    except Exception as error:  # Whatever a model raises is its result.
        return replace(result, faults=(f"fails with {type(error).__name__}: {error}",))


@torch.no_grad()
def _wobbled(model: PrimitiveModel) -> PrimitiveModel:
    """A copy of a float64 model with some roundings of float32 in every parameter."""
    generator, wobbled = torch.Generator().manual_seed(3), deepcopy(model)
    for parameter in wobbled.parameters():
        noise = torch.rand(parameter.shape, generator=generator, dtype=torch.float64)
        # A parameter of zeros stands for one of size 1 that does not deviate, as rotations
        # do that leave time alone: the rounding of values computed from it is of that size.
        size = parameter if bool(parameter.any()) else torch.ones_like(parameter)
        parameter.add_(WOBBLE * (2.0 * noise - 1.0) * size)
    return wobbled


def _looked_at(
    result: CaseResult,
    case: MovingCase,
    model: PrimitiveModel,
    wide: PrimitiveModel,
    wobbled: PrimitiveModel | None,
) -> CaseResult:
    faults, same = [], True
    for time in case.times:
        found = _instant(model, time)
        wrong = (*_unfit(found.splats), *_left_out(found, _instant(wide, time)))
        faults += [f"at t = {time:g} {fault}" for fault in wrong]
        same &= all(
            torch.equal(tensor, found.splats.tensors()[name])
            for name, tensor in _instant(model, time).splats.tensors().items()
        )
    errors, forward = _errors(model, wide, case.times)
    gradient = _gradients(model, wide, case.times)
    for name in case.truth:  # By other numbers there are other gradients.
        gradient.pop(name, None)
    allowed: dict[str, float] = {}
    if wobbled is not None:
        allowed = {**_errors(wobbled, wide, case.times)[0], **_gradients(wobbled, wide, case.times)}
    faults += [
        *_exceeding(errors, ORDINARY, allowed),
        *_exceeding(gradient, GRADIENT, allowed, "gradient of "),
    ]
    if not same:
        faults.append("the same time has other bits when asked for again")
    return replace(
        result,
        faults=tuple(dict.fromkeys(faults)),
        forward=forward,
        relative=max(errors.values()),
        gradient=gradient,
        others=errors,
        finite=not any("finite" in fault for fault in faults),
        deterministic=same,
    )


def _errors(
    model: PrimitiveModel, wide: PrimitiveModel, times: tuple[float, ...]
) -> tuple[dict[str, float], float]:
    """Largest relative error of each value over the times, and the largest absolute error."""
    errors, forward = {"means": 0.0, "opacities": 0.0, "covariances": 0.0}, 0.0
    for time in times:
        compared = _compared(_instant(model, time), _instant(wide, time))
        for name, (absolute, error) in compared.items():
            errors[name] = max(errors[name], error)
            forward = forward if name == "covariances" else max(forward, absolute)
    return errors, forward


def _exceeding(
    errors: Mapping[str, float], ordinary: float, allowed: Mapping[str, float], what: str = ""
) -> list[str]:
    """Faults of errors above the ordinary bound, or above the bound of an ill-conditioned case."""
    found = []
    for name, error in errors.items():
        conditioned = allowed.get(name, 0.0)
        bound = max(ordinary, NO_WORSE * conditioned)
        if isnan(error):
            found.append(f"{what}{name} is not finite")
        elif conditioned < HOPELESS and error > bound:
            found.append(f"{what}{name} is off by {error:.1e}, at most {bound:.1e} allowed")
    return found


def _instant(model: PrimitiveModel, time: float) -> Instant:
    # The time that float32 has, also for the float64 model.
    like = model.columns()["means"].values
    splats = model.splats(torch.tensor(time, dtype=torch.float32).to(like))
    rows = torch.arange(len(splats)) if splats.rows is None else splats.rows
    if splats.covariances is not None:
        covariances = splats.covariances
    else:
        assert splats.quats is not None
        assert splats.scales is not None
        covariances = _covariances(splats.quats, splats.scales)
    values = {"means": splats.means, "opacities": splats.opacities, "covariances": covariances}
    return Instant(rows, values, splats)


def _covariances(
    quats: Float[Tensor, "m 4"], scales: Float[Tensor, "m 3"]
) -> Float[Tensor, "m 3 3"]:
    """Covariances of quaternions of any norm, in float64, so that no rounding is added here."""
    axes = rotation_matrices(quats.double()) * scales.double()[:, None]
    return axes @ axes.transpose(1, 2)


def _unfit(splats: Splats) -> list[str]:
    """Reasons to refuse these splats."""
    tensors = splats.tensors()
    found = [f"{name} is not finite" for name, t in tensors.items() if not bool(t.isfinite().all())]
    if found:
        return found
    opacities = splats.opacities
    if bool(((opacities < 0) | (opacities > 1)).any()):
        found.append("opacities are outside [0, 1]")
    if splats.scales is not None and bool((splats.scales < 0).any()):
        found.append("scales are negative")
    if splats.covariances is not None:
        covariances = splats.covariances.detach().double()
        largest = covariances.flatten(1).abs().amax(1)
        negative = torch.linalg.eigvalsh(covariances)[:, 0] < -NEGATIVE * largest
        if bool(negative.any()):
            share = int(negative.sum()) / len(negative)
            found.append(f"{share:.0%} of the covariances are not positive semi-definite")
        if not torch.equal(covariances, covariances.transpose(1, 2)):
            found.append("covariances are not symmetric")
    return found


def _left_out(found: Instant, expected: Instant) -> list[str]:
    """A fault where only one of two shows a visible row."""
    faults = []
    for one, other in ((found, expected), (expected, found)):
        alone = one.values["opacities"][~torch.isin(one.rows, other.rows)]
        if bool((alone > FAINT).any()):
            faults.append("other rows are left out than in float64")
    return faults


def _compared(found: Instant, expected: Instant) -> dict[str, tuple[float, float]]:
    """Largest absolute and relative error of every value, over the common rows."""
    both = torch.isin(found.rows, expected.rows), torch.isin(expected.rows, found.rows)
    if not bool(both[0].any()):
        return {}
    errors = {}
    for name, values in found.values.items():
        mine = _flat(values[both[0]])
        theirs = _flat(expected.values[name][both[1]])
        absolute = (mine - theirs).abs().amax(1)
        size = theirs.abs().amax(1)
        unit = size.clamp_min(1e-300) if name == "covariances" else size.clamp_min(1.0)
        errors[name] = (_largest(absolute), _largest(absolute / unit))
    return errors


def _flat(values: Tensor) -> Float64[Tensor, "m k"]:
    return values.detach().double().reshape(len(values), -1)


def _largest(values: Tensor) -> float:
    return nan if bool(values.isnan().any()) else float(values.max())


def _gradients(
    model: PrimitiveModel, wide: PrimitiveModel, times: tuple[float, ...]
) -> dict[str, float]:
    """Errors of the gradients of all columns, from random weights of the splats over the times."""
    gradients = []
    for one in (model, wide):
        total = one.columns()["means"].values.sum() * 0.0
        for number, time in enumerate(times):
            instant = _instant(one, time)
            for values in instant.values.values():
                generator = torch.Generator().manual_seed(number)
                weights = torch.randn((one.num_rows, *values.shape[1:]), generator=generator)
                scale = values.detach().abs().max().clamp_min(1e-30) if len(values) else 1.0
                total = total + (weights[instant.rows].to(values) * values / scale).sum()
        total.backward()
        columns = {name: column.values for name, column in one.columns().items() if column.trained}
        gradients.append({n: v.grad for n, v in columns.items() if v.grad is not None})
    found, expected = gradients
    return {
        name: distance(tensor, expected[name], name) if bool(tensor.isfinite().all()) else nan
        for name, tensor in found.items()
        if name in expected
    }
