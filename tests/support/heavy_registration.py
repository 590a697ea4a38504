"""Hooks in a module that imports torch, which every verb would then import."""

import torch

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_metrics():
    return [Spec("heavy", str(torch.float32), "gsfw.core.metrics:Psnr")]
