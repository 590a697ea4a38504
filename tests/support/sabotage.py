"""A plugin whose strategy breaks a run in a way that can be chosen: the defects of a campaign."""

import os
import signal
import time
from dataclasses import dataclass

import torch

from gsfw.api import Refiner, Spec, StrategyConfig, hookimpl

BREAKS_AT = 3
"""The step, counted from 0, in which it does."""


@hookimpl
def gsfw_strategies():
    return [Spec("sabotage", "breaks a run", f"{__name__}:SabotageConfig")]


@dataclass
class SabotageConfig(StrategyConfig):
    """Breaks a run."""

    how: str = "error"
    """error, nan, hang, kill or exit."""

    def refiners(self, scene):
        return (Sabotage(self.how),)


class Sabotage(Refiner):
    name = "sabotage"

    def __init__(self, how: str) -> None:
        self.how = how

    def refine(self, context):
        if context.step == BREAKS_AT:
            getattr(self, self.how)(context.model)
        return {}

    def error(self, model):
        raise RuntimeError("nobody has foreseen this")

    def nan(self, model):
        with torch.no_grad():
            model.columns()["means"].values[0] = torch.nan

    def hang(self, model):
        time.sleep(3600)

    def kill(self, model):
        os.kill(os.getpid(), signal.SIGSEGV)

    def exit(self, model):
        os._exit(7)
