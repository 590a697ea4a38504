"""JSON has no NaN."""

import json

from gsfw.core.files.json_text import json_text


def test_what_is_not_a_number_is_null_at_any_depth():
    document = {"psnr": float("nan"), "views": [{"ssim": float("-inf")}, 1.5], "name": "x"}
    assert json.loads(json_text(document)) == {
        "psnr": None,
        "views": [{"ssim": None}, 1.5],
        "name": "x",
    }
