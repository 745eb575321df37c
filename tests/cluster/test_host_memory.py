"""How much memory a slave takes itself to have: its machine's, or what its container allows it."""

from __future__ import annotations

from pathlib import Path

from wdpm.cluster.host_memory import _control_group_limits, machine_memory


def group(folder: Path, name: str, limit: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(limit + "\n")


def test_limits_of_groups_of_version_2(tmp_path: Path) -> None:
    mounted, membership = tmp_path / "cgroup", tmp_path / "membership"
    membership.write_text("0::/jobs/job7/step0\n")
    group(mounted / "jobs/job7/step0", "memory.max", "max")
    group(mounted / "jobs/job7", "memory.max", "4294967296")
    group(mounted / "other", "memory.max", "1")
    group(tmp_path, "memory.max", "2")
    assert _control_group_limits(membership, mounted) == [4 << 30]


def test_limits_of_groups_of_version_1(tmp_path: Path) -> None:
    mounted, membership = tmp_path / "cgroup", tmp_path / "membership"
    membership.write_text("5:cpu,cpuacct:/a\n4:memory:/docker/abc\n1:name=systemd:/b\n")
    group(mounted / "memory", "memory.limit_in_bytes", "1073741824")
    group(mounted / "cpu/a", "memory.limit_in_bytes", "3")
    assert _control_group_limits(membership, mounted) == [1 << 30]


def test_nothing_limits_where_there_are_no_groups(tmp_path: Path) -> None:
    assert _control_group_limits(tmp_path / "none", tmp_path) == []
    assert machine_memory() > 1 << 28
