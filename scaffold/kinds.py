"""Kinds: the kinds of parts that ``gsfw new`` can begin, and the texts of their packages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Kind:
    """A kind of part; its name is that of its slot. Texts name the part "my-part"."""

    title: str
    """Name in sentences: "data manager"."""
    summary: str
    """Description of the generated part, for lists of parts and for the package."""
    target: str
    """Class or function that is registered, as "module:Name" in the package."""
    command: str
    """Command that uses the part."""
    hint: str
    """The first thing to change, as a sentence."""

    @property
    def module(self) -> str:
        """Module of the implementation in the package."""
        return self.target.partition(":")[0]


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "method": Kind(
            "method",
            "isotropic Gaussians of one colour, with a model, losses and rates of its own",
            "method:MyPartConfig",
            "gsfw train method=my-part",
            "Start with `MyPart.losses` (what is minimised) and `MyPartModel.columns` (what is "
            "trained); every field of `MyPartConfig` is a key of the command line.",
        ),
        "strategy": Kind(
            "strategy",
            "clones rows with large screen gradients, and prunes transparent ones",
            "strategy:MyPartConfig",
            "gsfw train method=3dgs strategy=my-part",
            "Start with `MyPart.refine`: only `context.table` adds, removes or replaces rows.",
        ),
        "rasterizer": Kind(
            "rasterizer",
            "renders in plain torch, row by row",
            "rasterizer:MyPartConfig",
            "gsfw train method=3dgs rasterizer=my-part downscale=8 steps=100",
            "Start with `_view`. Add to `FEATURES` what it can do; gsfw asks for no more.",
        ),
        "datamanager": Kind(
            "data manager",
            "reads a folder of images with their cameras in poses.json",
            "datamanager:MyPartConfig",
            "gsfw train method=3dgs data=DIR     # a folder with poses.json is recognised",
            "Start with `MyPartConfig.recording`: undistortion, masks, shrinking, caching and "
            "held-out views are done for every `Recording`.",
        ),
        "sampler": Kind(
            "sampler",
            "some views at random, the others in proportion to their latest loss",
            "sampler:MyPartConfig",
            "gsfw train method=3dgs sampler=my-part",
            "Start with `MyPart._view_at`.",
        ),
        "metric": Kind(
            "metric",
            "the mean absolute difference of colours, over the valid pixels",
            "metric:MyPart",
            "gsfw train method=3dgs     # every evaluation has the metric",
            "Start with `MyPart.__call__`; count only the pixels that are valid.",
        ),
        "callback": Kind(
            "callback",
            "writes the losses of a run into losses.csv",
            "callback:MyPartConfig",
            "gsfw train method=3dgs     # callbacks.my_part.enabled=false switches it off",
            "Start with `MyPart.on_step`; `gsfw.api.Callback` has the other moments of a run.",
        ),
        "exporter": Kind(
            "exporter",
            "writes splats as text, a line each",
            "exporter:MyPartExporter",
            "gsfw export latest format=my-part",
            "Start with `_table`, the content of a file, and `MyPartExporter.suffix`.",
        ),
        "importer": Kind(
            "importer",
            "reads splats from text, a line each",
            "importer:MyPartImporter",
            "gsfw info splats.csv",
            "Start with `recognises`, which sees the first bytes of any file, and `read`.",
        ),
        "command": Kind(
            "verb",
            "prints the columns of a trained model, and the spread of their values",
            "command:run",
            "gsfw my-part latest",
            "Start with `MyPartOptions`: its fields are the options of the verb.",
        ),
    }
)
"""Every kind of part that can be begun, by the name of its slot."""


LIKE = Kind(
    "method",
    "BASE with one more trained column, a brightness, and its loss",
    "method:MyPartConfig",
    "gsfw train method=my-part",
    "Start with `MyPart.losses` and `extra_columns`; every field of `MyPartConfig` is a key of the "
    "command line.",
)
"""The kind of a method that derives from another one."""

MOTION = Kind(
    "method",
    "Gaussians that move along waves, and turn by polynomials of the time",
    "method:MyPartConfig",
    "gsfw train method=my-part",
    "Start with `MyPartGaussians`: `temporal_column` makes what is trained, and `splats` moves the "
    "Gaussians; every field of `MyPartConfig` is a key of the command line.",
)
"""The kind of a method with a motion of its own."""


@dataclass(frozen=True)
class Base:
    """A method that a new one can derive from; its classes are public."""

    config: str
    method: str
    template: str = "like_moving"
    """Name of the template."""
    tests: str = "like"
    """Name of the template of its tests."""
    kind: Kind = LIKE
    """Texts of the package."""
    tag: str = "dynamic"
    """Tag of its registration: "static" or "dynamic"."""


BASES: Mapping[str, Base] = MappingProxyType(
    {
        "3dgs": Base("StaticGaussiansConfig", "StaticGaussiansMethod", "like", tag="static"),
        "moving": Base("MovingConfig", "MovingMethod", "moving", "moving", MOTION),
        "4dgs": Base("DeformationConfig", "DeformationMethod"),
        "4d-rotor": Base("SlicedGaussiansConfig", "SlicedGaussiansMethod"),
        "spacetime": Base("SpacetimeConfig", "SpacetimeMethod"),
    }
)
"""Methods for ``like=NAME``; "moving" is what all methods for moving scenes have in common."""
