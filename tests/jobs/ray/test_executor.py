"""Jobs on a Ray cluster of two machines, whose disks are shared or not."""

import math
import shutil

import pytest
from support.ray_cluster import cluster  # noqa: F401 - a fixture

from gsfw.core.callback import Control
from gsfw.core.errors import UnavailableError
from gsfw.jobs.executor import outcomes
from gsfw.jobs.job import Call, Job, Resources
from gsfw.jobs.ray import remote_job
from gsfw.jobs.ray.executor import RayExecutor

pytestmark = pytest.mark.slow

ONE = Resources(cpus=1.0)


def test_jobs_values_errors_and_folders_come_from_all_machines(cluster, tmp_path, monkeypatch):  # noqa: F811
    (tmp_path / "from").mkdir()
    (tmp_path / "from" / "file").write_text("hello")
    shared, apart = tmp_path / "shared", tmp_path / "apart"

    def copy(name, folder):
        work = Call(shutil.copytree, (tmp_path / "from", folder))
        return Job(name, work, ONE, reads=(tmp_path / "from",), folder=folder)

    with RayExecutor(cluster.address) as executor:
        assert executor.places(ONE) == 2
        with pytest.raises(UnavailableError, match="no machine of the Ray cluster has"):
            executor.start(Job("large", ("info",), Resources(cpus=64.0)))
        jobs = [
            Job("root", Call(math.sqrt, (4,)), ONE),
            Job("none", Call(math.sqrt, (-1,)), ONE),
            Job("blind", Call(math.sqrt, (4,)), ONE, reads=(tmp_path / "absent",)),
            copy("shared", shared),
        ]
        found = {job.name: outcome for job, outcome in outcomes(executor, jobs, Control())}
        # A mark that the machine does not find: it then works in a folder of its own.
        monkeypatch.setattr(remote_job, "_mark_beside", lambda folder: tmp_path / "unseen")
        ((_, alone),) = outcomes(executor, [copy("apart", apart)], Control())
    assert found["root"].value == 2.0
    assert found["none"].error.startswith("ValueError: ")
    assert "does not see" in found["blind"].error
    assert "absent" in found["blind"].error
    assert found["shared"].finished, found["shared"].error
    assert alone.finished, alone.error
    assert (shared / "file").read_text() == (apart / "file").read_text() == "hello"
    assert not list(tmp_path.glob(".seen-*"))
