"""Every message survives the wire; nothing that is not a message gets through it, and nothing makes it crash."""

from __future__ import annotations

import contextlib
import dataclasses
import typing
from collections.abc import Iterator
from typing import Any

import msgpack
import numpy as np
import pytest
from fake_worker import arrays, irradiance_records, make_view, make_world, picture, record_task, triangles
from hypothesis import given, settings
from hypothesis import strategies as st

from wdpm.cluster.allotment import LampOutlines
from wdpm.cluster.batch import SCHEMAS, TO_HOME, Batch, Kind
from wdpm.cluster.lit_places import LitPlaces
from wdpm.cluster.messages import packing
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.messages.batch_checks import LARGEST_NUMBER
from wdpm.cluster.runs import Runs
from wdpm.cluster.task import BucketTask, PhotonsTraced, PhotonTask, RecordsMade, RecordTask
from wdpm.cluster.world import IrradiancePlan, MapPlan, Outlines, TopTree, View, World
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.light_table import LightTable
from wdpm.scenes.flat.material_table import MaterialTable

ALL = packing.by_name(p.Message)

counts = st.integers(0, 2**31 - 1)
texts = st.text(max_size=30).map(packing.printable)
endpoints = st.integers(1, 65535).map(lambda port: f"tcp://10.0.0.1:{port}")
epochs = st.integers(0, 2**62)
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=5,
)


def batch_of(kind: Kind, cell: int, whose: set[tuple[int, int]], counts: list[tuple[int, int]]) -> Batch:
    """A batch of some tasks' rows; those that go to a home go to one."""
    home = min(whose)[0]
    tasks = sorted({(home if kind in TO_HOME else other, task) for other, task in whose})
    rows = [0 if kind is Kind.ENDED else count for count, _ in counts]
    table = [[*task, rows[place], counts[place][1]] for place, task in enumerate(tasks)]
    return Batch(kind, cell, Runs(np.array(table, np.int64)), arrays(kind, sum(rows[: len(tasks)])))


batches = st.builds(
    batch_of,
    st.sampled_from(Kind),
    counts,
    st.sets(st.tuples(st.integers(0, 3), st.integers(-1, 1000)), min_size=1, max_size=4),
    st.lists(st.tuples(st.integers(0, 5) | st.just(150), st.integers(0, LARGEST_NUMBER - 1)), min_size=4, max_size=4),
)
views = st.builds(make_view, st.integers(1, 4000), st.integers(1, 4000), st.integers(1, 64), counts)
tasks = (
    st.builds(lambda n, a, b: PhotonTask(n, a, a + b), counts, epochs, st.integers(1, 10**6))
    | st.builds(
        lambda n, x, y, w, h: BucketTask(n, x, y, x + w, y + h),
        counts,
        *[st.integers(0, 9999)] * 2,
        *[st.integers(1, 64)] * 2,
    )
    | st.builds(record_task, counts, st.integers(0, 9), st.sets(st.integers(0, 9999), min_size=1), st.booleans())
)
records = st.builds(irradiance_records, st.integers(0, 5))
results = (
    st.builds(lambda n, r, made: RecordsMade(n, r, made, 4 * len(made)), counts, st.integers(0, 9), records)
    | st.builds(PhotonsTraced, counts, counts, st.floats(0, 1e30))
    | st.builds(picture, views.filter(lambda view: view.camera.width * view.camera.height < 10_000))
)

seconds = st.floats(0.0, 1e6)
vitals = st.builds(p.Vitals, counts, seconds, seconds, seconds)
slaves_seen = st.builds(
    p.SlaveStatus,
    counts,
    texts,
    *[counts] * 4,
    st.integers(-1, 99),
    *[counts] * 3,
    seconds,
    seconds,
    st.none() | vitals,
)


def outlined(world: World, boxes: int) -> World:
    """The world, with so many boxes in each cell, the first of them with a plane; 0: nothing is known."""
    if not boxes:
        return world
    tree, cells = world.top_tree, world.top_tree.cells
    plane = np.full(cells * boxes, -1, np.int32)
    plane[::boxes] = np.arange(cells)
    first = np.arange(cells + 1, dtype=np.int32) * np.int32(boxes)
    corner = np.zeros((cells * boxes, 3), np.float32)
    normal, slab = np.tile([0.0, 0.0, 1.0], (cells, 1)), np.tile([-1.0, 1.0, 9.0], (cells, 1))
    outlines = Outlines(first, corner, corner + np.float32(1), plane, normal, slab)
    return dataclasses.replace(world, top_tree=dataclasses.replace(tree, outlines=outlines))


