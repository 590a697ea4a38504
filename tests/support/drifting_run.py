"""A finished run of the method whose splats drift, as a package would bring it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gsfw.commands.main import main
from gsfw.plugins.discovery import PluginSource
from gsfw.plugins.registry import installed
from support.moving_scene import DriftingPlugin


@contextmanager
def drifting_run(out: Path, *scene: str) -> Iterator[Path]:
    """Train into ``out``; the method is installed until the end of the context."""
    discovery = installed()._discovery
    discovery.add(DriftingPlugin(), PluginSource("drifting", "tests", "1.0"))
    assert main(["train", "method=drifting", *scene, f"out={out}"]) == 0
    yield out
    discovery.remove("drifting")
