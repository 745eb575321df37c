"""`wdpm keys`."""

from __future__ import annotations

from pathlib import Path

import pytest

from wdpm.cli.main import main as run


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_keys_for_a_master_and_its_slaves(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["keys", "ours"]) == 0
    assert run(["keys", "add", "ours", "anna", "bert"]) == 0
    assert "wrote ours/slaves/bert.key\nwrote ours/bert\n" in capsys.readouterr().out
    names = {path.name for path in Path("ours").iterdir()}
    assert names == {"master.key", "master.key_secret", "slaves", "anna", "bert"}


@pytest.mark.parametrize("words", [["add"], ["add", "ours"], ["ours", "anna"]])
def test_keys_for_nobody(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["keys", *words]) == 2
    assert "expected a FOLDER, or: add FOLDER NAME..." in capsys.readouterr().err


def test_keys_are_made_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "keys"
    assert run(["keys", str(folder)]) == 0
    written = [line.removeprefix("wrote ") for line in capsys.readouterr().out.splitlines()]
    assert sorted(written) == sorted(str(path) for path in folder.iterdir() if path.is_file())
    assert run(["keys", str(folder)]) == 2
    assert "exists already" in capsys.readouterr().err
