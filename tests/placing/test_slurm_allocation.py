"""What is read from the environment that srun makes, and how a list of nodes is asked for."""

from __future__ import annotations

import subprocess
from typing import Any

import pytest

from wdpm.placing import slurm
from wdpm.placing.slurm import Allocation, allocation_of, other_nodes
from wdpm.scenes.errors import SettingsError

# As Slurm 22.05 gave it to the third task of `srun -n 5 -N 2`, without what is not read.
STEP = {
    "SLURM_JOB_ID": "17",
    "SLURM_STEP_ID": "0",
    "SLURM_SRUN_COMM_PORT": "39581",
    "SLURM_PROCID": "2",
    "SLURM_NODEID": "0",
    "SLURMD_NODENAME": "node1",
    "SLURM_STEP_NUM_TASKS": "5",
    "SLURM_STEP_NUM_NODES": "2",
    "SLURM_STEP_NODELIST": "node[1-2]",
    "SLURM_STEP_TASKS_PER_NODE": "3,2",
    "SLURM_CPUS_ON_NODE": "12",
}


@pytest.fixture(autouse=True)
def sixteen_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slurm, "available_cores", lambda: 16)


def test_a_task_of_a_step() -> None:
    assert allocation_of(STEP) == Allocation("17-0-0-39581", 2, 5, "node1", "node[1-2]", 4, None)


def test_a_requeued_job_has_another_name() -> None:
    assert allocation_of({**STEP, "SLURM_RESTART_COUNT": "1"}).name == "17-0-1-39581"


@pytest.mark.parametrize(
    ("given", "threads"),
    [
        ({"SLURM_CPUS_PER_TASK": "7"}, 7),
        ({"SLURM_CPUS_PER_TASK": "64"}, 16),
        ({"SLURM_CPUS_ON_NODE": "1"}, 1),
        ({"SLURM_NODEID": "1"}, 6),
        ({"SLURM_STEP_TASKS_PER_NODE": "2(x2),1", "SLURM_NODEID": "1"}, 6),
        ({"SLURM_STEP_TASKS_PER_NODE": "2(x2),1", "SLURM_NODEID": "2"}, 12),
    ],
)
def test_cores_of_a_task(given: dict[str, str], threads: int) -> None:
    assert allocation_of({**STEP, **given}).threads == threads


@pytest.mark.parametrize(
    ("given", "mebibytes"),
    [
        ({"SLURM_MEM_PER_CPU": "500"}, 2000),
        ({"SLURM_MEM_PER_CPU": "500", "SLURM_CPUS_PER_TASK": "2"}, 1000),
        ({"SLURM_MEM_PER_NODE": "9000"}, 3000),
    ],
)
def test_memory_of_a_task(given: dict[str, str], mebibytes: int) -> None:
    assert allocation_of({**STEP, **given}).memory == mebibytes * 1024 * 1024


def test_memory_that_slurm_does_not_bound() -> None:
    assert allocation_of({**STEP, "SLURM_MEM_PER_NODE": "0"}).memory is None


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"SLURM_PROCID": ""}, "no task of a Slurm step; start it with srun"),
        ({"SLURM_STEP_NUM_TASKS": "many"}, "no task of a Slurm step; start it with srun"),
        ({"SLURM_STEP_NUM_TASKS": "1"}, "at least one slave: srun -n 2"),
    ],
)
def test_what_is_no_step_of_a_cluster(given: dict[str, str], said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        allocation_of({**STEP, **given})


def test_slurm_itself_knows_addresses_of_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        assert command == ["scontrol", "--oneliner", "show", "nodes", "node[1-2]"]
        told = [f"NodeName=node{n} Arch=x86_64 NodeAddr=10.0.0.{n} NodeHostName=node{n} Port=6818 \n" for n in (1, 2)]
        return subprocess.CompletedProcess(command, 0, "".join(told))

    monkeypatch.setattr(subprocess, "run", run)
    assert other_nodes(allocation_of(STEP)) == ["10.0.0.2"]


def test_a_step_on_one_node_asks_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert other_nodes(allocation_of({**STEP, "SLURM_STEP_NUM_NODES": "1"})) == []
    with pytest.raises(SettingsError, match="cannot find the nodes of the step"):
        other_nodes(allocation_of(STEP))
