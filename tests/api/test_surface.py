"""The public interface changes on purpose only: tests/api/surface.txt has all of it."""

import ast
import re
from collections import Counter

import pytest
from support import public_surface
from support.public_surface import SURFACE, Place

HOW = """
gsfw.api is not as tests/api/surface.txt has it. If that is meant:
1. Raise API_VERSION in plugins/versions.py: the second number for additions, the first if a plugin
   may have to change. 2. Let a renamed name stay (api/deprecation.py).
3. python tests/support/public_surface.py"""

RECEIVED = {
    **dict.fromkeys(("BandsConfig", "HashConfig", "HexPlaneConfig", "MlpConfig"), "settings"),
    **dict.fromkeys(("DeformationOptim", "SlicedGaussiansOptim", "SpacetimeOptim"), "settings"),
    **dict.fromkeys(
        ("DeformedGaussians", "SlicedGaussians", "SpacetimeGaussians"), "made by their methods"
    ),
    "CallbackConfigs": "made by gsfw, with a field for every callback",
    "DeformationOptim": "settings of a method for moving scenes, in a field of its config",
    "DeformedGaussians": "made by a method for moving scenes",
    "GaussianParameters": "made by build_model of 3dgs",
    "GaussiansConfig": "base class of StaticGaussiansConfig",
    "HashConfig": "settings of a method for moving scenes, in a field of its config",
    "HexPlaneConfig": "settings of a method for moving scenes, in a field of its config",
    "Layer": "passed on by RunOptions",
    "LensRule": "made by CaptureConfig",
    "MapFolder": "made by CaptureConfig",
    "MapHeader": "made by MapFile",
    "MaskRule": "made by CaptureConfig",
    "MlpConfig": "settings of a method for moving scenes, in a field of its config",
    "OptimizerSettings": "made by OptimConfig",
    "Requirements": "received by callbacks",
    "Restored": "a run that gsfw has opened",
    "Sightings": "read by gsfw prepare",
    "SlicedGaussians": "made by a method for moving scenes",
    "RunArgument": "made by gsfw.load and Run.model",
    "SlicedGaussiansOptim": "settings of a method for moving scenes, in a field of its config",
    "SpacetimeGaussians": "made by a method for moving scenes",
    "SpacetimeOptim": "settings of a method for moving scenes, in a field of its config",
    "Undistortion": "made by Frame",
    "VideoTraits": "made by Video.read",
}
"""Classes in public signatures that no plugin has to make or to name, and why."""


def test_names_and_signatures_are_those_of_the_file():
    assert public_surface.described() == SURFACE.read_text(encoding="utf-8"), HOW


def test_every_public_name_is_in_one_group_and_can_be_imported():
    from gsfw import api

    groups = public_surface.groups()
    assert set(groups) == set(api.GROUPS)
    counted = Counter(name for names in groups.values() for name in names)
    assert [name for name, count in counted.items() if count > 1] == []
    assert dir(api) == sorted(counted)
    assert all(getattr(api, name) is not None for name in counted)
    with pytest.raises(AttributeError, match="has no attribute 'Nothing'"):
        _ = api.Nothing


def test_every_public_name_is_documented():
    from gsfw import api

    values = {name: getattr(api, name) for name in dir(api)}
    bare = [name for name, value in values.items() if callable(value) and not value.__doc__]
    assert bare == []


def test_every_public_name_is_on_a_page_or_in_an_example():
    root = SURFACE.parents[2]
    pages = [root / "README.md", *(root / "docs").rglob("*.md"), *(root / "docs").rglob("*.py")]
    pages += (root / "examples").rglob("*.py")
    words = {word for page in pages for word in re.findall(r"\w+", page.read_text("utf-8"))}
    assert public_surface.public_names() - words == set()


def test_every_class_in_a_public_signature_is_public_or_only_received():
    public = public_surface.public_names()
    named = {
        item
        for group, names in public_surface.groups().items()
        for name in names
        for item in public_surface.named_types(group, name)
    }
    assert named - public - set(RECEIVED) == set()
    assert public.isdisjoint(RECEIVED)


BEFORE = """
@dataclass
class Thing(Base):
    size: int = 1
    def grow(self, by: int) -> None: ...
    def _inner(self): ...
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("by: int", "by: float"),
        ("by: int", "by: int, times: int"),
        ("by: int", "by: int = 0"),
        ("-> None", "-> int"),
        ("def grow", "def shrink"),
        ("size: int = 1", "size: int"),
        ("size", "width"),
        ("@dataclass", "@dataclass(frozen=True)"),
        ("(Base)", "(Other)"),
        ("    def grow", "    @classmethod\n    def grow"),
    ],
)
def test_a_changed_signature_is_another_description(old, new, monkeypatch, tmp_path):
    def description(source: str) -> list[str]:
        (node,) = ast.parse(source).body
        path = tmp_path / "thing.py"
        path.write_text("")
        monkeypatch.setattr(public_surface, "definition", lambda *_: Place(path, node))
        return [text for _, text in public_surface.lines("group", "Thing")]

    assert description(BEFORE.replace(old, new)) != description(BEFORE)
    inner = description(BEFORE.replace("_inner(self)", "_inner(self, more)"))
    other_default = description(BEFORE.replace("= 1", "= 2"))
    assert inner == other_default == description(BEFORE)
