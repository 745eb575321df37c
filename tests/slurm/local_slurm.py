"""A Slurm of two nodes on this machine while tests run: configuration, munge, controller and daemons of its own.

As root, with Debian's packages slurm-wlm and munge, which `make test-slurm` installs. The configuration of a Slurm that
the machine may have is neither read nor changed.
"""

from __future__ import annotations

import os
import platform
import secrets
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "srun", "sbatch", "sinfo")

NODES = ("n1", "n2")

START_S = 60.0
"""How long the nodes may take to become ready [s]."""

# No cgroups, so that it runs in containers; more tasks than cores may share the node.
CONFIGURATION = """\
ClusterName=wdpm
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
ReturnToService=2
KillWait=5
SlurmdTimeout=10
{nodes}
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP OverSubscribe=FORCE
"""


def missing() -> str | None:
    """Why it cannot run here, or None."""
    absent = [program for program in PROGRAMS if _program(program) is None]
    if absent:
        return f"Slurm is not there ({', '.join(absent)}): make test-slurm installs it"
    if os.geteuid() != 0:
        return "slurmd and munged of a test need to be root"
    return None


@contextmanager
def local_slurm(folder: Path) -> Iterator[dict[str, str]]:
    """Start it; gives the environment in which its commands find it.

    Args:
        folder: new, for what it writes.
    """
    folder.chmod(0o700)
    environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}
    key = folder / "munge.key"
    key.write_bytes(secrets.token_bytes(1024))
    key.chmod(0o400)
    for name in ("state", *(f"spool-{node}" for node in NODES)):
        (folder / name).mkdir()
    (folder / "slurm.conf").write_text(_configuration(folder))
    daemons: list[subprocess.Popen[bytes]] = []
    try:
        daemons.append(_start(["munged", "--foreground", "--force", *_munge_files(folder)], folder, environment))
        _wait_until(lambda: (folder / "munge.socket").exists(), daemons, folder)
        daemons.append(_start(["slurmctld", "-D"], folder, environment))
        daemons += [_start(["slurmd", "-D", "-N", node], folder, environment) for node in NODES]
        _wait_until(lambda: node_states(environment) == dict.fromkeys(NODES, "idle"), daemons, folder)
        yield environment
    finally:
        for daemon in reversed(daemons):
            daemon.terminate()
        for daemon in reversed(daemons):
            try:
                daemon.wait(10.0)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()


def _configuration(folder: Path) -> str:
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 1024**2 // len(NODES)
    host, cpus = platform.node().partition(".")[0], os.cpu_count()
    nodes = [
        f"NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={_free_port()} CPUs={cpus} RealMemory={memory} "
        "State=UNKNOWN"
        for node in NODES
    ]
    return CONFIGURATION.format(folder=folder, host=host, controller_port=_free_port(), nodes="\n".join(nodes))


def _munge_files(folder: Path) -> list[str]:
    return [
        f"--key-file={folder}/munge.key",
        f"--socket={folder}/munge.socket",
        f"--pid-file={folder}/munge.pid",
        f"--log-file={folder}/munge.log",
        f"--seed-file={folder}/munge.seed",
    ]


def _start(command: list[str], folder: Path, environment: dict[str, str]) -> subprocess.Popen[bytes]:
    program = _program(command[0])
    assert program is not None
    with (folder / f"{command[0]}.out").open("ab") as out:
        return subprocess.Popen([program, *command[1:]], env=environment, stdout=out, stderr=out)


def _wait_until(ready: object, daemons: list[subprocess.Popen[bytes]], folder: Path) -> None:
    assert callable(ready)
    deadline = time.monotonic() + START_S
    while not ready():
        ended = [daemon.args for daemon in daemons if daemon.poll() is not None]
        if ended or time.monotonic() > deadline:
            told = "\n".join(path.read_text(errors="replace") for path in sorted(folder.glob("*.out")))
            raise AssertionError(f"Slurm does not start ({ended or 'too slow'}):\n{told}")
        time.sleep(0.1)


def node_states(environment: dict[str, str]) -> dict[str, str]:
    """What Slurm says of its nodes, by name."""
    command = ["sinfo", "-h", "-N", "-o", "%N %T"]
    told = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    return dict(line.split() for line in told.stdout.splitlines())


def processes_of(node: str, folder: Path) -> list[int]:
    """The daemon of a node, the tasks that it runs, and the processes of Slurm's that watch those."""
    mark = f"SLURMD_NODENAME={node}".encode()
    tasks = [process for process in Path("/proc").glob("[0-9]*") if mark in _read(process / "environ").split(b"\0")]
    parents = {Path("/proc") / _read(task / "stat").rpartition(b")")[2].split()[1].decode() for task in tasks}
    watching = [process for process in parents if b"slurmstepd" in _read(process / "cmdline")]
    return [int((folder / f"slurmd-{node}.pid").read_text()), *(int(each.name) for each in (*watching, *tasks))]


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:  # the process has ended
        return b""


def _program(name: str) -> str | None:
    """Daemons lie where only root looks."""
    return shutil.which(name, path=f"{os.environ.get('PATH', os.defpath)}:/usr/sbin:/sbin")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
