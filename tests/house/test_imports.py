"""Imports run one way, without circles: the contracts in pyproject.toml hold, and each finds what breaks it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LINT_IMPORTS = Path(sys.executable).with_name("lint-imports")

WRONG = [
    ("wings", "scenes/errors.py", "from wdpm.kernels.rays import bvh"),
    ("wings", "scenes/git_lfs.py", "from ..kernels.rays import bvh"),
    ("wings", "kernels/limits.py", "from wdpm import cluster"),
    ("wings", "cluster/batch.py", "def f():\n    from wdpm.cli.main import main"),
    ("wings", "cluster/runs.py", "from .. import api"),
    ("wings", "wdpm/progress.py", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from wdpm import api"),
    ("cluster", "cluster/batch.py", "from wdpm.cluster.master import machine"),
    ("kernels", "kernels/maths/random.py", "from wdpm.kernels.rays import bvh"),
    ("scenes", "scenes/model/scene.py", "from wdpm.scenes.mitsuba import read"),
    ("circles", "kernels/rays/triangle.py", "from wdpm.kernels.rays import bvh"),
    ("scenes-alone", "scenes/errors.py", "import warp as wp"),
    ("kernels-alone", "kernels/limits.py", "import zmq"),
    ("kernels-and-loaders", "kernels/limits.py", "from wdpm.scenes.load import load"),
    ("state-machines", "cluster/master/machine.py", "import time"),
    ("no-pickle", "wdpm/values.py", "import pickle"),
    ("one-name", "wdpm/values.py", "from kernels.rays import bvh"),
    ("state-machines", "cluster/slave/machine.py", "from wdpm.cluster.transport import registry"),
    ("network", "cluster/session.py", "import zmq"),
    ("network", "cluster/master/loop.py", "import zmq"),
    ("sockets", "cluster/session.py", "import socket"),
    ("wire", "wdpm/rendering/array_file.py", "import msgpack"),
    ("image-files", "wdpm/api.py", "import imageio"),
    ("pages", "wdpm/api.py", "import aiohttp"),
    ("blender", "wdpm/api.py", "import bpy"),
    ("dask", "wdpm/clusters.py", "import distributed"),
    ("metrics", "wdpm/api.py", "import prometheus_client"),
    ("draco", "wdpm/api.py", "import DracoPy"),
    ("meshes", "wdpm/api.py", "import trimesh"),
    ("terminal", "wdpm/api.py", "def f():\n    import rich"),
    ("warp", "wdpm/cli/main.py", "import warp"),
    ("processes", "wdpm/api.py", "import subprocess"),
    ("peers", "wdpm/api.py", "import scipy"),
]
"""The contract that it breaks, the file that it is written into, and the import."""

CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources as a clone has them, for tests to spoil."""
    folder = tmp_path_factory.mktemp("clone")
    shutil.copy(ROOT / "pyproject.toml", folder)
    for wing in ("scenes", "kernels", "cluster", "wdpm"):
        shutil.copytree(ROOT / wing, folder / wing, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def lint(folder: Path, *contracts: str) -> subprocess.CompletedProcess[str]:
    """Run the linter where it can see no other wdpm; all contracts if none is named."""
    command = [str(LINT_IMPORTS), "--no-cache", *(f"--contract={name}" for name in contracts)]
    alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | {"COLUMNS": "200"}
    return subprocess.run(command, cwd=folder, env=alone, capture_output=True, text=True, check=False)


def test_all_contracts_hold(copy: Path) -> None:
    done = lint(copy)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def told_of_all(copy: Path) -> dict[str, str]:
    """What the linter says of a tree with all wrong imports, contract by contract."""
    right = {copy / file: (copy / file).read_text() for _, file, _ in WRONG}
    for path, text in right.items():
        wrong = [line for _, file, line in WRONG if copy / file == path]
        path.write_text("\n".join([text, *wrong, ""]))
    try:
        done = lint(copy)
    finally:
        for path, text in right.items():
            path.write_text(text)
    assert done.returncode == 1, done.stdout + done.stderr
    pieces = re.split(r"^(.+)\n-+\n", done.stdout.partition("\nBroken contracts\n")[2], flags=re.MULTILINE)
    told = dict(zip(pieces[1::2], pieces[2::2], strict=True))
    return {contract["id"]: told.get(contract["name"], "") for contract in CONTRACTS}


@pytest.mark.parametrize(("contract", "file", "line"), WRONG)
def test_a_wrong_import_is_found(told_of_all: dict[str, str], contract: str, file: str, line: str) -> None:
    module = file.removesuffix(".py").rpartition("/")[2]
    assert f".{module} -> " in told_of_all[contract], line


def test_a_new_folder_must_be_given_its_layer(copy: Path) -> None:
    new = copy / "wdpm" / "attic"
    new.mkdir()
    (new / "__init__.py").touch()
    try:
        done = lint(copy, "wings")
    finally:
        shutil.rmtree(new)
    assert done.returncode == 1
    assert "wdpm.attic" in done.stdout


def test_every_contract_is_seen_to_fail() -> None:
    assert {contract["id"] for contract in CONTRACTS} == {name for name, _, _ in WRONG}


def test_make_lint_holds_them() -> None:
    lines = [line.strip() for line in (ROOT / "Makefile").read_text().split("\nlint:")[1].split("\n\n")[0].splitlines()]
    assert any(line.startswith("$(BIN)/lint-imports") for line in lines)
