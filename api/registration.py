"""Registration: the record of a part, the marker of hooks, the version. Light to import.

The module that a package names as its entry point in the group ``gsfw`` implements hooks, one for
each kind of part, which return ``Spec`` records::

    from gsfw.api import Spec, hookimpl

    @hookimpl
    def gsfw_requires_api() -> str:
        return ">=1.0,<2"

    @hookimpl
    def gsfw_methods() -> list[Spec]:
        return [Spec("mine", "what it does, in one line", "my_package.config:MyConfig")]

The hooks: ``gsfw_methods``, ``gsfw_strategies``, ``gsfw_rasterizers``, ``gsfw_datamanagers``,
``gsfw_samplers``, ``gsfw_callbacks``, ``gsfw_metrics``, ``gsfw_exporters``, ``gsfw_importers``,
``gsfw_operators``, ``gsfw_commands``. Every verb imports this module: keep torch out of it.
"""

from gsfw.plugins.specs import Spec, hookimpl
from gsfw.plugins.versions import API_VERSION

__all__ = ["API_VERSION", "Spec", "hookimpl"]
