"""Control groups: the folders in which Linux limits the resources of this process (cgroups(7))."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

MOUNTED = Path("/sys/fs/cgroup")
"""Mount point of control groups, which limit containers, jobs and services."""
MEMBERSHIP = Path("/proc/self/cgroup")
"""The control groups of this process: lines ``ID:CONTROLLERS:PATH``; version 2 names none."""


@dataclass(frozen=True)
class ControlGroup:
    """A control group of this process."""

    folder: Path
    """Folder with its files; may be missing."""
    version: int
    """1 or 2: their files have other names."""

    def words(self, file: str) -> list[str]:
        """The words of one of its files; none where there is no such file."""
        try:
            return (self.folder / file).read_text().split()
        except OSError:
            return []

    def number(self, file: str) -> int | None:
        """The number in one of its files; ``None`` for "max" or where there is no such file."""
        words = self.words(file)
        return int(words[0]) if words and words[0].isdecimal() else None


def control_groups(controller: str) -> Iterator[ControlGroup]:
    """The groups of this process and their parents, whose limits hold as well.

    Args:
        controller: the resource: "cpu" or "memory".
    """
    try:
        lines = MEMBERSHIP.read_text().splitlines()
    except OSError:  # Not Linux.
        return
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers and controller not in controllers.split(","):
            continue
        mounted = MOUNTED / controller if controllers else MOUNTED
        group = PurePosixPath(path.lstrip("/"))
        # A container may see its own group as the root.
        for place in (group, *group.parents):
            yield ControlGroup(mounted / place, 1 if controllers else 2)
