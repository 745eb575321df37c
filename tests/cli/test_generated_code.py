"""Code that dataclasses write is what it would be without a file that keeps it."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from pathlib import Path
from types import CodeType
from typing import Any

import pytest

from wdpm import generated_code
from wdpm.generated_code import GeneratedCode

COUNTED = """
from wdpm.cli.main import main
import wdpm.cluster.render_settings, wdpm.cluster.messages.protocol
from wdpm import generated_code
from wdpm.cluster.render_settings import RenderSettings
code = generated_code._CODE
generated_code.write_generated_code()
compiled = code._used.keys() - code._kept.keys()
print("COMPILED", len(compiled), len(code._used), RenderSettings(spp=3) == RenderSettings(spp=3), RenderSettings(spp=3))
"""


def counted(folder: Path, **changed: str) -> list[str]:
    """What a process says that imports many dataclasses, with its compiled files in a folder."""
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(folder), **changed}
    if "PYTHONDONTWRITEBYTECODE" not in changed:
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
    told = subprocess.run([sys.executable, "-c", COUNTED], capture_output=True, text=True, check=True, env=environment)
    [line] = [line for line in told.stdout.splitlines() if line.startswith("COMPILED")]
    return line.split(maxsplit=2)


def test_a_second_process_compiles_none_and_has_the_same_classes(tmp_path: Path) -> None:
    _, compiled, classes = counted(tmp_path)
    assert int(compiled) > 100
    assert counted(tmp_path) == ["COMPILED", "0", classes]
    assert len(list(tmp_path.rglob(f"*{generated_code.SUFFIX}"))) == 1


def test_where_python_keeps_no_compiled_files_nothing_is_kept(tmp_path: Path) -> None:
    assert int(counted(tmp_path, PYTHONDONTWRITEBYTECODE="1")[1]) > 100
    assert not list(tmp_path.rglob("*"))


def run(code: GeneratedCode, text: str) -> Any:
    """What a text sets `x` to."""
    found: dict[str, Any] = {}
    code.execute(text, {}, found)
    return found["x"]


@pytest.mark.parametrize("spoil", [lambda b: b[:-3], lambda b: b[:0], lambda b: b"\0" + b[1:], lambda b: b + b"."])
def test_a_file_that_is_spoilt_is_as_none(spoil: Any, tmp_path: Path) -> None:
    file = tmp_path / "kept"
    first = GeneratedCode(file)
    assert run(first, "x = 1 + 1") == 2
    first.write()
    assert list(GeneratedCode(file)._kept) == ["x = 1 + 1"]
    file.write_bytes(spoil(file.read_bytes()))
    spoilt = GeneratedCode(file)
    assert not spoilt._kept
    assert run(spoilt, "x = 1 + 1") == 2
    spoilt.write()
    assert list(GeneratedCode(file)._kept) == ["x = 1 + 1"]


def test_texts_of_other_commands_are_kept_until_there_are_too_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "kept"
    for number in range(2):
        code = GeneratedCode(file)
        assert run(code, f"x = {number}") == number
        code.write()
    assert list(GeneratedCode(file)._kept) == ["x = 0", "x = 1"]
    monkeypatch.setattr(generated_code, "MOST_BYTES", 0)
    code = GeneratedCode(file)
    assert run(code, "x = 0") == 0
    assert run(code, "x = 2") == 2
    code.write()
    assert list(GeneratedCode(file)._kept) == ["x = 0", "x = 2"]


def test_nothing_is_written_that_is_not_new(tmp_path: Path) -> None:
    file = tmp_path / "kept"
    code = GeneratedCode(file)
    run(code, "x = 0")
    code.write()
    file.unlink()
    code.write()
    run(code, "x = 0")
    code.write()
    assert not file.exists()


def test_a_folder_that_refuses_changes_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    code = GeneratedCode(tmp_path / "file" / "kept")
    assert run(code, "x = 7") == 7
    code.write()
    assert (tmp_path / "file").read_text() == "no folder"


def test_code_objects_are_run_as_they_are() -> None:
    code = GeneratedCode(None)
    compiled: CodeType = compile("x = 5", "a file", "exec")
    found: dict[str, Any] = {}
    code.execute(compiled, {}, found)
    code.write()
    assert found["x"] == 5


def test_dataclasses_ask_us_in_a_command() -> None:
    """The tests of commands have imported one."""
    import wdpm.cli  # noqa: F401

    assert vars(dataclasses)["exec"].__self__ is generated_code._CODE