def wrong_outlines() -> Iterator[tuple[TopTree, str]]:
    """Top trees whose outlines can't be used, and what is said of them."""
    known = (tree := outlined(make_world(2), 2).top_tree).outlines
    changes: list[tuple[dict[str, Any], str]] = [
        ({"first": known.first[:-1]}, "not in order, or not 4"),
        ({"first": np.array([0, 3, 2, 4], np.int32)}, "not in order"),
        ({"first": np.array([0, 1, 2, 3, 4], np.int32)}, "outlines of 4 cells; there are 2"),
        ({"low": known.high + np.float32(1)}, "a box ends before it begins"),
        ({"high": np.full_like(known.high, np.inf)}, "high has a value that is no number"),
        ({"slab": known.slab * [-1.0, -1.0, 1.0]}, "a slab ends before it begins"),
        ({"normal": np.full_like(known.normal, np.nan)}, "normal has a value that is no number"),
        ({"plane": known.plane + np.int32(1)}, "plane is 0 to 2"),
        ({"plane": known.plane[:3]}, "plane has shape"),
    ]
    for fields, message in changes:
        yield dataclasses.replace(tree, outlines=dataclasses.replace(known, **fields)), message


MESSAGES: dict[type, st.SearchStrategy[Any]] = {
    p.Hello: st.builds(p.Hello, st.dictionaries(texts, texts, max_size=4), texts, counts, counts, epochs, endpoints),
    p.PartitionReceived: st.builds(p.PartitionReceived, epochs, counts),
    p.Ready: st.builds(p.Ready, epochs),
    p.TaskDone: st.builds(p.TaskDone, epochs, results),
    p.Vitals: vitals,
    p.MapsBuilt: st.builds(p.MapsBuilt, epochs, st.dictionaries(texts, plain, max_size=4)),
    p.ViewSet: st.builds(p.ViewSet, epochs),
    p.RecordsSet: st.builds(p.RecordsSet, epochs),
    p.PhotonsForgotten: st.builds(p.PhotonsForgotten, epochs),
    p.Statistics: st.builds(p.Statistics, epochs, st.dictionaries(texts, plain, max_size=4)),
    p.PeerGone: st.builds(p.PeerGone, counts),
    p.PeerUnreachable: st.builds(p.PeerUnreachable, counts, texts),
    p.Note: st.builds(p.Note, texts),
    p.Failed: st.builds(p.Failed, texts),
    p.Goodbye: st.builds(p.Goodbye, texts),
    p.Heartbeat: st.builds(p.Heartbeat, counts),
    p.Rejected: st.builds(p.Rejected, texts),
    p.Welcome: st.builds(p.Welcome, counts, texts, st.floats(0.1, 10), st.floats(0.1, 100)),
    p.Refuse: st.builds(p.Refuse, texts),
    p.Setup: st.builds(
        lambda epoch, levels, boxes, holders, peers, kept, scene: p.Setup(
            epoch, outlined(make_world(1 << levels), boxes), tuple(holders), tuple(peers), tuple(kept), scene
        ),
        epochs,
        st.integers(0, 4),
        st.integers(0, 3),
        st.lists(counts, max_size=4),
        st.lists(endpoints | st.just(""), max_size=4),
        st.lists(counts, max_size=4),
        texts,
    ),
    p.Partition: st.builds(
        lambda epoch, cell, part, more, count: p.Partition(epoch, cell, part, part + more, triangles(count)),
        epochs,
        counts,
        st.integers(0, 9),
        st.integers(1, 9),
        st.integers(0, 20),
    ),
    p.StartTask: st.builds(p.StartTask, epochs, tasks),
    p.BuildMaps: st.builds(
        lambda epoch, copies, awaited, part, more, divided: p.BuildMaps(
            epoch, tuple(copies), awaited, part, part + more, np.zeros((divided * (part + more), 2, 3), np.float32)
        ),
        epochs,
        st.lists(st.builds(p.Copy, counts, counts, epochs, endpoints), max_size=4),
        counts,
        st.integers(0, 9),
        st.integers(1, 9),
        st.booleans(),
    ),
    p.Dismissed: st.builds(p.Dismissed, texts),
    p.SetView: st.builds(p.SetView, epochs, views),
    p.SetRecords: st.builds(p.SetRecords, epochs, records),
    p.ForgetPhotons: st.builds(lambda epoch: p.ForgetPhotons(epoch, make_world(1).photon_plan), epochs),
    **{kind: st.builds(kind, epochs) for kind in (p.AwaitRecords, p.ReadStatistics)},
    p.Stop: st.builds(p.Stop, texts, st.booleans()),
    p.PeerHello: st.builds(p.PeerHello, texts, counts),
    **{kind: st.builds(kind, counts) for kind in (p.PeerWelcome, p.PeerReceived)},
    p.PeerBatches: st.builds(p.PeerBatches, epochs, st.lists(batches, max_size=3).map(tuple)),
    p.AskStatus: st.just(p.AskStatus()),
    p.StatusReport: st.builds(
        p.StatusReport, texts, *[counts] * 2, seconds, *[counts] * 7, st.lists(slaves_seen, max_size=3).map(tuple)
    ),
}


