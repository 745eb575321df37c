"""Commands as a shell sees them: what they end with, and the one line that says what is wrong."""

from __future__ import annotations

import pytest

from wdpm.cli.main import main


def exit_code(words: list[str]) -> int:
    """Whoever finds a mistake: the parser exits by itself."""
    try:
        return main(words)
    except SystemExit as stop:
        return int(stop.code or 0)


def refusal(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What a command says that is refused: one line on standard error, nothing on standard output, exit code 2."""
    capsys.readouterr()
    assert exit_code(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    [line] = err.splitlines()
    assert line.startswith("wdpm: error: ")
    return line
