import runpy
from pathlib import Path

import pytest
import torch

from gsfw.compat.explanation import explain

SCRIPT = Path("train.py")
COUNT = "not enough values to unpack (expected {}, got 2)"


def named(name: str, module: str) -> ImportError:
    return ImportError(f"cannot import name '{name}' from 'gsfw.compat.{module}' (a.py)")


def absent(name: str) -> ModuleNotFoundError:
    return ModuleNotFoundError(f"No module named '{name}'", name=name)


@pytest.mark.parametrize(
    ("error", "exit_code", "said"),
    [
        (absent("open3d"), 2, "put --without open3d before the script"),
        (absent("torch_scatter"), 2, "pip install torch-scatter --no-build-isolation"),
        (absent("diff_surfel_rasterization"), 2, "surfels that a ray intersects"),
        (absent("gsplat.losses"), 2, "does not support gsplat.losses. Install gsplat itself"),
        (named("export_splats", "gsplat"), 2, "gsplat.export_splats. Install gsplat itself"),
        (named("SparseGaussianAdam", "diff_gaussian_rasterization"), 2, "Leave it out, or run"),
        (absent("lpips.nets"), 1, "lpips has no module lpips.nets"),
        (ValueError(COUNT.format(3)), 1, "--third depth or --third invdepth"),
        (ValueError(COUNT.format(5)), 1, "its fork returns 5 results"),
    ],
)
def test_an_error_that_has_a_remedy_is_explained(error, exit_code, said):
    found = explain(SCRIPT, error)
    assert found is not None
    assert said in found.text
    assert found.exit_code == exit_code


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU to use")
def test_an_error_about_a_missing_gpu_names_the_option():
    found = explain(SCRIPT, AssertionError("CUDA device is required!"))
    assert found is not None
    assert "--claim-gpu" in found.text


def test_an_error_about_a_gpu_that_is_claimed_is_that_of_the_script():
    assert explain(SCRIPT, RuntimeError("the CUDA device is too old"), claimed=True) is None


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU to use")
def test_an_assertion_without_a_text_is_known_by_its_line(tmp_path):
    script = tmp_path / "train.py"
    script.write_text("import torch\n\nassert torch.cuda.is_available()\n")
    with pytest.raises(AssertionError) as caught:
        runpy.run_path(str(script))
    found = explain(script, caught.value)
    assert found is not None
    assert "--claim-gpu" in found.text


def test_other_errors_are_those_of_the_script():
    errors = ValueError("a"), RuntimeError("b"), AssertionError(), ImportError("c")
    errors += (ModuleNotFoundError("no backend of the script's own is there"),)
    assert [explain(SCRIPT, error) for error in errors] == [None] * 5
