"""Feature 3DGS for gsfw (Zhou et al. 2024): a method, an exporter, and two verbs."""

from gsfw.api import Spec, hookimpl


@hookimpl
def gsfw_requires_api() -> str:
    return ">=1.0,<2"


@hookimpl
def gsfw_methods() -> list[Spec]:
    return [
        Spec(
            "feature-3dgs",
            "3D Gaussians with features that can be searched by words and points",
            "gsfw_feature_3dgs.method:FeatureConfig",
            paper="Zhou et al. 2024",
            tags=frozenset({"static"}),
        )
    ]


@hookimpl
def gsfw_exporters() -> list[Spec]:
    return [
        Spec("features", "positions, colours and features (npz)", "gsfw_feature_3dgs.export:Npz")
    ]


@hookimpl
def gsfw_commands() -> list[Spec]:
    return [
        Spec(
            "query", "find words or a point in a model of features", "gsfw_feature_3dgs.query:run"
        ),
        Spec("features", "write feature maps of images", "gsfw_feature_3dgs.maps:run"),
    ]
