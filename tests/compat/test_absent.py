"""Packages that a script only imports: --without PACKAGE."""

import copy
import sys
from typing import get_type_hints

import pytest

from gsfw.api import ConfigError
from gsfw.compat.absent import leave_out


@pytest.fixture
def without_lpipsy():
    """The package lpipsy is left out."""
    before = list(sys.meta_path)
    leave_out(["lpipsy"])
    yield
    sys.meta_path[:] = before
    for name in [name for name in sys.modules if name.partition(".")[0] == "lpipsy"]:
        del sys.modules[name]


@pytest.mark.usefixtures("without_lpipsy")
def test_everything_in_the_package_can_be_imported():
    import lpipsy.models.vgg
    from lpipsy import LPIPS

    assert lpipsy.models.vgg.__name__ == "lpipsy.models.vgg"
    assert lpipsy.models.vgg.layers.first is not LPIPS


@pytest.mark.usefixtures("without_lpipsy")
def test_a_call_and_a_derived_class_are_errors_with_the_name_and_the_remedy():
    import lpipsy

    with pytest.raises(ConfigError, match=r"calls lpipsy.LPIPS, which --without.*\n.*Install"):
        lpipsy.LPIPS(net="vgg")
    with pytest.raises(ConfigError, match=r"derives a class from lpipsy\.nets\.Base"):

        class Mine(lpipsy.nets.Base):
            """A class of the script."""


@pytest.mark.usefixtures("without_lpipsy")
def test_its_names_can_be_annotations_and_copied_and_nothing_is_of_their_classes():
    from lpipsy import Net

    def measure(net: Net | None, layers: int | Net = 0) -> Net[int]: ...

    assert get_type_hints(measure, {"Net": Net})["net"] is Net
    assert not isinstance(measure, (int, Net))
    assert not issubclass(int, Net)
    assert isinstance(copy.deepcopy(Net), type(Net))
    with pytest.raises(ConfigError, match=r"calls lpipsy\.Net, which"):
        copy.copy(Net)()


@pytest.mark.usefixtures("without_lpipsy")
def test_a_loop_over_a_name_is_an_error_and_not_endless():
    from lpipsy import LAYERS

    with pytest.raises(ConfigError, match=r"iterates over lpipsy\.LAYERS, which"):
        list(LAYERS)


def test_a_package_that_gsfw_uses_cannot_be_left_out():
    with pytest.raises(ConfigError, match="--without torch: gsfw itself has imported it"):
        leave_out(["torch"])
