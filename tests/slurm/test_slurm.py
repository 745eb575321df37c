"""wdpm under a real Slurm: the bits of one process, also where tasks and the master are lost on the way."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from digests import same_bits
from local_slurm import local_slurm, missing, node_states, processes_of
from patience import WAIT_S

import wdpm
from wdpm.images.image import Image, load

reason = missing()
pytestmark = [pytest.mark.slurm, pytest.mark.skipif(reason is not None, reason=reason or "")]

SETTINGS = {"photons": 20_000, "spp": 16, "passes": 3}
RENDER = ["cornell-box", "--size", "96x96", "--photons", "20k", "--spp", "16", "--passes", "3"]
SRUN = ["srun", "--overcommit", "--no-kill", "--kill-on-bad-exit=0", "--mem=3000", "-n"]
WDPM = [sys.executable, "-m", "wdpm"]
JOINED = re.compile(r"slave \d+ \(.*, process (\d+)\) joined")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the Slurm."""
    return tmp_path_factory.mktemp("slurm")


@pytest.fixture(scope="module")
def environment(folder: Path) -> Iterator[dict[str, str]]:
    with local_slurm(folder) as found:
        package = Path(wdpm.__file__).parent.parent
        yield {**found, "PYTHONPATH": f"{package}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}


@pytest.fixture(scope="module")
def alone() -> Image:
    return wdpm.render(wdpm.load("cornell-box", size=(96, 96)), **SETTINGS)


def srun(tasks: int, folder: Path, environment: dict[str, str], nodes: int = 1) -> subprocess.Popen[str]:
    command = [*SRUN, str(tasks), "-N", str(nodes), *WDPM, "render", *RENDER, "-o", "box.exr", "--slurm"]
    return subprocess.Popen(command, cwd=folder, env=environment, stderr=subprocess.PIPE, text=True)


def slaves_at_work(step: subprocess.Popen[str], slaves: int) -> list[int]:
    """Process numbers of the slaves, once the image is rendered."""
    assert step.stderr is not None
    processes = []
    for line in step.stderr:
        processes += [int(number) for number in JOINED.findall(line)]
        if line.startswith(("render", "passes")) and len(processes) == slaves:
            return processes
    raise AssertionError("the step ended before it had begun")


def test_a_step_gives_the_bits_of_one_process(tmp_path: Path, environment: dict[str, str], alone: Image) -> None:
    with srun(3, tmp_path, environment) as step:
        _, said = step.communicate(timeout=WAIT_S)
    assert step.returncode == 0, said
    image = load(tmp_path / "box.exr")
    assert same_bits(image, alone)
    assert len(image.metadata["report"]["slaves"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["box.exr"]


def test_a_slave_that_is_killed_is_done_without(tmp_path: Path, environment: dict[str, str], alone: Image) -> None:
    with srun(3, tmp_path, environment) as step:
        victim = slaves_at_work(step, 2)[0]
        os.kill(victim, signal.SIGKILL)
        assert step.stderr is not None
        assert f"process {victim}) is lost" in step.stderr.read()
    assert step.returncode == 128 + signal.SIGKILL, "of the task that was killed: srun gives the highest code"
    assert same_bits(load(tmp_path / "box.exr"), alone)


def test_an_error_of_the_master_ends_the_slaves(tmp_path: Path, environment: dict[str, str]) -> None:
    command = [*SRUN, "3", *WDPM, "render", "nowhere.xml", "-o", "box.exr", "--slurm"]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=WAIT_S
    )
    assert done.returncode != 0
    assert "nowhere.xml" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_job_that_is_told_to_stop_is_requeued_and_goes_on(
    tmp_path: Path, environment: dict[str, str], alone: Image
) -> None:
    command = [*WDPM, "slurm", "--tasks", "3", "--wdpm", str(tmp_path / "wdpm"), *RENDER, "-o", "box.exr"]
    text = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout
    (tmp_path / "wdpm").write_text(f'#!/bin/bash\nexec {sys.executable} -m wdpm "$@"\n')
    (tmp_path / "wdpm").chmod(0o755)
    text = text.replace("#SBATCH --requeue", "#SBATCH --overcommit\n#SBATCH --mem=3000\n#SBATCH --requeue")
    (tmp_path / "job.sh").write_text(text.replace("--signal=TERM@120", "--signal=TERM@1"))
    sbatch = ["sbatch", "--parsable", "--output=job.out", "job.sh"]
    told = subprocess.run(sbatch, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    job = told.stdout.strip()
    journal = tmp_path / "box.exr.wdpm-passes"
    wait_until(journal.exists, tmp_path)
    # What Slurm does when the time limit comes near: SIGTERM to the tasks of the job's steps.
    subprocess.run(["scancel", "--signal=TERM", job], env=environment, check=True)
    wait_until(lambda: state(job, environment) == "PENDING", tmp_path)

    def runs_again() -> bool:
        """A requeued job is begun again after two minutes, unless Slurm is told to do so at once."""
        if state(job, environment) == "PENDING":
            update = ["scontrol", "update", f"JobId={job}", "StartTime=now"]
            subprocess.run(update, env=environment, capture_output=True, check=False)
        return state(job, environment) in ("RUNNING", "COMPLETED")

    wait_until(runs_again, tmp_path)
    wait_until(lambda: state(job, environment) == "COMPLETED", tmp_path)
    assert same_bits(load(tmp_path / "box.exr"), alone)
    assert not journal.exists()
    assert not list(tmp_path.glob("*begun*"))


def test_a_node_that_is_lost_is_done_without(
    tmp_path: Path, folder: Path, environment: dict[str, str], alone: Image
) -> None:
    with srun(3, tmp_path, environment, nodes=2) as step:
        slaves = slaves_at_work(step, 2)
        lost = processes_of("n2", folder)
        assert len(set(slaves).intersection(lost)) == 1, "tasks 0 and 1 run on the first node"
        for process in lost:
            os.kill(process, signal.SIGKILL)
        assert step.stderr is not None
        assert "is lost" in step.stderr.read()
    assert same_bits(load(tmp_path / "box.exr"), alone)
    assert node_states(environment)["n2"].startswith("down")


def state(job: str, environment: dict[str, str]) -> str:
    told = subprocess.run(
        ["scontrol", "show", "job", job], env=environment, capture_output=True, text=True, check=False
    )
    found = re.search(r"JobState=(\w+)", told.stdout)
    return found[1] if found else told.stderr


def wait_until(there: object, folder: Path) -> None:
    assert callable(there)
    deadline = time.monotonic() + WAIT_S
    while not there():
        out = folder / "job.out"
        assert time.monotonic() < deadline, out.read_text() if out.exists() else "the job has said nothing"
        time.sleep(0.1)
