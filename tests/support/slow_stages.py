"""Slow stages: lines of progress, which commands write to standard error on a busy machine."""

import re

LINE = re.compile(r"^.*: (.* so far|\d+ of \d+(, about .* left)?)\n", re.MULTILINE)


def without_slow_stages(stderr: str) -> str:
    """Standard error of a command, without lines of progress."""
    return LINE.sub("", stderr)
