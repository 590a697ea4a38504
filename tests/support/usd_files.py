"""Files of USD as other tools write them, by usd-core alone."""

from pxr import Gf, Usd, UsdGeom, UsdVol, Vt

from gsfw.core.maths.rotations import rotation_matrices


def shapes(splats):
    axes = rotation_matrices(splats.quats) * splats.scales[:, None]
    return axes @ axes.mT


def written(path, count=4, edit=lambda stage, field: None):
    """A stage of another tool."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.Xform.Define(stage, "/World")
    field = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/World/Splats")
    field.CreatePositionsAttr(Vt.Vec3fArray([Gf.Vec3f(index, 2, 3) for index in range(count)]))
    edit(stage, field)
    stage.Save()
    return path
