"""Which installed packages give way, in this process: their modules are put back afterwards."""

import sys

import pytest

from gsfw.compat.replacement import MODULES, replace_modules


def _of_packages():
    return {name: part for name, part in sys.modules.items() if name.split(".")[0] in MODULES}


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder of packages, before those that are installed."""
    before = _of_packages()
    for name in before:
        del sys.modules[name]
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for name in _of_packages():
        del sys.modules[name]
    sys.modules.update(before)


def write_gsplat(site):
    (site / "gsplat").mkdir()
    (site / "gsplat" / "__init__.py").write_text(
        "from gsplat.rendering import rasterization\nSTRATEGY = 'the original'\n"
    )
    (site / "gsplat" / "rendering.py").write_text("def rasterization(): ...\n")
    (site / "gsplat" / "relocation.py").write_text("def compute_relocation(): ...\n")


def test_a_package_that_works_on_the_gpu_is_kept_there(site):
    write_gsplat(site)
    assert "gsplat" in replace_modules(always=False, gpu=True).kept


@pytest.mark.parametrize(("always", "gpu"), [(False, False), (True, True)])
def test_without_a_gpu_an_installed_gsplat_renders_here_and_keeps_the_rest(site, always, gpu):
    write_gsplat(site)
    assert replace_modules(always, gpu).kept == ()
    import gsplat

    assert gsplat.rasterization.__module__ == "gsfw.compat.gsplat"
    assert sys.modules["gsplat.rendering"].rasterization is gsplat.rasterization
    assert gsplat.STRATEGY == "the original"
    relocation = sys.modules["gsplat.relocation"].compute_relocation
    assert relocation.__module__ == "gsfw.compat.gsplat_relocation"


def test_a_gsplat_without_relocation_is_kept_on_the_gpu_and_renders_here_without_one(site):
    write_gsplat(site)
    (site / "gsplat" / "relocation.py").unlink()
    assert "gsplat" in replace_modules(always=False, gpu=True).kept
    assert replace_modules(always=False, gpu=False).kept == ()
    import gsplat

    assert gsplat.STRATEGY == "the original"
    assert gsplat.rasterization.__module__ == "gsfw.compat.gsplat"


def test_a_package_that_the_strategies_of_gsplat_lack_is_named(site):
    write_gsplat(site)
    (site / "gsplat" / "strategy").mkdir()
    (site / "gsplat" / "strategy" / "ops.py").write_text("import a_package_of_its_own\n")
    with pytest.raises(ModuleNotFoundError, match="a_package_of_its_own"):
        replace_modules(always=False, gpu=False)


def test_simple_knn_is_found_by_its_extension_as_it_is_a_folder_without_init(site):
    (site / "simple_knn").mkdir()
    (site / "simple_knn" / "_C.py").write_text("distCUDA2 = 'the original'\n")
    assert "simple_knn" in replace_modules(always=False, gpu=True).kept


def test_a_folder_of_sources_does_not_pass_for_a_package(site):
    for name in ("simple_knn", "diff_gaussian_rasterization"):
        (site / name).mkdir()
    done = replace_modules(always=False, gpu=True)
    assert {"simple_knn", "diff_gaussian_rasterization"} <= set(done.replaced)
    from simple_knn._C import distCUDA2

    assert callable(distCUDA2)
