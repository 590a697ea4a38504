"""Density strategies: which splats to add, move and remove."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookimpl


@hookimpl
def gsfw_strategies() -> list[Spec]:
    """The built-in strategies."""
    return [
        Spec(
            "adc",
            "clone, split and prune by screen gradient, size and opacity",
            "gsfw.strategies.adc:AdcConfig",
            paper="Kerbl et al. 2023",
        ),
        Spec(
            "error",
            "split where several views have errors, up to a number of rows per pixel",
            "gsfw.strategies.error_growth:ErrorGrowthConfig",
            paper="Ren et al. 2025",
        ),
        Spec(
            "mcmc",
            "relocate dead splats, add noise, grow to a fixed number",
            "gsfw.strategies.mcmc:McmcConfig",
            paper="Kheradmand et al. 2024",
        ),
        Spec("none", "keep the rows as they are", "gsfw.strategies.none:NoneConfig"),
    ]
