"""Finished models that tests of tradeoff measure."""

from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.plugins.registry import installed
from gsfw.studies.tradeoff.finished_model import FinishedModel


def finished_model(path, views=16):
    """What RUN names, ready to be measured."""
    found = find_run(str(path), lambda text: None)
    restored = restore_run(found, installed())
    is_file = found.model_file is not None
    return FinishedModel(restored, installed(), str(path), views, is_file)
