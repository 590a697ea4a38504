"""The hooks a plugin may implement; each returns Spec records and imports nothing heavy."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookspec


@hookspec
def gsfw_methods() -> list[Spec]:  # type: ignore[empty-body]
    """Methods; the target derives from ``gsfw.core.config.MethodConfig``."""


@hookspec
def gsfw_rasterizers() -> list[Spec]:  # type: ignore[empty-body]
    """Rasterizers; the target derives from ``gsfw.core.config.RasterizerConfig``."""


@hookspec
def gsfw_datamanagers() -> list[Spec]:  # type: ignore[empty-body]
    """Sources of data; the target derives from ``gsfw.core.config.DataManagerConfig``."""


@hookspec
def gsfw_strategies() -> list[Spec]:  # type: ignore[empty-body]
    """Density strategies; the target derives from ``gsfw.core.config.StrategyConfig``."""


@hookspec
def gsfw_samplers() -> list[Spec]:  # type: ignore[empty-body]
    """View samplers; the target derives from ``gsfw.core.config.SamplerConfig``."""


@hookspec
def gsfw_operators() -> list[Spec]:  # type: ignore[empty-body]
    """Sets of operators; the target derives from ``gsfw.core.operators.Operators``."""


@hookspec
def gsfw_exporters() -> list[Spec]:  # type: ignore[empty-body]
    """Writers of splat files; the target derives from ``gsfw.core.exchange.Exporter``."""


@hookspec
def gsfw_importers() -> list[Spec]:  # type: ignore[empty-body]
    """Readers of splat files; the target derives from ``gsfw.core.exchange.Importer``."""


@hookspec
def gsfw_metrics() -> list[Spec]:  # type: ignore[empty-body]
    """Figures of the evaluation; the target derives from ``gsfw.core.metrics.Metric``."""


@hookspec
def gsfw_callbacks() -> list[Spec]:  # type: ignore[empty-body]
    """Watchers of a run; the target derives from ``gsfw.core.config.CallbackConfig``.

    A ``gsfw.core.callback.Callback`` that is constructed without arguments is also accepted: it
    has no settings.
    """


@hookspec
def gsfw_commands() -> list[Spec]:  # type: ignore[empty-body]
    """Verbs of the command line; the target is a function ``(arguments: list[str]) -> int``."""
