"""Two machines, as namespaces of the network, whose link is down for a while, or for good."""

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from support.processes import LONG, Started, command, last_step, state
from support.states import assert_same_bits

from gsfw.commands.main import main
from gsfw.core.cores import cores
from gsfw.core.loop.run_folder import RunFolder

pytestmark = pytest.mark.slow

HOSTS = ("10.213.7.1", "10.213.7.2")
PORT = "29511"


class Machines:
    """Two namespaces that a cable joins; processes in them see no other network."""

    def __init__(self, stack: ExitStack) -> None:
        self._cable = [f"gsfw{os.getpid() % 100000}{side}" for side in "ab"]
        self._sleepers = []
        for _ in HOSTS:
            sleeper = subprocess.Popen(["unshare", "--net", "sleep", "600"])
            stack.callback(sleeper.wait)
            stack.callback(sleeper.kill)
            self._sleepers.append(str(sleeper.pid))
        time.sleep(0.3)  # Until both have left the namespace of this process.
        ends = ("type", "veth", "peer", "name", self._cable[1])
        subprocess.run(["ip", "link", "add", self._cable[0], *ends], check=True)
        for place, (name, sleeper) in enumerate(zip(self._cable, self._sleepers, strict=True)):
            subprocess.run(["ip", "link", "set", name, "netns", sleeper], check=True)
            self.run(place, "ip", "addr", "add", f"{HOSTS[place]}/24", "dev", name)
            self.run(place, "ip", "link", "set", "lo", "up")
            self.run(place, "ip", "link", "set", name, "up")

    def inside(self, place: int) -> tuple[str, ...]:
        """Words before a command that runs on a machine."""
        return ("nsenter", "--net", "--target", self._sleepers[place])

    def run(self, place: int, *words: str) -> None:
        """Run a command on a machine."""
        subprocess.run([*self.inside(place), *words], check=True)

    def lose_all(self) -> None:
        """Lose what is sent from either side: it goes to an address that no machine has."""
        for place, name in enumerate(self._cable):
            wrong = ("lladdr", "02:00:00:00:00:99", "nud", "permanent")
            self.run(place, "ip", "neigh", "replace", HOSTS[1 - place], *wrong, "dev", name)

    def lose_nothing(self) -> None:
        """Let the machines find each other again."""
        for place, name in enumerate(self._cable):
            self.run(place, "ip", "neigh", "del", HOSTS[1 - place], "dev", name)

    def start(self, tmp_path, patience: str, *words: str) -> list[Started]:
        """Start a training as a launcher does, one process on each machine."""
        train = command("train", *LONG, f"out={tmp_path / 'run'}", *words)
        found = []
        for rank, name in enumerate(self._cable):
            variables = {"RANK": str(rank), "WORLD_SIZE": "2", "MASTER_ADDR": HOSTS[0]}
            variables |= {"MASTER_PORT": PORT, "GLOO_SOCKET_IFNAME": name}
            variables["LOCAL_WORLD_SIZE"] = str(cores())  # One thread for each.
            said = tmp_path / f"said{rank}.txt"
            line = (*self.inside(rank), *train)
            found.append(Started(line, said, **variables, GSFW_PATIENCE=patience))
        return found


@pytest.fixture
def machines() -> Iterator[Machines]:
    missing = [name for name in ("ip", "unshare", "nsenter") if shutil.which(name) is None]
    if missing:
        pytest.skip(f"needs {', '.join(missing)} (iproute2, util-linux)")
    if subprocess.run(["unshare", "--net", "true"], capture_output=True, check=False).returncode:
        pytest.skip("namespaces of the network need root")
    with ExitStack() as stack:
        try:
            made = Machines(stack)
        except subprocess.CalledProcessError as error:
            pytest.skip(f"this kernel has no virtual cables ({error.cmd})")
        yield made


@pytest.fixture
def stopped() -> Iterator[list[Started]]:
    """Commands that are killed after the test, if it has failed."""
    started: list[Started] = []
    yield started
    for item in started:
        item.process.kill()
        item.process.wait()


def test_a_pause_of_the_network_delays_the_training_and_changes_no_bit(tmp_path, machines, stopped):
    run = RunFolder(tmp_path / "run")
    stopped += machines.start(tmp_path, "30", "steps=60")
    stopped[0].wait_for(lambda: run.checkpoint(10).is_file())
    machines.lose_all()
    time.sleep(1)  # Until a process waits for the other one.
    before = run.latest_checkpoint()
    time.sleep(3)
    assert run.latest_checkpoint() == before
    assert not run.checkpoint(60).is_file()
    machines.lose_nothing()
    for item in stopped:
        code, said = item.ended(90)
        assert code == 0, said
        assert "error" not in said
    alone = ("train", *LONG, "steps=60", "processes=1", f"out={tmp_path / 'alone'}")
    assert main(alone) == 0
    assert_same_bits(state(run.path), state(tmp_path / "alone"))


def test_a_lost_machine_ends_the_training_and_the_last_checkpoint_goes_on(
    tmp_path, machines, stopped
):
    run = RunFolder(tmp_path / "run")
    stopped += machines.start(tmp_path, "0.25")
    stopped[0].wait_for(lambda: run.checkpoint(10).is_file())
    machines.lose_all()
    code, said = stopped[0].ended(60)
    assert code == 1
    assert said.count("error:") == 1
    assert "another process of this training has ended or does not answer" in said
    assert "Traceback" not in said
    code, said = stopped[1].ended(60)
    assert code == 1
    assert "Traceback" not in said
    steps = last_step(run.path)
    assert main(["resume", str(run.path), f"steps={steps + 5}", "processes=1"]) == 0
