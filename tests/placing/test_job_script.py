"""The job script of `wdpm slurm`, run by bash with an srun and an scontrol that tell what they were asked."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from command_line import refusal

from wdpm.cli.main import main

SRUN = """#!/bin/bash
printf '%s\\n' "$@" > srun.words
{does}
exit {code}
"""
IMAGE = "a b's.exr"


def script(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(["slurm", "--tasks", "3", *words]) == 0
    return capsys.readouterr().out


def write(path: Path, text: str) -> None:
    path.write_text(text)
    path.chmod(0o755)


def submit(text: str, folder: Path, srun: str, restarts: str = "0") -> int:
    """Run a script as Slurm does; returns its exit code."""
    write(folder / "srun", srun)
    write(folder / "scontrol", '#!/bin/bash\necho "$@" > scontrol.words\n')
    environment = {
        **os.environ,
        "PATH": f"{folder}:{os.environ['PATH']}",
        "SLURM_JOB_ID": "9",
        "SLURM_RESTART_COUNT": restarts,
    }
    return subprocess.run(["bash", "-c", text], cwd=folder, env=environment, check=False).returncode


def requeued(folder: Path) -> bool:
    return (folder / "scontrol.words").exists()


@pytest.fixture
def text(capsys: pytest.CaptureFixture[str]) -> str:
    return script(capsys, "my $scene.xml", "-o", IMAGE, "--passes", "3")


def test_what_a_job_asks_for(capsys: pytest.CaptureFixture[str]) -> None:
    text = script(capsys, "--cores", "8", "--memory-per-core", "2G", "--time", "4:00:00", "--partition", "gpu", "s.xml")
    asked = [line.removeprefix("#SBATCH --") for line in text.splitlines() if line.startswith("#SBATCH")]
    assert asked == [
        "job-name=wdpm-s",
        "ntasks=3",
        "cpus-per-task=8",
        "mem-per-cpu=2097152K",
        "time=4:00:00",
        "partition=gpu",
        "signal=TERM@120",
        "open-mode=append",
        "requeue",
        "no-kill",
    ]


def test_srun_gets_each_word_as_it_is(text: str, tmp_path: Path) -> None:
    assert submit(text, tmp_path, SRUN.format(does=f'touch "{IMAGE}"', code=0)) == 0
    words = (tmp_path / "srun.words").read_text().splitlines()
    rendered = ["wdpm", "render", "my $scene.xml", "-o", IMAGE, "--passes", "3", "--slurm"]
    assert words == ["--no-kill", "--kill-on-bad-exit=0", *rendered]
    assert not requeued(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"srun", "scontrol", "srun.words", IMAGE}


def test_a_lost_slave_is_no_failure_of_the_job(text: str, tmp_path: Path) -> None:
    assert submit(text, tmp_path, SRUN.format(does=f'sleep 0.01; touch "{IMAGE}"', code=137)) == 0
    assert not requeued(tmp_path)


@pytest.mark.parametrize(("code", "kept"), [(143, "wdpm-passes"), (137, "wdpm-journal"), (75, "wdpm-journal")])
def test_an_interrupted_render_is_requeued_and_resumed(code: int, kept: str, text: str, tmp_path: Path) -> None:
    (tmp_path / IMAGE).touch()  # of another day
    leaves_a_journal = SRUN.format(does=f'touch "{IMAGE}.{kept}"', code=code)
    assert submit(text, tmp_path, leaves_a_journal) == code
    assert (tmp_path / "scontrol.words").read_text() == "requeue 9\n"
    assert "--resume" not in (tmp_path / "srun.words").read_text()
    ends = SRUN.format(does=f'rm "{IMAGE}.{kept}"; sleep 0.01; touch "{IMAGE}"', code=0)
    assert submit(text, tmp_path, ends, "1") == 0
    assert (tmp_path / "srun.words").read_text().splitlines()[-1] == "--resume"


@pytest.mark.parametrize(("code", "restarts"), [(2, "0"), (1, "0"), (143, "20")])
def test_what_would_fail_again_is_not_requeued(code: int, restarts: str, text: str, tmp_path: Path) -> None:
    assert submit(text, tmp_path, SRUN.format(does="", code=code), restarts) == code
    assert not requeued(tmp_path)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--tasks", "1", "s.xml"], "needs at least one slave"),
        (["--tasks", "2", "s.xml", "--passses", "2"], "unrecognized arguments: --passses"),
        (["--tasks", "2"], "required: SCENE"),
        (["--tasks", "2", "a.glb", "--frames", "1..3"], "its scripts are for one image"),
        (["--tasks", "2", "s.xml", "--resume"], "leave --resume out"),
        (["--tasks", "2", "s.xml", "--slaves", "2"], "--slurm and --slaves contradict each other"),
    ],
)
def test_what_cannot_be_asked_for(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert said in refusal(["slurm", *words], capsys)
