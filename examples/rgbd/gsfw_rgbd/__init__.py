"""RGB-D sequences for gsfw: a format of data, a method with a depth loss, and a small room."""

from gsfw.api import Spec, hookimpl


@hookimpl
def gsfw_requires_api() -> str:
    return ">=1.0,<2"


@hookimpl
def gsfw_datamanagers() -> list[Spec]:
    return [
        Spec("tum-rgbd", "rgb.txt, depth.txt, groundtruth.txt (TUM)", "gsfw_rgbd.data:TumConfig")
    ]


@hookimpl
def gsfw_methods() -> list[Spec]:
    return [
        Spec(
            "3dgs-depth",
            "3D Gaussians held to measured depths",
            "gsfw_rgbd.method:DepthConfig",
            paper="after Turkulainen et al. 2024",
            tags=frozenset({"static"}),
        )
    ]


@hookimpl
def gsfw_commands() -> list[Spec]:
    return [Spec("make-room", "write a small synthetic RGB-D sequence", "gsfw_rgbd.verb:run")]
