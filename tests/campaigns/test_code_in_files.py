"""No file that gsfw reads can run code: pickles and YAML tags in it are refused."""

import os
import pickle
import zipfile

import numpy as np
import pytest
import torch

from gsfw.core.errors import UserError
from gsfw.core.files.array_file import read_array
from gsfw.core.loop.checkpoint_file import checkpoint_environment, read_checkpoint
from gsfw.datamanagers.llff import read_rows
from gsfw.formats.model_file import read_model_file
from gsfw.plugins.config_file import read_config
from gsfw.studies.bench.workload import read_workload
from gsfw.studies.study_file import read_study


class Harm:
    """Unpickled, it makes a folder."""

    def __init__(self, place):
        self.place = place

    def __reduce__(self):
        return os.mkdir, (str(self.place),)


def saved(path, place):
    torch.save({"schema": 2, "step": 1, "model": {}, "environment": Harm(place)}, path)


def saved_as_before(path, place):
    state = {"schema": 2, "step": 1, "environment": Harm(place)}
    torch.save(state, path, _use_new_zipfile_serialization=False)


def pickled(path, place):
    path.write_bytes(pickle.dumps(Harm(place)))


def array(path, place):
    np.save(path, np.array([Harm(place)], object), allow_pickle=True)


def arrays(path, place):
    fields = ("means", "quats", "scales", "opacities", "colors", "world_to_camera", "intrinsics")
    objects = {name: np.array([Harm(place)], object) for name in (*fields, "width", "height")}
    np.savez(path, **objects)


def archive(path, place):
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("header.json", '{"format": "gsfw model", "version": 1}')
        made.writestr("state/means.npy", pickle.dumps(Harm(place)))


def tagged(path, place):
    path.write_text(f"rows: !!python/object/apply:os.mkdir ['{place}']\n")


@pytest.mark.parametrize(
    ("name", "write", "read"),
    [
        ("a.pt", saved, read_checkpoint),
        ("a.pt", saved_as_before, read_checkpoint),
        ("a.pt", pickled, read_checkpoint),
        ("a.npy", array, read_array),
        ("a.npy", pickled, read_array),
        ("poses_bounds.npy", array, read_rows),
        ("a.npz", arrays, read_workload),
        ("a.gsfw", archive, read_model_file),
        ("a.gsfw", pickled, read_model_file),
        ("a.yaml", tagged, read_config),
        ("a.yaml", tagged, read_study),
    ],
)
def test_code_in_a_file_is_refused_and_never_run(tmp_path, name, write, read):
    place, path = tmp_path / "harm", tmp_path / name
    write(path, place)
    with pytest.raises(UserError):
        read(path)
    assert not place.exists()


@pytest.mark.parametrize("write", [saved, saved_as_before, pickled])
def test_code_in_a_checkpoint_is_not_run_for_its_environment_either(tmp_path, write):
    write(tmp_path / "a.pt", tmp_path / "harm")
    assert checkpoint_environment(tmp_path / "a.pt") == {}
    assert not (tmp_path / "harm").exists()


def test_the_planted_code_does_run_where_pickles_are_trusted(tmp_path):
    saved(tmp_path / "a.pt", tmp_path / "harm")
    torch.load(tmp_path / "a.pt", weights_only=False)
    assert (tmp_path / "harm").is_dir()
