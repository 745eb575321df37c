"""Completion, asked for as bash and zsh do it through argcomplete; and that nobody else waits for it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from wdpm.cli import main


def completions(line: str, folder: Path) -> list[str]:
    """What the shell would offer after a line."""
    out = folder / "completions"
    asked = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(out),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "COMP_TYPE": "9",
    }
    program = "from wdpm.cli.main import main; main([])"
    subprocess.run([sys.executable, "-c", program], env={**os.environ, **asked}, check=True, capture_output=True)
    return [each.strip() for each in out.read_text().split("\n") if each.strip()]


def test_commands_options_and_choices_are_offered(tmp_path: Path) -> None:
    pytest.importorskip("argcomplete", reason="argcomplete is not installed: see the extra completion")
    names = set(main.COMMANDS)
    assert set(completions("wdpm ", tmp_path)) >= names
    assert completions("wdpm doc", tmp_path) == ["doctor"]
    assert completions("wdpm render --until", tmp_path) == ["--until-error"]
    assert set(completions("wdpm render x.xml --metric ", tmp_path)) == {"relmse", "rmse"}


def test_without_the_library_nothing_happens(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(main.COMPLETING, "1")
    monkeypatch.setitem(sys.modules, "argcomplete", None)
    assert main.main([]) == 2
    assert "usage: wdpm" in capsys.readouterr().err


def test_nobody_else_waits_for_it() -> None:
    program = (
        "import sys; from wdpm.cli.main import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "assert not {'argcomplete', 'warp', 'IPython', 'aiohttp', 'trimesh'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)
