"""The paper's table by simulation: its four scenes on as many machines as it had, and more, beside its own figures.

Xu et al. give, of each scene: how many times as fast four machines are as one, the most photons and triangles that one
of them holds as shares of all, and the error against the image of one machine. What this project knows of their figures
are the ranges over their scenes.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from wdpm.bench.simulation.figures import Run, Simulation
from wdpm.bench.simulation.plot import name_of
from wdpm.report.grid import Grid
from wdpm.report.tables import format_bytes

SCENES = ("cbox", "bunny", "sibenik", "sponza")
STAND_INS = ("cornell-box", "atrium:100k")
"""Where the paper's scenes are not there: they are not ours to ship."""

FOLDER = "WDPM_SCENES"
"""Environment variable that names the folder with them."""

SLAVES = (2, 4, 8, 16)

PAPER = {4: ("1.8-2.8", "0.33-0.34", "0.27-0.28", "1.5e-6 to 6.7e-5")}
"""Slaves -> speed-up, most photons, most triangles, error, over the paper's scenes."""


def paper_scenes() -> tuple[str, ...]:
    """The paper's scenes where they are, else what is built in."""
    folder = os.environ.get(FOLDER)
    files = [Path(folder) / name / "scene.xml" for name in SCENES] if folder else []
    there = tuple(str(file) for file in files if file.is_file())
    return there or STAND_INS


def grid(scenes: Sequence[Simulation]) -> Grid:
    """One table for all scenes."""
    columns = ("scene", "slaves", "copies", "speed-up*", "photons", "triangles", "error", "sent", "paper's")
    rows = tuple(_row(scene, run) for scene in scenes for run in scene.runs)
    notes = (
        f"* simulated: {scenes[0].hardware}." if scenes else "",
        "speed-up: over one machine without slaves. photons, triangles: the most that a slave holds, as shares of all, "
        "ghosts included. error: mean square of the beauty layer against one machine; 0: all bits are equal. paper's: "
        "speed-up, photons, triangles and error of its own four machines, over its scenes.",
    )
    return Grid("The paper's table, simulated", columns, rows, notes)


def _row(scene: Simulation, run: Run) -> tuple[str, ...]:
    own = PAPER.get(run.slaves)
    held = (f"{run.photons:.2f}", f"{run.triangles:.2f}")
    error = "0" if run.bits_equal else "DIFFER"
    theirs = "; ".join(own) if own and run.copies == "none" else "-"
    speed = f"{run.speed_up:.2f}*"
    return (name_of(scene.scene), f"{run.slaves}", run.copies, speed, *held, error, format_bytes(run.sent), theirs)
