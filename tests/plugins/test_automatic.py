"""Tests of gsfw.plugins.automatic."""

import errno
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import torch
from support.fake_parts import Base, FakePlugin, Source, fake_registry, registry_of

from gsfw.core.capabilities import Capabilities, Feature
from gsfw.core.errors import ConfigError, DataError
from gsfw.plugins.automatic import choose_datamanager, rasterizer_capabilities
from gsfw.plugins.devices import unused_gpu
from gsfw.plugins.loading import load_all
from gsfw.plugins.settings import COMMAND_LINE, Layer, Settings, resolve
from gsfw.plugins.specs import Spec, hookimpl


def settings(registry=None, **typed: str) -> Settings:
    line = Layer(COMMAND_LINE, {"method": "demo", **typed})
    return resolve(registry or fake_registry(), [line])


def data_refusal(path) -> str:
    with pytest.raises(DataError) as caught:
        choose_datamanager(str(path), fake_registry())
    return str(caught.value)


def test_without_data_the_built_in_scene_is_taken():
    found = settings()
    assert found.choices["datamanager"].name == "synthetic"
    assert found.sources["datamanager"] == "chosen automatically: no data= is given"


def test_the_format_is_recognised_and_the_reason_given(tmp_path):
    (tmp_path / "apples.txt").touch()
    found = settings(data=str(tmp_path))
    assert found.choices["datamanager"].name == "apples"
    assert found.sources["datamanager"] == "chosen automatically: found apples.txt"


def test_of_several_formats_the_one_with_priority_wins_and_brings_its_recommendations(tmp_path):
    (tmp_path / "apples.txt").touch()
    (tmp_path / "pears.txt").touch()
    found = settings(data=str(tmp_path))
    assert found.sources["datamanager"] == (
        "chosen automatically: found pears.txt (preferred to apples)"
    )
    assert (found.config.background, found.config.steps) == ("white", 3000)
    assert found.sources["steps"] == "recommended by datamanager pears"
    assert found.sources["strategy.until"] == "method default x 0.1 (steps=3000)"


def test_a_files_data_manager_is_for_the_files_data(tmp_path):
    (tmp_path / "pears.txt").touch()
    typed = Layer(COMMAND_LINE, {"method": "demo", "data": str(tmp_path)})

    def chosen(**values: str) -> str:
        layers = [Layer("config file a.yaml", values), typed]
        return resolve(fake_registry(), layers).choices["datamanager"].name

    assert chosen(data="elsewhere", datamanager="apples") == "pears"
    assert chosen(datamanager="apples") == "apples", "chosen for whatever data there will be"


def test_a_missing_folder_suggests_its_sibling(tmp_path):
    (tmp_path / "garden").mkdir()
    assert data_refusal(tmp_path / "gardne") == (
        f"data={tmp_path / 'gardne'}: there is no such file or folder.\n"
        f"{tmp_path} contains no 'gardne'. Did you mean 'garden'?"
    )


def test_a_link_to_what_is_not_there_is_no_suggestion(tmp_path):
    (tmp_path / "garden").symlink_to(tmp_path / "unplugged" / "garden")
    assert data_refusal(tmp_path / "garden") == (
        f"data={tmp_path / 'garden'}: there is no such file or folder.\n"
        f"{tmp_path / 'garden'} is a link to {tmp_path / 'unplugged' / 'garden'}, which cannot be "
        "reached. Correct the link, or connect the disk of its target."
    )


def test_a_missing_parent_is_named(tmp_path):
    (tmp_path / "captures").mkdir()
    said = data_refusal(tmp_path / "capture" / "fox")
    assert said.endswith(f"{tmp_path} contains no 'capture'. Did you mean 'captures'?")


def test_a_file_in_the_place_of_a_folder_is_named(tmp_path):
    (tmp_path / "fox").write_text("a file")
    assert data_refusal(tmp_path / "fox" / "transforms.json") == (
        f"data={tmp_path / 'fox' / 'transforms.json'}: there is no such file or folder.\n"
        f"{tmp_path / 'fox'} is a file, not a folder."
    )


def test_an_empty_folder_has_its_own_message(tmp_path):
    assert data_refusal(tmp_path) == (
        f"data={tmp_path}: the folder is empty.\n"
        "Give the folder that holds the images and their cameras."
    )


def test_nothing_recognised_lists_what_was_looked_for_and_what_is_there(tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "notes.txt").touch()
    assert data_refusal(tmp_path) == (
        f"data={tmp_path}: this is not a data set that can be read here. Looked for:\n"
        "  apples: apples.txt\n"
        "  pears: pears.txt\n"
        "The folder holds: images/, notes.txt.\n"
        "If it is one of these formats, name it: datamanager=NAME says what is wrong with it."
    )