def on_outlines(pixel: int, times: int = 3) -> LampOutlines:
    return LampOutlines(np.array([pixel], np.int32), times)


def lit_places(count: int, power: float = 1.0, radius: float = 1.0) -> LitPlaces:
    nowhere = np.zeros((count, 3), np.float32)
    return LitPlaces(nowhere, nowhere, np.full(count, power, np.float32), np.full(count, radius, np.float32))


def same(a: Any, b: Any) -> bool:
    """Whether two values are equal through and through; arrays by type, shape and bits."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and (a.dtype, a.shape) == (b.dtype, b.shape) and a.tobytes() == b.tobytes()
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list):
        return isinstance(b, type(a)) and len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and bool(a == b)


def decode_or_reject(frames: Any) -> None:
    """What is damaged may still be a message, as after a flipped bit of an array. Any other error is a failure."""
    with contextlib.suppress(ProtocolError):
        packing.decode(frames, ALL)


def test_every_message_is_tried() -> None:
    assert set(MESSAGES) == set(typing.get_args(p.Message))


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.__name__)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_round_trip(message: type, data: st.DataObject) -> None:
    sent = data.draw(MESSAGES[message])
    frames = packing.encode(sent)
    assert same(packing.decode([bytes(frame) for frame in frames], ALL), sent)


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_a_damaged_message_is_a_protocol_error(data: st.DataObject) -> None:
    message = data.draw(st.one_of(*MESSAGES.values()))
    frames = [bytearray(frame) for frame in packing.encode(message)]
    for _ in range(data.draw(st.integers(1, 3))):
        index = data.draw(st.integers(0, len(frames) - 1)) if frames else 0
        match data.draw(st.sampled_from(["drop", "repeat", "cut", "flip", "grow"])):
            case "drop" if frames:
                del frames[index]
            case "repeat" if frames:
                frames.insert(index, bytearray(frames[index]))
            case "cut" if frames and frames[index]:
                del frames[index][data.draw(st.integers(0, len(frames[index]) - 1)) :]
            case "flip" if frames and frames[index]:
                frames[index][data.draw(st.integers(0, len(frames[index]) - 1))] ^= data.draw(st.integers(1, 255))
            case "grow":
                frames.append(bytearray(data.draw(st.binary(max_size=8))))
    decode_or_reject(frames)


@settings(max_examples=200, deadline=None)
@given(
    st.sampled_from(sorted(ALL)),
    st.lists(plain | st.binary(max_size=9), max_size=8),
    st.lists(st.binary(max_size=9), max_size=3),
)
def test_a_right_header_with_wrong_fields_is_a_protocol_error(name: str, values: list[Any], more: list[bytes]) -> None:
    frames = [msgpack.packb([packing.MAGIC, p.PROTOCOL, name, values]), *more]
    decode_or_reject(frames)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.binary(max_size=40), max_size=4))
def test_random_bytes_are_a_protocol_error(frames: list[bytes]) -> None:
    with pytest.raises(ProtocolError):
        packing.decode(frames, ALL)


def header(*fields: Any) -> bytes:
    return bytes(msgpack.packb(list(fields)))


PLAN = make_world(1).photon_plan
BATCH = p.PeerBatches(1, (Batch.of_task(Kind.LIT, 1, 0, 0, 1, arrays(Kind.LIT, 2)),))


@pytest.mark.parametrize(
    ("frames", "reason"),
    [
        ([], "without frames"),
        ([b"\xc1"], "not msgpack"),
        ([b"\x91" * 2000], "not msgpack"),
        ([bytes(packing.HEADER_BYTES + 1)], "at most"),
        ([header(1, 2)], "not a message of wdpm"),
        ([header(b"wdpn", 1, "Ready", [1])], "not a message of wdpm"),
        ([header(packing.MAGIC, p.PROTOCOL + 1, "Ready", [1])], "install the same wdpm"),
        ([header(packing.MAGIC, p.PROTOCOL, 5, [1])], "name of a message"),
        ([header(packing.MAGIC, p.PROTOCOL, "Eval", ["1"])], "not known here"),
        ([header(packing.MAGIC, p.PROTOCOL, "Ready", [])], "not a list of 1 fields"),
        ([header(packing.MAGIC, p.PROTOCOL, "Ready", [True])], "expected int"),
        ([header(packing.MAGIC, p.PROTOCOL, "Ready", [2**63])], "64 bits"),
        ([header(packing.MAGIC, p.PROTOCOL, "Ready", [1]), b"x"], "1 frames too many"),
        (
            [header(packing.MAGIC, p.PROTOCOL, "StartTask", [1, ["Task", [1]]])],
            "expected PhotonTask or RecordTask or BucketTask",
        ),
        ([header(packing.MAGIC, p.PROTOCOL, "StartTask", [1, ["PhotonTask", [1, 5, 5]]])], "no range of paths"),
        ([header(packing.MAGIC, p.PROTOCOL, "Statistics", [1, {"a": [[[[[[[1]]]]]]]}])], "nested"),
    ],
)
def test_the_reason_is_told(frames: list[bytes], reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason):
        packing.decode(frames, ALL)


def replaced(**fields: Any) -> p.PeerBatches:
    return p.PeerBatches(1, (dataclasses.replace(BATCH.batches[0], **fields),))


def runs(*table: list[int]) -> Runs:
    return Runs(np.array(table, np.int64))


def setup(**fields: Any) -> p.Setup:
    return p.Setup(1, dataclasses.replace(make_world(1), **fields), (), ())


def materials(**fields: Any) -> MaterialTable:
    return dataclasses.replace(make_world(1).materials, **fields)


def lights(**fields: Any) -> LightTable:
    return dataclasses.replace(make_world(1).lights, **fields)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (replaced(runs=Runs.one(0, 1, 2, -1)), "below 0"),
        (replaced(runs=Runs.one(0, 1, -2, 1)), "numbers from -2"),
        (replaced(runs=Runs.one(0, 1, 2, LARGEST_NUMBER)), "numbers from 0 to"),
        (replaced(runs=Runs.one(0, 1, 3, 1)), "runs of 3 rows; there are 2"),
        (replaced(runs=runs([0, 1, 1, 1], [0, 1, 1, 1])), "not in the order"),
        (replaced(runs=runs([1, 1, 1, 1], [0, 2, 1, 1])), "not in the order"),
        (replaced(runs=runs([0, 1, 1, 1], [1, 1, 1, 1])), "results for several homes"),
        (replaced(runs=runs([0, 1, 1, 1], [0, 2, 1, 1])), None),
        (replaced(runs=Runs(np.zeros((0, 4), np.int64))), "without a run"),
        (replaced(runs=Runs(np.zeros((1, 5), np.int64))), "runs.table is of shape"),
        (replaced(runs=Runs(np.zeros(4, np.int64))), "runs.table is of shape"),
        (p.Partition(1, 0, 1, 1, triangles(1)), "part 1 of 1"),
        (p.Partition(1, 0, 0, 1, dataclasses.replace(triangles(2), uvs=np.zeros((1, 3, 2), np.float32))), "uvs"),
        (p.Partition(1, 0, 0, 1, dataclasses.replace(triangles(2), uvs=np.zeros((2, 6), np.float32))), "uvs"),
        (setup(top_tree=TopTree(np.zeros(2, np.int32), np.zeros(2, np.float32))), "power of two"),
        (setup(top_tree=TopTree(np.full(1, 3, np.int32), np.zeros(1, np.float32))), "axis"),
        (setup(top_tree=outlined(make_world(2), 2).top_tree), None),
        *((setup(top_tree=tree), message) for tree, message in wrong_outlines()),
        (setup(textures=make_world(1).textures[:1]), None),
        (setup(textures=()), "materials.texture is -1 to 0"),
        (setup(global_map=MapPlan(10, float("nan"), 1.0)), "no plan of a map"),
        (setup(volume_map=MapPlan(10, 1.0, -1.0)), "no plan of a map"),
        (setup(irradiance=IrradiancePlan(4, 0, 1, 1.0)), "no plan of irradiance"),
        (setup(irradiance=IrradiancePlan(4, 1, 0, 1.0)), "no plan of irradiance"),
        (setup(irradiance=IrradiancePlan(4, 1, 1, 1.0, -1)), "no plan of irradiance"),
        (p.ForgetPhotons(1, dataclasses.replace(PLAN, seed=-1)), "seed -1"),
        (p.ForgetPhotons(1, dataclasses.replace(PLAN, volume_unit=0.0)), "volume_unit 0.0"),
        (p.ForgetPhotons(1, dataclasses.replace(PLAN, caustic_map=MapPlan(-1))), "no plan of a map"),
        (p.SetView(1, dataclasses.replace(make_view(), first_sample=-1)), "samples -1 to"),
        (p.SetView(1, dataclasses.replace(make_view(), lit_places=lit_places(1))), None),
        (p.SetView(1, dataclasses.replace(make_view(), lit_places=lit_places(1, radius=0.0))), "lit places that are"),
        (p.SetView(1, dataclasses.replace(make_view(), lit_places=lit_places(1, power=np.inf))), "lit places that are"),
        (p.SetView(1, dataclasses.replace(make_view(), first_sample=2**31 - 1)), "samples 2147483647 to"),
        (p.SetView(1, dataclasses.replace(make_view(), outlines=on_outlines(50 * 34 - 1))), None),
        (p.SetView(1, dataclasses.replace(make_view(), outlines=on_outlines(50 * 34))), "outlines.pixels is 1700"),
        (p.SetView(1, dataclasses.replace(make_view(), outlines=on_outlines(0, 0))), "0 times the samples"),
        (
            p.SetView(1, dataclasses.replace(make_view(), first_sample=2**30, outlines=on_outlines(0, 2))),
            "samples 10737",
        ),
        (
            setup(emission=dataclasses.replace(make_world(1).emission, share=np.ones(2), caustic_share=np.ones(2))),
            "shares",
        ),
        (setup(emission=dataclasses.replace(make_world(1).emission, share=np.ones(2))), "caustic_share"),
        (setup(media=dataclasses.replace(make_world(1).media, g=np.zeros(2, np.float32))), "media.g"),
        (setup(materials=materials(medium=np.full((1, 2), 1, np.int32))), "materials.medium is 1 to 1"),
        (setup(materials=materials(child=np.zeros((1, 2), np.int32))), "a node inside another"),
        (setup(materials=materials(kind=np.full(1, 99, np.int32))), "materials.kind is 99"),
        (setup(lights=lights(medium=np.full(1, 1, np.int32))), "lights.medium is 1 to 1"),
        (setup(lights=lights(emitter_texture=np.full(1, 3, np.int32))), "emitter_texture"),
        (setup(lights=lights(light=np.ones(1, np.int32))), "lights.light is 1 to 1"),
        (setup(lights=lights(power=np.ones(2), light=np.zeros(2, np.int32))), "power of 2 elements; there are 1"),
        (setup(volume_unit=0.0), "extent"),
        (p.SetView(1, make_view(width=0)), "pixels"),
    ],
)
def test_what_does_not_hold_together_is_refused(message: Any, reason: str | None) -> None:
    frames = packing.encode(message)
    if reason is None:
        assert same(packing.decode(frames, ALL), message)
    else:
        with pytest.raises(ProtocolError, match=reason):
            packing.decode(frames, ALL)


@pytest.mark.parametrize("number", [3, -1, True, 1.0, "paths", None])
def test_numbers_of_no_diffuse_light_are_refused(number: Any) -> None:
    (frame, *others) = packing.encode(p.SetView(1, make_view()))
    told = msgpack.unpackb(frame)
    place = [field.name for field in dataclasses.fields(View)].index("diffuse_light")
    told[3][1][place] = number
    with pytest.raises(ProtocolError, match=r"diffuse_light is .* expected one of \[0, 1, 2\]"):
        packing.decode([msgpack.packb(told), *others], ALL)


@pytest.mark.parametrize(
    "message",
    [
        p.Ready(1.5),  # type: ignore[arg-type]
        p.Ready(2**64),
        p.Note(5),  # type: ignore[arg-type]
        p.Statistics(1, {"a": object()}),
        p.StartTask(1, "task"),  # type: ignore[arg-type]
        p.Partition(1, 0, 0, 1, dataclasses.replace(triangles(1), ids=np.zeros(1))),
    ],
)
def test_a_wrong_field_is_not_sent(message: Any) -> None:
    with pytest.raises(ProtocolError):
        packing.encode(message)


def test_a_stranger_is_refused_by_the_length_of_what_it_sends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is unpacked: a header of small things takes seconds."""

    def unpackb(*_: object, **__: object) -> None:
        raise AssertionError("it was unpacked")

    long = msgpack.packb([packing.MAGIC, p.PROTOCOL, "Hello", [[[]] * 100_000 for _ in range(41)]])
    assert packing.STRANGER_BYTES < len(long) < packing.HEADER_BYTES
    monkeypatch.setattr(packing.msgpack, "unpackb", unpackb)
    with pytest.raises(ProtocolError, match=f"at most {packing.STRANGER_BYTES} are taken"):
        packing.decode([long], ALL, stranger=True)
    with pytest.raises(ProtocolError, match="more than 1 frames before it was welcomed"):
        packing.decode([long, b""], ALL, stranger=True)


