"""What is read from the environment that srun makes, and how a list of nodes is asked for."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import pytest
from patience import WAIT_S

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


@pytest.mark.processes
def test_slurm_itself_knows_addresses_of_nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nodes = [f"NodeName=node{n} Arch=x86_64 NodeAddr=10.0.0.{n} NodeHostName=node{n} Port=6818" for n in (1, 2)]
    scontrol(
        tmp_path, monkeypatch, '[ "$*" = "--oneliner show nodes node[1-2]" ] && printf "%s\\n" ' + shlex.join(nodes)
    )
    assert other_nodes(allocation_of(STEP)) == ["10.0.0.2"]


@pytest.mark.processes
@pytest.mark.parametrize(
    ("does", "said"),
    [
        ("echo 'Unable to contact slurm controller' >&2; exit 1", "node.1-2.: Unable to contact slurm controller$"),
        ("exit 3", "it ended with exit code 3$"),
        ("exec sleep 60", "has not ended within 0.2 s$"),
    ],
)
def test_slurm_cannot_say(does: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slurm, "ASK_S", 0.2 if "sleep" in does else WAIT_S)
    scontrol(tmp_path, monkeypatch, does)
    with pytest.raises(SettingsError, match=f"cannot find the nodes of the step: scontrol .*{said}"):
        other_nodes(allocation_of(STEP))


def scontrol(folder: Path, monkeypatch: pytest.MonkeyPatch, does: str) -> None:
    """Slurm's tool as a script."""
    path = folder / "scontrol"
    path.write_text(f"#!/bin/bash\n{does}\n")
    path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")


def test_a_step_on_one_node_asks_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert other_nodes(allocation_of({**STEP, "SLURM_STEP_NUM_NODES": "1"})) == []
    with pytest.raises(SettingsError, match="cannot find the nodes of the step"):
        other_nodes(allocation_of(STEP))
