"""Which gsplat is installed, and what is said where it cannot draw."""

import logging
import sys
from types import SimpleNamespace

import pytest
import torch

from gsfw.core.errors import UnavailableError
from gsfw.core.numerics import DEFAULT, GSPLAT_1_5
from gsfw.rasterizers.gsplat import package


@pytest.fixture
def gpu(monkeypatch) -> None:
    """A machine with a GPU, as far as torch says."""
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)


def test_torch_without_cuda_is_said_first(monkeypatch):
    monkeypatch.setattr(torch.version, "cuda", None)
    assert package.unavailable() == (
        "this torch is built without CUDA, which gsplat needs; see pytorch.org for another"
    )


def test_a_machine_without_gpu_is_said(monkeypatch, gpu):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert package.unavailable() == (
        "torch sees no GPU here, and gsplat renders on nothing else; use a machine with one"
    )


def test_where_it_is_not_installed_it_says_how_to_install_it(monkeypatch, gpu):
    def missing(name):
        raise package.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(package.metadata, "version", missing)
    assert package.version() == ""
    assert package.unavailable() == "gsplat is not installed; pip install 'gsfw[gsplat]'"


@pytest.mark.parametrize("installed", ["1.4.0", "1.5.2+pt24cu124", "0.1.13", "1"])
def test_an_older_version_is_refused(monkeypatch, gpu, installed):
    monkeypatch.setattr(package, "version", lambda: installed)
    assert package.unavailable() == (
        f"gsplat {installed} is older than 1.5.3; pip install --upgrade 'gsfw[gsplat]'"
    )


@pytest.mark.parametrize("installed", ["1.5.3", "1.5.3+pt24cu124", "1.6.0", "1.10", "2.0.0rc1"])
def test_later_versions_will_do(monkeypatch, gpu, installed):
    monkeypatch.setattr(package, "version", lambda: installed)
    assert package.unavailable() == ""


@pytest.mark.parametrize(
    ("installed", "expected"),
    [("1.5.3", GSPLAT_1_5), ("1.5.3+pt24cu124", GSPLAT_1_5), ("1.6.0", DEFAULT), ("2.0", DEFAULT)],
)
def test_each_version_draws_with_its_own_constants(installed, expected):
    assert package.profile(installed) is expected


def test_loading_says_beforehand_that_it_may_take_minutes(fake, caplog):
    with caplog.at_level(logging.INFO, logger="gsfw"):
        assert package.load() is fake
    assert caplog.messages == [
        "loading gsplat 1.5.3; unless its wheel has them, it compiles its kernels first, which "
        "takes minutes"
    ]


def test_kernels_that_cannot_be_compiled_are_one_message(fake, monkeypatch):
    class Broken:
        @property
        def _C(self):
            raise RuntimeError("Error building extension 'gsplat_cuda'\n[1/30] nvcc ...")

    monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", Broken())
    with pytest.raises(UnavailableError) as caught:
        package.load()
    assert str(caught.value) == (
        "gsplat 1.5.3 cannot be loaded: RuntimeError: Error building extension 'gsplat_cuda'\n"
        "Install a wheel for this torch and CUDA (docs.gsplat.studio/whl), or render with "
        "rasterizer=auto."
    )


def test_neither_kernels_nor_a_compiler_is_one_message(fake, monkeypatch):
    monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", SimpleNamespace(_C=None))
    with pytest.raises(UnavailableError) as caught:
        package.load()
    assert str(caught.value) == (
        "gsplat 1.5.3 came without compiled kernels, and found no CUDA toolkit (nvcc) to compile "
        "them with.\n"
        "Install a wheel for this torch and CUDA (docs.gsplat.studio/whl) or the toolkit, or "
        "render with rasterizer=auto."
    )
