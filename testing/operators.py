"""Promises of operators: the same numbers as plain torch."""

from __future__ import annotations

import torch

from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate, Operators
from gsfw.testing.promise import NotApplicable, Promise, require
from gsfw.testing.subject import Subject

CPU = torch.device("cpu")


def _operators(subject: Subject) -> Operators:
    kind: type[Operators] = subject.target
    if kind.preference(CPU) is None:
        raise NotApplicable("it does not run on the CPU")
    return kind()


def _losses_agree(subject: Subject) -> None:
    own, plain = _operators(subject), Operators()
    generator = torch.Generator().manual_seed(0)
    images = torch.rand(2, 2, 20, 24, 3, generator=generator)
    valid = torch.rand(2, 20, 24, 1, generator=generator) > 0.3
    for mask in (None, valid):
        found, expected = (
            torch.stack(o.l1_dssim(images[0], images[1], mask)) for o in (own, plain)
        )
        off = (found - expected).abs().max().item()
        require(
            off <= 1e-5, f"the error of l1_dssim is {off:.2g}.", "Compare with core/operators.py."
        )


def _adam_agrees(subject: Subject) -> None:
    results = []
    for operators in (_operators(subject), Operators()):
        generator = torch.Generator().manual_seed(0)
        values = torch.rand(10, 3, generator=generator)
        moments = AdamMoments.zeros_like(values)
        for step in range(6):
            gradient = torch.randn(10, 3, generator=generator)
            finite = torch.tensor(step != 3)
            broken = gradient if finite else gradient * torch.nan
            update = AdamUpdate(values, broken, moments, 0.01)
            operators.adam_([update], AdamSettings(), finite)
        results.append(values)
    off = (results[0] - results[1]).abs().max().item()
    require(
        off <= 1e-5,
        f"after six steps of Adam, one of which is not finite, the error of values is {off:.2g}.",
        "Compare with core/operators.py; a step that is not finite changes nothing.",
    )


PROMISES = (
    Promise("losses-agree", "L1 and DSSIM agree with torch.", _losses_agree),
    Promise("adam-agrees", "Steps of Adam agree with torch.", _adam_agrees),
)
