"""Words of other tools for settings and parts, and what they are called here, for suggestions.

``docs/from/`` compares defaults and meanings.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from types import MappingProxyType

EQUIVALENTS: Mapping[str, str] = MappingProxyType(
    {
        # Data and results.
        "source_path": "data",
        "data_dir": "data",
        "model_path": "out",
        "output_dir": "out",
        "result_dir": "out",
        "resolution": "downscale",
        "data_factor": "downscale",
        "downscale_factor": "downscale",
        "eval": "holdout_every",
        "test_every": "holdout_every",
        "train_split_fraction": "holdout_every",
        "save_iterations": "checkpoint_every",
        "steps_per_save": "checkpoint_every",
        "test_iterations": "eval_every",
        # Length and losses.
        "iterations": "steps",
        "num_iterations": "steps",
        "max_num_iterations": "steps",
        "max_steps": "steps",
        "lambda_dssim": "ssim_weight",
        "ssim_lambda": "ssim_weight",
        # Learning rates.
        "lr": "optim.means_lr",
        "learning_rate": "optim.means_lr",
        "position_lr_init": "optim.means_lr",
        "position_lr_final": "optim.means_lr_final",
        "scaling_lr": "optim.scales_lr",
        "rotation_lr": "optim.quats_lr",
        "opacity_lr": "optim.opacities_lr",
        "feature_lr": "optim.sh_dc_lr",
        "sh0_lr": "optim.sh_dc_lr",
        "shN_lr": "optim.sh_rest_lr",
        "visible_adam": "optim.sparse",
        # Density control.
        "densify_grad_threshold": "strategy.grow_gradient",
        "densify_grad_thresh": "strategy.grow_gradient",
        "grow_grad2d": "strategy.grow_gradient",
        "percent_dense": "strategy.split_size",
        "densify_size_thresh": "strategy.split_size",
        "grow_scale3d": "strategy.split_size",
        "cull_alpha_thresh": "strategy.prune_opacity",
        "prune_opa": "strategy.prune_opacity",
        "densify_from_iter": "strategy.refine_start",
        "refine_start_iter": "strategy.refine_start",
        "warmup_length": "strategy.refine_start",
        "densify_until_iter": "strategy.refine_stop",
        "refine_stop_iter": "strategy.refine_stop",
        "stop_split_at": "strategy.refine_stop",
        "densification_interval": "strategy.refine_every",
        "opacity_reset_interval": "strategy.reset_every",
        "reset_alpha_every": "strategy.reset_every",
        "max_gs_num": "strategy.cap_max",
        # Cameras and appearance.
        "white_background": "background",
        "background_color": "background",
        "random_bkgd": "random_background",
        "pose_opt": "refine_poses",
        "camera_optimizer": "refine_poses",
        "app_opt": "exposure",
        "use_bilateral_grid": "exposure",
        # Parts.
        "splatfacto": "3dgs",
        "splatfacto-big": "3dgs",
        "gaussian-splatting": "3dgs",
        "default": "adc",
    }
)
"""The name here for a setting (without its group) or a part of Inria's code, gsplat's trainer or
nerfstudio. A key of a group that the chosen part does not have is not suggested."""


def equivalent(given: str, known: list[str]) -> str:
    """The known name for a word of another tool, or one misspelt; empty if there is none.

    Args:
        given: a name, or a key whose groups do not count.
        known: what may be suggested.
    """
    word = given.rpartition(".")[2]
    ours = [name.rpartition(".")[2] for name in known]
    near = difflib.get_close_matches(word, [*EQUIVALENTS, *ours], 1, cutoff=0.8)
    found = EQUIVALENTS.get(near[0], "") if near else ""
    return found if found in known else ""
