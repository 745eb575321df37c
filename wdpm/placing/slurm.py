"""What Slurm gives each task of a job step, as srun tells it in the environment (man srun, OUTPUT ENVIRONMENT).

Task 0 is the master, the others are its slaves.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass

from wdpm.devices import available_cores
from wdpm.placing.asking import answer_of
from wdpm.scenes.errors import SettingsError

_MEBIBYTE = 1024 * 1024

ASK_S = 30.0
"""How long `scontrol` may take [s]."""


@dataclass(frozen=True)
class Allocation:
    """One task of a step.

    Attributes:
        name: of the step, the same in all its tasks and in no other step, nor in the same one after a requeue.
        rank: of the task, from 0.
        tasks: of the step.
        node: name of the node that the task runs on.
        nodes: names of all nodes of the step, as Slurm abbreviates them; empty where there is no other.
        threads: cores for this task.
        memory: for this task [bytes]; None where Slurm does not manage memory.
    """

    name: str
    rank: int
    tasks: int
    node: str
    nodes: str
    threads: int
    memory: int | None


def allocation_of(environment: Mapping[str, str]) -> Allocation:
    """What an environment says of this task; SettingsError unless srun has started it, beside at least one other."""
    tasks = _number(environment, "SLURM_STEP_NUM_TASKS")
    rank = _number(environment, "SLURM_PROCID")
    if tasks is None or rank is None:
        raise SettingsError(
            "--slurm: this process is no task of a Slurm step; start it with srun -n N wdpm render SCENE --slurm"
        )
    if tasks < 2:
        raise SettingsError("--slurm: the step has one task, but a master needs at least one slave: srun -n 2, or more")
    here = _tasks_here(environment, tasks)
    threads = _threads(environment, here)
    return Allocation(
        name="-".join(environment.get(name, "0") for name in _IDENTITY),
        rank=rank,
        tasks=tasks,
        node=environment.get("SLURMD_NODENAME", ""),
        nodes=environment.get("SLURM_STEP_NODELIST", "") if _number(environment, "SLURM_STEP_NUM_NODES") != 1 else "",
        threads=threads,
        memory=_memory(environment, threads, here),
    )


def other_nodes(allocation: Allocation) -> list[str]:
    """Addresses of the other nodes of a step, which Slurm's own tool knows: a node's name need not be one.

    Raises:
        SettingsError: it cannot be asked.
    """
    if not allocation.nodes:
        return []
    command = ["scontrol", "--oneliner", "show", "nodes", allocation.nodes]
    try:
        answer = answer_of(command, ASK_S)
    except SettingsError as error:
        raise SettingsError(f"--slurm: cannot find the nodes of the step: {error}") from None
    nodes = re.findall(r"^NodeName=(\S+) .*?\bNodeAddr=(\S+)", answer, re.MULTILINE)
    return [address for name, address in nodes if name != allocation.node]


_IDENTITY = ("SLURM_JOB_ID", "SLURM_STEP_ID", "SLURM_RESTART_COUNT", "SLURM_SRUN_COMM_PORT")
"""A requeued job has its number again, and its first step is 0 again."""


def _threads(environment: Mapping[str, str], here: int) -> int:
    """Cores of a task: what was asked for, else its part of what the step has on this node."""
    asked = _number(environment, "SLURM_CPUS_PER_TASK")
    if asked is None:
        asked = (_number(environment, "SLURM_CPUS_ON_NODE") or available_cores()) // here
    return min(max(1, asked), available_cores())


def _memory(environment: Mapping[str, str], threads: int, here: int) -> int | None:
    """Memory of a task [bytes]. Slurm counts in MiB; 0 means all that the node has."""
    each = _number(environment, "SLURM_MEM_PER_CPU")
    if each:
        return each * threads * _MEBIBYTE
    node = _number(environment, "SLURM_MEM_PER_NODE")
    return node * _MEBIBYTE // here if node else None


def _tasks_here(environment: Mapping[str, str], tasks: int) -> int:
    """Tasks of the step on this node, from a list like 2(x3),1: two on each of three nodes, and one on the next."""
    node = _number(environment, "SLURM_NODEID") or 0
    for count, times in re.findall(r"(\d+)(?:\(x(\d+)\))?", environment.get("SLURM_STEP_TASKS_PER_NODE", "")):
        node -= int(times or 1)
        if node < 0:
            return max(1, int(count))
    return tasks


def _number(environment: Mapping[str, str], name: str) -> int | None:
    text = environment.get(name, "")
    return int(text) if re.fullmatch(r"[0-9]{1,12}", text) else None


def this_allocation() -> Allocation:
    """That of this process."""
    return allocation_of(os.environ)
