"""The handshake's digest covers all code that a slave runs, so that slaves with any other are refused."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from wdpm.cluster.master import events
from wdpm.cluster.master.machine import Master
from wdpm.cluster.messages import protocol
from wdpm.cluster.versions import CODE, digest_of_code, versions
from wdpm.scenes.errors import ClusterError

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The code of a slave, for tests to change."""
    for name in CODE:
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def code_files(root: Path) -> list[Path]:
    """What may be imported, however deep it lies."""
    return [
        Path(folder, file)
        for name in CODE
        for folder, _, files in os.walk(root / name)
        for file in files
        if file.endswith(".py")
    ]


def test_a_copy_has_the_same_digest(copy: Path) -> None:
    assert digest_of_code(copy) == versions()["wdpm code"]


def test_one_byte_of_any_file_changes_it(copy: Path) -> None:
    files = code_files(copy)
    assert len(files) > 150
    assert {copy / "kernels/rays/bvh.py", copy / "cluster/work/cell.py", copy / "scenes/flat/areas.py"} <= set(files)
    seen = {digest_of_code(copy)}
    for path in files:
        right = path.read_bytes()
        path.write_bytes(bytes([right[0] ^ 1]) + right[1:] if right else b"#")
        seen.add(digest_of_code(copy))
        path.write_bytes(right)
    assert len(seen) == len(files) + 1


def test_files_that_come_go_or_move_change_it(copy: Path) -> None:
    seen = {digest_of_code(copy)}
    (copy / "kernels" / "rays" / "sphere.py").write_text("")
    seen.add(digest_of_code(copy))
    (copy / "kernels" / "rays" / "sphere.py").rename(copy / "kernels" / "sphere.py")
    seen.add(digest_of_code(copy))
    (copy / "kernels" / "sphere.py").unlink()
    (copy / "kernels" / "limits.py").unlink()
    seen.add(digest_of_code(copy))
    assert len(seen) == 4


def test_what_python_leaves_behind_does_not(copy: Path) -> None:
    before = digest_of_code(copy)
    (copy / "kernels" / "__pycache__").mkdir()
    (copy / "kernels" / "__pycache__" / "limits.cpython-311.pyc").write_bytes(b"\0")
    assert digest_of_code(copy) == before


def test_no_code_is_no_digest(copy: Path) -> None:
    """Else all installations whose files cannot be seen would agree."""
    shutil.rmtree(copy / "kernels")
    with pytest.raises(ClusterError, match="expected the code of wdpm"):
        digest_of_code(copy)


def test_a_slave_with_another_digest_is_refused(copy: Path) -> None:
    with (copy / "kernels" / "rays" / "bvh.py").open("a") as file:
        file.write("\n")
    other = {**versions(), "wdpm code": digest_of_code(copy)}

    def answer(agreed: dict[str, str]) -> object:
        hello = protocol.Hello(agreed, "host", 1, 1, 0, "tcp://127.0.0.1:9")
        out = Master(2, versions()).handle(events.SlaveSaid(b"a", hello), 0.0)
        [message] = [each.message for each in out if isinstance(each, events.Send)]
        return message

    assert isinstance(answer(versions()), protocol.Welcome)
    refusal = answer(other)
    assert isinstance(refusal, protocol.Refuse)
    assert f"wdpm code: master {versions()['wdpm code']}, slave {other['wdpm code']}" in refusal.reason