def test_a_preparation_that_is_not_finished_or_has_no_cameras_is_named(tmp_path):
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "stages.json").touch()
    assert data_refusal(tmp_path) == (
        f"data={tmp_path}: gsfw prepare has not finished this data set.\n"
        f"Repeat its command, which continues: gsfw prepare INPUT out={tmp_path}"
    )
    (tmp_path / "prepare.json").touch()
    (tmp_path / "hint").touch()
    assert data_refusal(tmp_path) == (
        f"data={tmp_path}: this result of gsfw prepare has no images with cameras.\n"
        f"If files were moved or deleted, repeat gsfw prepare. Else {tmp_path / 'prepare.json'} "
        "has the reason for each image: take more photos, and give all of them to gsfw prepare."
    )


def test_what_a_format_found_instead_is_said_first_and_once(tmp_path):
    (tmp_path / "hint").touch()
    assert data_refusal(tmp_path) == (
        f"data={tmp_path}: this is not a data set that can be read here. Found a hint.\n"
        "Formats that have cameras: apples, pears. If it is one of them, name it: "
        "datamanager=NAME says what is wrong with it."
    )


def test_the_rasterizer_is_the_preferred_one_that_meets_every_need():
    assert settings().choices["rasterizer"].name == "fast"
    found = settings(antialias="true")
    assert found.choices["rasterizer"].name == "slow"
    assert found.sources["rasterizer"] == "chosen automatically: the fastest that fits on cpu"


def test_settings_of_an_automatic_rasterizer_are_applied_to_it():
    assert settings(antialias="true", **{"rasterizer.tile": "8"}).flat()["rasterizer.tile"] == 8
    with pytest.raises(ConfigError, match=r"It belongs to rasterizer slow, but rasterizer=fast\."):
        settings(**{"rasterizer.tile": "8"})


class Graphic(FakePlugin):
    """Also has a rasterizer for GPUs; ``unavailable`` says why it cannot run."""

    unavailable = ""

    @hookimpl
    def gsfw_rasterizers(self):
        return [*super().gsfw_rasterizers(), self.spec("cuda", Cuda)]

    def spec(self, name, kind):
        if kind is not Cuda:
            return super().spec(name, kind)
        Cuda.able = replace(Cuda.able, unavailable=self.unavailable)
        return Spec(name, f"the {name}", f"{__name__}:Cuda")


@dataclass
class Cuda(Base):
    able = Capabilities(devices=frozenset({"cuda"}), features=frozenset(Feature), preference=20)


@dataclass
class SurfelRasterizer(Base):
    able = Capabilities(
        devices=frozenset({"cpu", "cuda"}),
        features=frozenset(Feature),
        rule="surfels",
        preference=99,
    )


class Surfels(FakePlugin):
    """Also has a preferred rasterizer with a rule of its own."""

    @hookimpl
    def gsfw_rasterizers(self):
        own = Spec("surfels", "", f"{__name__}:SurfelRasterizer")
        return [*super().gsfw_rasterizers(), own]


class Unbuilt(Graphic):
    unavailable = "NVRTC is not installed; pip install nvidia-cuda-nvrtc."


