"""docs/protocol.md is the norm: it must name every message with its fields, and no other."""

from __future__ import annotations

import re
import typing
from dataclasses import fields
from pathlib import Path

import pytest

from wdpm.cluster import allotment, lit_places, records, task, world
from wdpm.cluster.batch import SCHEMAS, TO_HOME, Batch, Kind
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.messages.frames import FRAME_BYTES
from wdpm.cluster.runs import Runs
from wdpm.scenes.flat.arrays import Media, Triangles
from wdpm.scenes.flat.material_table import MaterialTable

PAGE = (Path(__file__).parents[3] / "docs" / "protocol.md").read_text()


def table(heading: str) -> dict[str, list[str]]:
    """Names of the fields of each row of a section's table."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (\w+) \| ([^|]*)\|", section, re.MULTILINE)
    return {name: re.findall(r"(?:^|; )(\w+):", described) for name, described in rows if name[0].isupper()}


@pytest.mark.parametrize(
    ("heading", "union"),
    [
        ("Messages from a slave to the master", protocol.FromSlave),
        ("Messages from the master to a slave", protocol.FromMaster),
        ("Messages between slaves", protocol.FromPeer | protocol.ToPeer),
        ("Messages of those who only look", protocol.FromReader | protocol.ToReader),
    ],
)
def test_messages_are_as_described(heading: str, union: object) -> None:
    actual = {message.__name__: [field.name for field in fields(message)] for message in typing.get_args(union)}
    assert table(heading) == actual


@pytest.mark.parametrize(
    "record",
    [
        protocol.Copy,
        protocol.SlaveStatus,
        task.PhotonTask,
        task.RecordTask,
        task.RecordsMade,
        records.Records,
        records.CachePlan,
        task.BucketTask,
        task.PhotonsTraced,
        task.BucketRendered,
        Batch,
        Runs,
        Triangles,
        world.World,
        world.TopTree,
        world.Outlines,
        world.View,
        allotment.LampOutlines,
        lit_places.LitPlaces,
        world.MapPlan,
        world.PhotonPlan,
        world.IrradiancePlan,
        world.Emission,
        world.Steering,
        MaterialTable,
        Media,
    ],
)
def test_records_are_as_described(record: type) -> None:
    assert table("Records")[record.__name__] == [field.name for field in fields(record)]


def test_every_kind_of_batch_is_described_with_where_it_goes() -> None:
    section = PAGE.split("| kind of batch | goes to | what it is |\n")[1].split("\n\n")[0]
    rows = re.findall(r"^\| ([a-z_, ]+) \| (cell|home) \|", section, re.MULTILINE)
    described = {kind: goes_to for kinds, goes_to in rows for kind in kinds.split(", ")}
    assert described == {kind.value: "home" if kind in TO_HOME else "cell" for kind in Kind}


def test_arrays_of_every_kind_of_batch_are_as_described() -> None:
    section = PAGE.split("| arrays of a batch | fields, in the order in which they travel |\n")[1].split("\n\n")[0]
    rows = re.findall(r"^\| ([a-z_, ]+) \| ([^|]*) \|$", section, re.MULTILINE)
    described = {
        kind: re.findall(r"(\w+): `(<\w\d)` \[(N[^]]*)\]", fields_in_words)
        for kinds, fields_in_words in rows
        for kind in kinds.split(", ")
    }
    actual = {
        kind.value: [
            (name, field.dtype, ", ".join(["N", *(str(length) for length in field.shape)]))
            for name, field in SCHEMAS[kind].items()
        ]
        for kind in Kind
    }
    assert described == actual


def test_numbers_are_as_described() -> None:
    limits = ClusterLimits()
    assert PAGE.startswith(f"# The protocol of a wdpm cluster, version {protocol.PROTOCOL}\n")
    assert f"the version of this protocol ({protocol.PROTOCOL})" in PAGE
    for row in (
        f"| header | {packing.HEADER_BYTES >> 20} MiB |",
        f"| header of someone who has not been welcomed | {packing.STRANGER_BYTES >> 10} KiB, ",
        f"| frames of a message | {packing.MOST_FRAMES:,} |",
        f"| frame | {FRAME_BYTES >> 20} MiB (",
        f"| triangles of one Partition | {limits.part_triangles:,} (",
        f"| cells on their way at once | {limits.cells_in_flight} |",
        f"| photon tasks in flight for each slave | {limits.photon_tasks_in_flight} |",
        f"| buckets in flight for each slave | {limits.buckets_in_flight} |",
        f"| tasks in flight for each slave that holds a part of the scene | {limits.shared_in_flight} |",
    ):
        assert row in PAGE
