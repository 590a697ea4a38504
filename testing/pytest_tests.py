"""Tests of pytest, one for each promise of a part; pytest is imported when one is made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType

from gsfw.testing.checks import promises
from gsfw.testing.promise import Promise, Verdict
from gsfw.testing.subject import Subject, find_subject, parts_of


def conformance(
    slot: str,
    name: str,
    *,
    plugin: ModuleType | object | str | None = None,
    data: Path | str | None = None,
    settings: Sequence[str] = (),
) -> Callable[[Subject, Promise], None]:
    """A test function with one case for each promise of a part, to be named ``test_...``.

    Args:
        slot: kind of the part, as for ``check``; "plugin" for all parts of a plugin.
        name: registered name; for "plugin" a distribution or a module with hooks.
        plugin: as for ``check``.
        data: as for ``check``.
        settings: as for ``check``.

    Raises:
        ConfigError: there is no such part.
    """
    import pytest

    chosen = tuple(settings)
    if slot == "plugin":
        subjects = parts_of(name, plugin=plugin, data=data, settings=chosen)
    else:
        subjects = [find_subject(slot, name, plugin=plugin, data=data, settings=chosen)]
    cases = [
        pytest.param(subject, promise, id=f"{subject.slot}-{subject.name}-{promise.name}")
        for subject in subjects
        for promise in promises(subject.slot)
    ]

    @pytest.mark.parametrize(("subject", "promise"), cases)
    def test_conforms(subject: Subject, promise: Promise) -> None:
        outcome = promise.check(subject)
        if outcome.verdict is Verdict.NOT_APPLICABLE:
            pytest.skip(outcome.happened)
        if outcome.verdict is Verdict.BROKEN:
            raise AssertionError(str(outcome)) from outcome.error

    return test_conforms
