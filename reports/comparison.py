"""Comparison: the report of several runs, with their views side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from gsfw.core.errors import ConfigError, DataError, UserError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.progress import stage
from gsfw.reports.comparison_page import comparison_page
from gsfw.reports.drawing import DrawingRule, draw_pictures
from gsfw.reports.error_image import ErrorImage
from gsfw.reports.pictures import Pictures, stored_pictures
from gsfw.reports.run_record import RunRecord, number
from gsfw.reports.run_report import Opened, not_opened

MOST_RUNS = 6
"""Most runs on one page, which has a bounded size."""

MOST_COMPARED = 6
"""Most views with images of every run."""


@dataclass(frozen=True)
class ComparedRun:
    """A run of a comparison."""

    record: RunRecord
    opened: Opened
    stored: Pictures | None = None
    """Images of an earlier report, for a run that cannot be opened."""
    notes: list[str] = field(default_factory=list)

    @property
    def views(self) -> set[str]:
        """Names of the views that it has, or can have, images of."""
        if self.opened.model is not None:
            return {str(view["name"]) for view in self.record.per_view}
        return set() if self.stored is None else {view.name for view in self.stored.views}

    @property
    def psnrs(self) -> dict[str, float | None]:
        """PSNR by view; ``None`` if it is not known."""
        return {str(view["name"]): number(view.get("psnr")) for view in self.record.per_view}


def check_count(count: int) -> None:
    """Refuse more runs than a page can hold.

    Raises:
        ConfigError: there are too many.
    """
    if count > MOST_RUNS:
        raise ConfigError(
            f"{count} runs: a report compares at most {MOST_RUNS}.", "Give fewer runs."
        )


def compared(record: RunRecord, opened: Opened) -> ComparedRun:
    """A run with the images that it has, if it cannot be opened."""
    stored, notes = None, []
    if opened.model is None:
        try:
            stored = stored_pictures(record.folder)
        except DataError as error:
            notes.append(error.message)
        source = "its images are those of an earlier report" if stored else "it has no images"
        if opened.why_not:
            notes.append(f"{source}: {opened.why_not}")
    return ComparedRun(record, opened, stored, notes)


def write_comparison(
    runs: Sequence[tuple[RunRecord, Opened]], rule: DrawingRule, out: Path
) -> Path:
    """Write the page of several runs.

    Raises:
        OutputError: it cannot be written.
    """
    found = [compared(record, opened) for record, opened in runs]
    names = labels([run.record for run in found])
    views = common_views(found, rule.views)
    # The films share the bytes of one; errors are not shown, and FLIP would take its time.
    shared = replace(rule, film_share=1 / len(found), error=ErrorImage(is_flip=False))
    pictures = [_pictures(run, shared, views) for run in found]
    notes = [
        f"{name}: {note}" for name, run in zip(names, found, strict=True) for note in run.notes
    ]
    with stage("writing the report"):
        records = [run.record for run in found]
        page = comparison_page(records, names, pictures, views, notes)
        write_atomically(out, page.encode())
    return out


def common_views(runs: Sequence[ComparedRun], most: int) -> list[str]:
    """Views that all runs have images of: those first whose PSNR differs most between the runs."""
    shared = set.intersection(*(run.views for run in runs))
    known = [run.psnrs for run in runs]

    def difference(name: str) -> float:
        values = [value for psnrs in known if (value := psnrs.get(name)) is not None]
        return max(values) - min(values) if values else 0.0

    return sorted(sorted(shared), key=difference, reverse=True)[:most]


def _pictures(run: ComparedRun, rule: DrawingRule, views: Sequence[str]) -> Pictures | None:
    """Images of a run that are drawn now, or else those of its own report."""
    if run.opened.model is None:
        return run.stored
    try:
        return draw_pictures(run.opened.model, [], rule, views)
    except UserError as error:  # Such as an image of the data that is no longer there.
        again = compared(run.record, not_opened(error))
        run.notes.extend(again.notes)
        return again.stored


def labels(records: Sequence[RunRecord]) -> list[str]:
    """Different names of runs, such as "fox/3dgs/first".

    Scene and method where these differ, then the end of the path that sets a run apart.
    """
    facts = ([record.scene for record in records], [record.method for record in records])
    differing = [values for values in facts if len(set(values)) > 1]
    names = []
    for place, end in enumerate(_ends(records)):
        about = [values[place] for values in differing]
        # Below the folder runs, the end of a path may have them already.
        names.append(end if set(about) <= set(end.split("/")) else "/".join([*about, end]))
    return names


def _ends(records: Sequence[RunRecord]) -> list[str]:
    """The shortest ends of the runs' paths that are all different."""
    parts = [record.path.resolve().parts for record in records]
    longest = max(len(path) for path in parts)
    for length in range(1, longest + 1):
        names = ["/".join(path[-length:]) for path in parts]
        if len(set(names)) == len(names):
            return names
    return [f"{place + 1}: {record.name}" for place, record in enumerate(records)]
