"""Settings of the written data set."""

import pytest

from gsfw.core.errors import ConfigError
from gsfw.preparation.writing.image_output import OutputRule


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"lens": "fisheye"}, "lens=fisheye: expected one of pinhole, keep."),
        ({"jpeg_quality": 0}, "jpeg_quality=0: expected a number from 1 to 100."),
    ],
)
def test_settings_out_of_range_are_refused(settings, message):
    with pytest.raises(ConfigError) as error:
        OutputRule(**settings).check()
    assert str(error.value) == message
