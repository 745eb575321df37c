"""A job script for Slurm that renders, and goes on where it was when the job is requeued."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_SCRIPT = """\
#!/bin/bash
# Submit this with sbatch. The job's first task is the master, the others are its slaves.
{directives}

# A task or a node that is lost does not end the render; the others go on with its work.
image={image}
begun=$image.begun-$SLURM_JOB_ID
touch -- "$begun"
resume=()
[[ -e $image.wdpm-passes || -e $image.wdpm-journal ]] && resume=(--resume)
srun --no-kill --kill-on-bad-exit=0 {command} "${{resume[@]}}"
code=$?

# srun ends with the highest code of all tasks, a lost slave's as well: an image that was written since then tells that
# the master was done.
if [[ $image -nt $begun ]]; then
    [[ $code -ne 3 ]] && code=0  # 3: not as good as --until-error asked for
elif [[ $code -ge 75 && ${{SLURM_RESTART_COUNT:-0}} -lt {restarts} ]]; then
    scontrol requeue "$SLURM_JOB_ID"  # ended by a signal, or lost: the next run goes on from what is kept
fi
rm -f -- "$begun"
exit $code
"""


@dataclass(frozen=True)
class Job:
    """What a job asks Slurm for.

    Attributes:
        name: of the job.
        tasks: a master and its slaves.
        cores: of each task.
        memory: of each core [bytes]; None for the partition's default.
        time: limit, as Slurm has it (90, 4:00:00, 2-12); None for the partition's.
        partition: None for the default.
        grace: seconds before the time limit at which the render is asked to stop.
        restarts: most times that the script requeues its job.
    """

    name: str
    tasks: int
    cores: int
    memory: int | None = None
    time: str | None = None
    partition: str | None = None
    grace: int = 120
    restarts: int = 20


def job_script(job: Job, command: Sequence[str], image: Path) -> str:
    """The text of a script.

    Args:
        command: words of the command that each task runs.
        image: that tells by being there that the render is done.
    """
    asked = {
        "job-name": job.name,
        "ntasks": job.tasks,
        "cpus-per-task": job.cores,
        "mem-per-cpu": None if job.memory is None else f"{-(-job.memory // 1024)}K",
        "time": job.time,
        "partition": job.partition,
        "signal": f"TERM@{job.grace}",
        "open-mode": "append",
    }
    lines = [f"#SBATCH --{name}={value}" for name, value in asked.items() if value is not None]
    return _SCRIPT.format(
        directives="\n".join([*lines, "#SBATCH --requeue", "#SBATCH --no-kill"]),
        image=shlex.quote(_as_path(image)),
        command=shlex.join(command),
        restarts=job.restarts,
    )


def _as_path(path: Path) -> str:
    """A path that no command takes for an option."""
    return str(path) if path.is_absolute() else f"./{path}"
