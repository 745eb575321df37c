"""Every command on every page is understood, and runs: small, with stand-ins for files, or has a reason not to.

A new command needs nothing if it is one of those that are made small here (`smaller`); else write in NOT_RUN why it is
not run and which test runs its like.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from blocks_of_pages import PAGES, ROOT, Program, commands_of, name_of, programs_of, words_of

import wdpm
from wdpm.cli.main import main, make_parser
from wdpm.images.image import Image

NOT_RUN = {
    r"wdpm accuracy ": "renders for minutes; tests/accuracy/test_accuracy_command.py runs it small",
    r"wdpm bench (mitsuba|peers|caustic) ": "needs Mitsuba; tests/bench/test_bench_commands.py has its options",
    r"wdpm blender .* --wheels": "needs wheels of everything; tests/blender/test_extension.py writes such a file",
    r"wdpm master ": "waits for slaves; test_three_machines.py renders with them",
    r"wdpm slave ": "waits for a master; test_three_machines.py starts some",
    r"wdpm render .* --hosts ": "needs other machines; tests/placing/test_hosts.py and test_ssh.py stand in for them",
    r"wdpm render .* --frames ": "needs scenes that move; tests/cli/test_frames.py has some",
    r"wdpm status ": "asks a master that runs; tests/cluster/transport/test_status_query.py asks one",
    r"wdpm view ": "serves until it is interrupted; tests/view/test_commands.py opens it",
    r"wdpm render .* --(view|tev)": "needs somebody who looks; tests/view opens the page, and listens as tev does",
}
"""Commands that are not run, as patterns, and why."""

PROGRAMS_NOT_RUN = {
    "import mitsuba": "needs Mitsuba",
    "import numpy, openvdb": "needs OpenVDB",
    "distributed.Client": "needs a scheduler of Dask; make test-dask has one",
    "live=True": "needs a notebook; make test-notebook has one",
}
"""Programs that are not run, by a line of theirs, and why."""

OUTPUTS = ("-o", "--output", "--report", "--save-cache", "--heat")
SMALL = {
    "render": ["--photons", "500", "--caustic-photons", "500", "--threads", "1", "--quiet"],
    "inspect": ["--photons", "500"],
}
SCENE = """<scene version="3.0.0">
    <sensor type="perspective">
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film>
        <transform name="to_world"><lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
    <shape type="cube"/>
    <shape type="rectangle">
        <transform name="to_world"><lookat origin="0, 3, 1" target="0, 0, 0" up="0, 0, 1"/></transform>
        <emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>
</scene>"""

FIRST = {command: page for page in reversed(PAGES) for command in commands_of(page)}
"""The page that has a command first: it is run once."""

EVERY_COMMAND = pytest.mark.parametrize("command", FIRST, ids=lambda command: command[:90])
WITH_COMMANDS = [page for page in PAGES if page in FIRST.values()]
PROGRAMS = [program for page in PAGES for program in programs_of(page)]


@EVERY_COMMAND
def test_options_of_commands_exist(command: str) -> None:
    if {"--help", "--version"} & {*words_of(command)}:
        with pytest.raises(SystemExit) as done:
            make_parser().parse_args(words_of(command))
        assert done.value.code == 0
    else:
        assert callable(make_parser().parse_args(words_of(command)).run)


@pytest.mark.usefixtures("small_pilot")
@pytest.mark.parametrize("page", WITH_COMMANDS, ids=name_of)
def test_commands_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In their order, in one folder."""
    monkeypatch.chdir(tmp_path)
    # A copy: paths that climb out of the folder must end here, too, and not in what a build has left behind.
    shutil.copytree(ROOT / "docs" / "gallery", tmp_path / "docs" / "gallery")
    if "make_meshes.py" in page.read_text():
        make_meshes = tmp_path / "docs" / "gallery" / "make_meshes.py"
        subprocess.run([sys.executable, make_meshes, "out/gallery"], check=True)
    for command in commands_to_run(page):
        words = smaller(words_of(command))
        if {"--help", "--version"} & {*words}:
            continue  # the test above has seen them
        for name in inputs(words):
            put_stand_in(Path(name))
        assert main(words) in codes_of(words), f"{command}: mend it, or say in NOT_RUN why it is not run"
        for name in outputs(words):
            assert Path(name).stat().st_size > 0, command