def test_a_rasterizer_with_a_rule_of_its_own_is_taken_only_where_it_is_named(monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    found = settings(registry_of(Surfels()))
    assert found.choices["rasterizer"].name == "fast"
    assert found.config.device == "cpu"
    named = settings(registry_of(Surfels()), rasterizer="surfels")
    assert named.config.device == "cuda"


def test_without_a_gpu_the_device_is_the_cpu_and_nothing_is_said_of_gpus():
    found = settings()
    assert (found.config.device, found.choices["rasterizer"].name) == ("cpu", "fast")
    assert found.sources["device"] == "chosen automatically: torch sees no GPU here"
    assert unused_gpu(rasterizer_capabilities(registry_of(Unbuilt()))) == ()


def test_the_device_is_the_gpu_where_a_rasterizer_is_made_for_it(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    found = settings(registry_of(Graphic()))
    assert (found.config.device, found.choices["rasterizer"].name) == ("cuda", "cuda")
    assert found.sources["device"] == (
        "chosen automatically: torch sees a GPU, and rasterizer cuda runs on it"
    )
    assert settings(registry_of(Graphic()), device="cpu").choices["rasterizer"].name == "fast"


def test_where_the_rasterizer_of_the_gpu_is_missing_the_fast_one_of_the_cpu_is_taken(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    registry = registry_of(Unbuilt())
    found = settings(registry)
    assert (found.config.device, found.choices["rasterizer"].name) == ("cpu", "fast")
    assert found.sources["device"] == (
        "chosen automatically: there is a GPU, but rasterizer fast is preferred to slow, "
        "the best that fits there"
    )
    assert unused_gpu(rasterizer_capabilities(registry)) == (
        "there is a GPU, but rasterizer cuda cannot use it: NVRTC is not installed; "
        "pip install nvidia-cuda-nvrtc.",
    )
    found = settings(registry, antialias="true")  # Which the fast one of the CPU cannot draw.
    assert (found.config.device, found.choices["rasterizer"].name) == ("cuda", "slow")


def test_the_device_is_the_gpu_only_where_a_rasterizer_fits_there(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    found = settings(rasterizer="fast")
    assert found.config.device == "cpu"
    assert found.sources["device"] == (
        "chosen automatically: there is a GPU, but no installed rasterizer fits there"
    )


def test_where_nothing_fits_the_rasterizer_that_lacks_least_is_named():
    found = settings(device="cuda", rasterizer="auto", antialias="true")
    assert found.choices["rasterizer"].name == "slow"
    found = settings(device="tpu")
    assert found.sources["rasterizer"].endswith(
        "no rasterizer on tpu has all that is needed; this lacks least"
    )


def test_a_rasterizer_that_cannot_be_imported_is_unavailable_and_harms_nobody():
    class Broken:
        @hookimpl
        def gsfw_rasterizers(self):
            return [Spec("lost", "", "no_such_module_of_gsfw:Config")]

    registry = registry_of(FakePlugin(), Broken())
    assert settings(registry).choices["rasterizer"].name == "fast"
    assert rasterizer_capabilities(registry)["lost"].unavailable == (
        "rasterizer 'lost' (pkg1 1.0) cannot be used: "
        "ModuleNotFoundError: No module named 'no_such_module_of_gsfw'."
    )


def test_without_any_rasterizer_that_is_said():
    class Nothing(FakePlugin):
        @hookimpl
        def gsfw_rasterizers(self):
            return []

    with pytest.raises(ConfigError) as caught:
        settings(registry_of(Nothing()))
    assert str(caught.value) == "no rasterizer is installed.\nSee gsfw doctor."


class Lost:
    """A plugin whose parts do not import, or fail when they are asked."""

    @hookimpl
    def gsfw_metrics(self):
        return [Spec("lost", "", "no_such_module_of_gsfw:Metric")]

    @hookimpl
    def gsfw_datamanagers(self):
        return [Spec("gone", "", "no_such_module_of_gsfw:Data"), Spec("odd", "", f"{__name__}:Odd")]

    @hookimpl
    def gsfw_rasterizers(self):
        return [Spec("odd", "", f"{__name__}:OddRasterizer")]


class Odd(Source):
    @classmethod
    def detect(cls, path):
        raise IndexError("no image")


class OddRasterizer(Base):
    def capabilities(self):
        raise RuntimeError("no driver")


def test_a_third_partys_part_that_does_not_import_is_left_out_and_told_once():
    registry = registry_of(FakePlugin(), Lost())
    assert "lost" not in load_all("metric", registry)
    assert "lost" not in load_all("metric", registry)
    assert [str(item) for item in registry.broken] == [
        "metric 'lost' (pkg1 1.0) is skipped: "
        "ModuleNotFoundError: No module named 'no_such_module_of_gsfw'. "
        "Install what it needs, or uninstall pkg1."
    ]


def test_a_part_of_gsfw_itself_that_does_not_import_is_an_error(monkeypatch):
    registry = registry_of()
    own = {"psnr": Spec("psnr", "", "no_such_module_of_gsfw:Psnr", version="1.0")}
    monkeypatch.setattr(registry, "slot", lambda _: own)
    with pytest.raises(ConfigError, match=r"^metric 'psnr' \(gsfw 1\.0\) cannot be used"):
        load_all("metric", registry)


def test_a_third_partys_data_manager_or_rasterizer_that_fails_harms_nobody(tmp_path):
    (tmp_path / "apples.txt").touch()
    registry = registry_of(FakePlugin(), Lost())
    found = settings(registry, data=str(tmp_path))
    assert (found.choices["datamanager"].name, found.choices["rasterizer"].name) == (
        "apples",
        "fast",
    )
    assert [(item.name, item.reason) for item in registry.broken][1:] == [
        ("odd", "it failed with IndexError: no image"),
        ("odd", "it failed with RuntimeError: no driver"),
    ]


def test_a_folder_that_may_not_be_read_is_said(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    for name in ("exists", "iterdir"):
        with monkeypatch.context() as patch:
            patch.setattr(Path, name, refuse)
            assert data_refusal(tmp_path) == (
                f"data={tmp_path}: {tmp_path} cannot be read: Permission denied.\n"
                "Give a folder that you may read, or have its permissions changed."
            )
