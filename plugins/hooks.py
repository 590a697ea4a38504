"""The hooks a plugin may implement; they return Spec records, and import nothing heavy."""

from __future__ import annotations

from gsfw.plugins.specs import Spec, hookspec


@hookspec
def gsfw_requires_api() -> str:  # type: ignore[empty-body]
    """Range of the versions of ``gsfw.api`` that the plugin was made for, such as ">=1.0,<2"."""


@hookspec
def gsfw_methods() -> list[Spec]:  # type: ignore[empty-body]
    """Methods; the target derives from ``gsfw.api.MethodConfig``."""


@hookspec
def gsfw_rasterizers() -> list[Spec]:  # type: ignore[empty-body]
    """Rasterizers; the target derives from ``gsfw.api.RasterizerConfig``."""


@hookspec
def gsfw_datamanagers() -> list[Spec]:  # type: ignore[empty-body]
    """Sources of data; the target derives from ``gsfw.api.DataManagerConfig``."""


@hookspec
def gsfw_strategies() -> list[Spec]:  # type: ignore[empty-body]
    """Density strategies; the target derives from ``gsfw.api.StrategyConfig``."""


@hookspec
def gsfw_samplers() -> list[Spec]:  # type: ignore[empty-body]
    """View samplers; the target derives from ``gsfw.api.SamplerConfig``."""


@hookspec
def gsfw_operators() -> list[Spec]:  # type: ignore[empty-body]
    """Sets of operators; the target derives from ``gsfw.api.Operators``."""


@hookspec
def gsfw_exporters() -> list[Spec]:  # type: ignore[empty-body]
    """Writers of splat files; the target derives from ``gsfw.api.Exporter``."""


@hookspec
def gsfw_importers() -> list[Spec]:  # type: ignore[empty-body]
    """Readers of splat files; the target derives from ``gsfw.api.Importer``."""


@hookspec
def gsfw_metrics() -> list[Spec]:  # type: ignore[empty-body]
    """Figures of the evaluation; the target derives from ``gsfw.api.Metric``."""


@hookspec
def gsfw_callbacks() -> list[Spec]:  # type: ignore[empty-body]
    """Watchers of a run; the target derives from ``gsfw.api.CallbackConfig``.

    A ``gsfw.api.Callback`` that is constructed without arguments is also accepted: it
    has no settings.
    """


@hookspec
def gsfw_commands() -> list[Spec]:  # type: ignore[empty-body]
    """Verbs of the command line; the target is a function ``(arguments: list[str]) -> int``."""