def commands_to_run(page: Path) -> list[str]:
    """Each once. Renders that an earlier page has are left out; keys are made anew, as others of the page need them."""
    once: dict[tuple[str, ...], str] = {}
    for command in commands_of(page):
        once.setdefault(tuple(words_of(command)), command)
    wanted = [each for each in once.values() if not reason_for(each)]
    return [each for each in wanted if FIRST[each] == page or words_of(each)[0] == "keys"]


def smaller(words: list[str]) -> list[str]:
    """The same command with a small image, few photons and few samples."""
    words = ["atrium:10k" if word.startswith("atrium:") else word for word in words]
    words = [*words, *SMALL.get(words[0], [])]
    if words[0] != "render":
        return words
    if "cornell-box" not in words:
        words.append("--all-effects")  # the kernels that other tests have compiled
    if "--replay" in words:
        return [*words, "--size", "128x128", "--spp", "4"]
    words += ["--size", "16x16"]
    if "--slaves" in words:
        words += ["--slaves", "2"]
    if "--passes" in words:
        passes = int(words[words.index("--passes") + 1])
        words += ["--spp", words[words.index("--passes") + 1]] if passes <= 16 else ["--passes", "2", "--spp", "2"]
    elif "--until-error" in words:
        words += ["--until-error", "0.5", "--time-budget", "5"]
    elif "--time-budget" in words:
        words += ["--time-budget", "1"]
    else:
        words += ["--spp", "2"]
    return words


def inputs(words: list[str]) -> list[str]:
    """Files that a command reads."""
    written = {*outputs(words), *new_things(words)}
    return [word for word in words[1:] if re.search(r"\.(xml|glb|obj|stl|exr|records)$", word) and word not in written]


def outputs(words: list[str]) -> list[str]:
    """Files that a command writes."""
    if words[0] == "slurm":  # prints a script that will
        return []
    return [name for option, name in pairwise(words) if option in OUTPUTS]


def new_things(words: list[str]) -> list[str]:
    return words[1:2] if words[0] == "blender" else []


def codes_of(words: list[str]) -> set[int]:
    """Exit codes that are as they should be."""
    if words[0] in ("check", "doctor"):
        return {0, 1}  # 1: something was found
    return {0, 3} if {"--until-error", "--time-budget"} & {*words} else {0}


def reason_for(command: str) -> str | None:
    """Why a command is not run."""
    return next((reason for pattern, reason in NOT_RUN.items() if re.match(pattern, command)), None)


def put_stand_in(path: Path) -> None:
    """A small file of its kind, where there is none."""
    if path.exists():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".xml":
        path.write_text(SCENE)
    elif path.suffix == ".exr":
        Image({"beauty": np.ones((16, 16, 3), np.float32)}).save(path)
    else:
        trimesh.creation.box().export(path)


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.page)
def test_programs_run(program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if any(line in program.text for line in PROGRAMS_NOT_RUN):
        compile(program.text, program.page, "exec")
        return
    monkeypatch.chdir(tmp_path)
    for name in re.findall(r'"([\w/.-]+\.(?:xml|obj|exr))"', program.text):
        if f'save("{name}"' not in program.text:
            put_stand_in(Path(name))
    text = program.text.replace("128, 128", "16, 16").replace("100_000", "500").replace("250_000", "500")
    exec(compile(text, program.page, "exec"), {"wdpm": wdpm})


@pytest.mark.parametrize("pattern", NOT_RUN)
def test_reasons_are_still_needed(pattern: str) -> None:
    assert any(re.match(pattern, command) for command in FIRST)


@pytest.mark.parametrize("line", PROGRAMS_NOT_RUN)
def test_reasons_of_programs_are_still_needed(line: str) -> None:
    assert any(line in program.text for program in PROGRAMS)


@pytest.mark.parametrize("command", ["wdpm render scene.xml --no-such-option", "wdpm rendr scene.xml"])
def test_what_is_wrong_is_found(command: str) -> None:
    with pytest.raises(SystemExit) as error:
        make_parser().parse_args(words_of(command))
    assert error.value.code == 2


def test_stand_ins_are_what_they_stand_for(tmp_path: Path) -> None:
    for name in ("scene.xml", "room.glb", "model.obj"):
        put_stand_in(tmp_path / name)
        assert main(["inspect", str(tmp_path / name), "--photons", "500"]) == 0