@pytest.mark.parametrize("value", [[0] * ((1 << 17) + 1), "x" * ((1 << 16) + 1), b"a long name"])
def test_long_things_in_a_header_are_refused(value: Any) -> None:
    with pytest.raises(ProtocolError, match="is not msgpack"):
        packing.decode([msgpack.packb([packing.MAGIC, p.PROTOCOL, "Note", [value]])], ALL)


def over_the_wire(message: Any) -> Any:
    return packing.decode([bytes(frame) for frame in packing.encode(message)], ALL)


@pytest.mark.parametrize("message", [p.Note, p.Refuse, p.Failed, p.Goodbye, p.Rejected])
def test_text_of_others_has_no_control_characters(message: type) -> None:
    orders = "\x1b]0;title\x07\x1b[2J red\x9b31m \r\nover \u202e"
    text = vars(over_the_wire(message(orders))).popitem()[1]
    assert text.isprintable()
    assert "over" in text
    assert over_the_wire(p.Statistics(1, {orders: orders})).values == {text: text}


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (p.StartTask(1, PhotonTask(0, 0, 300_000_000)), "a task of 300000000; at most"),
        (p.StartTask(1, RecordTask(0, 0, 0, 300_000_000)), "a task of 300000000; at most"),
        (p.StartTask(1, BucketTask(0, 0, 0, 1 << 20, 1 << 20)), "pixels; at most"),
        (p.Setup(1, make_world(1), (0,), ("tcp://10.0.0.1:1",) * 5000), "5000 slaves; at most 256"),
        (p.Setup(1, make_world(1), (0,), ("garbage",)), r"peers\[0\]: 'garbage' is no endpoint"),
        (p.Hello({}, "host", 1, 1, 0, "garbage"), "'garbage' is no endpoint"),
        (p.Hello({}, "host", 1, 1, 0, "tcp://\x1b[2J:1"), "is no endpoint"),
        (p.Hello({}, "host", 1, 1, 0, "tcp://" + "9" * 300), "is no endpoint"),
        (p.Hello({}, "h" * 300, 1, 1, 0, "tcp://10.0.0.1:1"), "a name of more than"),
    ],
)
def test_what_would_fill_a_machine_or_stop_another_is_refused(message: Any, reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason):
        over_the_wire(message)


def test_the_number_of_frames_is_bounded() -> None:
    with pytest.raises(ProtocolError, match="more than"):
        packing.decode([b""] * (packing.MOST_FRAMES + 1), ALL)


def test_large_arrays_span_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.cluster.messages.frames.FRAME_BYTES", 100)
    message = p.Partition(1, 0, 0, 1, triangles(30))
    frames = packing.encode(message)
    assert max(len(frame) for frame in frames[1:]) == 100
    assert same(packing.decode(frames, ALL), message)


def test_arrays_are_not_copied() -> None:
    sent = triangles(1000)
    frames = packing.encode(p.Partition(1, 0, 0, 1, sent))
    got = packing.decode(frames, ALL).triangles
    assert np.shares_memory(got.positions, sent.positions)
    assert not got.positions.flags.writeable or got.positions.base is not None


def test_every_kind_of_batch_has_a_schema() -> None:
    assert SCHEMAS.keys() == set(Kind)
