"""A slave's state machine: events in, instructions compared. No sockets, no clock, no workers."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import pytest
from fake_worker import arrays, make_view, make_world, triangles
from slave_driver import EPOCH, HELLO, HOLDERS, PEER, PEERS, WELCOME, Driver, error_of, jobs, part, setup, to_master

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave import jobs as c
from wdpm.cluster.task import PhotonsTraced, PhotonTask


def batch(kind: Kind, cell: int = 1, home: int = 1) -> Batch:
    return Batch.of_task(kind, 5, home, cell, 1, arrays(kind, 1))


# Joining and leaving.


def test_it_says_hello_and_joins() -> None:
    driver = Driver()
    assert driver(s.Start()) == [s.ToMaster(HELLO)]
    assert driver.told(WELCOME) == [s.Tell("joined tcp://master:1 as slave 1")]
    assert driver.slave.number == 1
    assert driver.told(WELCOME) == []


def test_it_tries_again_with_growing_waits_and_gives_up() -> None:
    driver = Driver(patience=20.0)
    driver.slave.handle(s.Start(), 0.0)
    tries: list[float] = []
    for tenth in range(1, 300):
        out = driver.slave.handle(s.Tick(), tenth / 10)
        if s.Reconnect() in out:
            assert out[-1] == s.ToMaster(HELLO)
            tries.append(tenth / 10)
        if driver.slave.ended:
            break
    assert tries == [1.0, 3.0, 7.0, 15.0]
    assert tenth == 200
    assert "no master answered at tcp://master:1 within 20 s" in error_of(out)


def test_a_refusal_is_told() -> None:
    driver = Driver()
    driver(s.Start())
    assert "refused: versions differ" in error_of(driver.told(p.Refuse("versions differ")))
    assert driver.slave.ended
    assert driver.told(WELCOME) == []


def test_a_connection_that_is_refused_before_joining_is_tried_again() -> None:
    driver = Driver()
    driver(s.Start())
    assert driver(s.MasterLost()) == []


def test_stop_is_no_error() -> None:
    out = Driver().ready().told(p.Stop("done", True))
    assert to_master(out) == [p.Goodbye("stopped")]
    assert out[-1] == s.Exit(None)


def test_stop_without_an_image_is_an_error_of_somebody_else() -> None:
    out = Driver().ready().told(p.Stop("slave 0 failed", False))
    assert to_master(out) == [p.Goodbye("stopped")]
    assert out[-1] == s.Exit("the render ended without an image: slave 0 failed", elsewhere=True)


def test_heartbeats_go_out_while_the_worker_computes() -> None:
    driver = Driver().ready()
    driver.told(p.StartTask(EPOCH, PhotonTask(5, 0, 10)))
    beats = 0
    for tenth in range(1, 51):
        beats += to_master(driver.slave.handle(s.Tick(), tenth / 10)).count(p.Heartbeat())
    assert beats in (4, 5)


def silent_master(driver: Driver, seconds: range) -> list[str]:
    """What the person at a slave is told while its master says nothing; it does not leave."""
    out = [instruction for second in seconds for instruction in driver.slave.handle(s.Tick(), second)]
    assert not driver.slave.ended
    return [instruction.text for instruction in out if isinstance(instruction, s.Tell)]


def test_a_silent_master_is_left() -> None:
    driver = Driver().ready()
    assert silent_master(driver, range(1, 90)) == ["the master has been silent for 11 s; it is waited for"]
    out = driver.slave.handle(s.Tick(), 91.0)
    assert s.Reconnect(fresh=True) in out
    assert "silent for" in next(i.text for i in out if isinstance(i, s.Tell))


def test_a_master_that_is_late_may_come_back() -> None:
    driver = Driver().ready()
    silent_master(driver, range(1, 61))
    driver.slave.handle(s.MasterSaid(p.Heartbeat()), 60.5)
    assert silent_master(driver, range(61, 70)) == ["the master is back"]


def test_a_slave_that_slept_does_not_blame_the_master() -> None:
    driver = Driver().ready()
    driver.slave.handle(s.Tick(), 1.0)
    assert to_master(driver.slave.handle(s.Tick(), 3600.0)) == [p.Heartbeat()]


def test_a_long_build_is_told_once() -> None:
    driver = Driver()
    driver(s.Start())
    driver.told(WELCOME, setup(), part(1), part(3))
    notes = [
        message
        for tenth in range(1, 80)
        for message in to_master(driver.slave.handle(s.Tick(), tenth / 10))
        if isinstance(message, p.Note)
    ]
    assert len(notes) == 1
    assert "compiles kernels" in notes[0].text


@pytest.mark.parametrize(
    ("event", "message", "error"),
    [
        (s.Leave("interrupted"), p.Goodbye("interrupted"), "interrupted"),
        (s.ComputeFailed("no memory"), p.Failed("no memory"), "no memory"),
        (s.Unreadable(None, "noise"), None, "cannot read a message of the master: noise"),
        (s.Unreadable(PEER, "noise"), None, "cannot read a message of slave 0: noise"),
        (s.MasterSaid(p.Rejected("noise")), None, "the master could not read a message of this slave: noise"),
        (s.MasterSaid(part(1)), None, "cell 1, which is not expected here"),
    ],
)
def test_what_ends_a_slave_is_told_to_the_master(event: s.Event, message: p.FromSlave | None, error: str) -> None:
    out = Driver().ready()(event)
    assert error in error_of(out)
    [last_words] = to_master(out)
    assert last_words == message or (message is None and isinstance(last_words, p.Failed))


def test_a_lost_peer_is_for_the_master_to_judge() -> None:
    driver = Driver().ready()
    assert driver(s.PeerLost(2)) == [s.ToMaster(p.PeerGone(2))]
    assert not driver.slave.ended


# Setup.


def test_setup_connects_greets_and_builds() -> None:
    driver = Driver()
    driver(s.Start())
    out = driver.told(WELCOME, setup())
    greeting = p.PeerHello("cluster", 1)
    connect = s.ConnectPeers(((0, PEERS[0]), (2, PEERS[2])))
    assert out[1:] == [connect, s.ToPeer(0, greeting), s.ToPeer(2, greeting)]
    assert driver.told(part(3, 0, 2)) == []
    assert to_master(driver.told(part(3, 1, 2))) == [p.PartitionReceived(EPOCH, 3)]
    [build] = jobs(driver.told(part(1)))
    assert isinstance(build, c.Build)
    assert {cell: list(held.ids) for cell, held in build.partition.items()} == {1: [10, 11], 3: [30, 31, 32, 33]}
    assert (build.number, build.holders) == (1, HOLDERS)


def test_a_slave_without_cells_builds_too() -> None:
    driver = Driver()
    driver(s.Start())
    [build] = jobs(driver.told(WELCOME, setup(holders=(0, 0, 2, 2))))
    assert isinstance(build, c.Build)
    assert build.partition == {}


def test_peers_are_greeted_once() -> None:
    driver = Driver().ready()
    out = driver.told(setup(EPOCH + 1))
    assert not [i for i in out if isinstance(i, s.ToPeer)]
    driver(s.PeerLost(2))
    out = driver.told(setup(EPOCH + 2))
    assert [i.number for i in out if isinstance(i, s.ToPeer)] == [2]


def test_a_team_is_connected_with_itself_alone() -> None:
    driver = Driver()
    driver(s.Start())
    out = driver.told(WELCOME, setup(holders=(1, 1, 2, 2), peers=("", *PEERS[1:])))
    assert [i.peers for i in out if isinstance(i, s.ConnectPeers)] == [((2, PEERS[2]),)]


def test_cells_are_kept_for_the_next_epoch() -> None:
    driver = Driver().ready()
    out = driver.told(setup(EPOCH + 1, holders=(1, 1, 1, 1), kept=(1, 3)), part(0, epoch=EPOCH + 1))
    assert jobs(out) == []
    [build] = jobs(driver.told(part(2, epoch=EPOCH + 1)))
    assert isinstance(build, c.Build)
    assert sorted(build.partition) == [0, 2]
    assert build.kept == (1, 3)
    assert to_master(driver.computed(build)) == [p.Ready(EPOCH + 1)]


def test_copies_go_to_other_teams() -> None:
    driver = Driver().ready()
    copies = (p.Copy(1, 7, 9, "tcp://g:1"), p.Copy(3, 8, 9, "tcp://h:1"))
    out = driver.told(p.BuildMaps(EPOCH, copies, 2, 0, 3))
    assert [i.number for i in out if isinstance(i, s.ToPeer)] == [7, 8]
    [send] = jobs(out)
    own = [batch(Kind.COPIED_PHOTONS, cell=cell) for cell in (1, 3)]
    out = driver.computed(send, *own)
    assert [i for i in out if isinstance(i, s.ToPeer)] == [
        s.ToPeer(7, p.PeerBatches(9, (own[0],))),
        s.ToPeer(8, p.PeerBatches(9, (own[1],))),
    ]
    theirs = batch(Kind.COPIED_PHOTONS, cell=3, home=12)
    for _ in range(2):
        assert jobs(driver.peer(p.PeerBatches(EPOCH, (theirs,)))) == [c.HandleBatches((theirs,))]
        out = driver.computed(c.HandleBatches((theirs,)))
    assert jobs(out) == [c.ExchangeGhosts()]
    [sort] = jobs(driver.computed(c.ExchangeGhosts(), ghosts_expected=0))
    assert sort == c.SortTrees(copies, 0, 3)
    sorted_here = [batch(Kind.COPIED_ORDER, cell=cell) for cell in (1, 3)]
    out = driver.computed(sort, *sorted_here)
    assert [i.message.batches[0] for i in out if isinstance(i, s.ToPeer)] == sorted_here
    for _ in range(2):
        assert jobs(out) == []
        theirs = batch(Kind.COPIED_ORDER, cell=1, home=12)
        driver.peer(p.PeerBatches(EPOCH, (theirs,)))
        out = driver.computed(c.HandleBatches((theirs,)))
    [build] = jobs(out)
    assert build == c.BuildMaps(copies, 0, 3)
    worked_out = [batch(Kind.COPIED_IRRADIANCE, cell=cell) for cell in (1, 3)]
    out = driver.computed(build, *worked_out)
    assert [i.message.batches[0] for i in out if isinstance(i, s.ToPeer)] == worked_out
    for _ in range(2):
        assert to_master(out) == []
        theirs = batch(Kind.COPIED_IRRADIANCE, cell=1, home=12)
        driver.peer(p.PeerBatches(EPOCH, (theirs,)))
        out = driver.computed(c.HandleBatches((theirs,)))
    assert jobs(out) == [c.FinishMaps()]
    assert to_master(driver.computed(c.FinishMaps())) == [p.MapsBuilt(EPOCH, {})]


def test_trees_that_are_not_worth_sharing_are_built_at_once() -> None:
    driver = Driver().ready()
    copies = (p.Copy(1, 7, 9, "tcp://g:1"),)
    [send] = jobs(driver.told(p.BuildMaps(EPOCH, copies, 0, 0, 2)))
    assert jobs(driver.computed(send, batch(Kind.COPIED_PHOTONS, cell=1))) == [c.ExchangeGhosts()]
    assert jobs(driver.computed(c.ExchangeGhosts(), ghosts_expected=0)) == [c.SortTrees(copies, 0, 2)]
    out = driver.computed(c.SortTrees(copies, 0, 2))
    assert not [i for i in out if isinstance(i, s.ToPeer)]
    assert jobs(out) == [c.BuildMaps(copies, 0, 2)]


def test_copies_of_a_cell_that_is_not_held_are_refused() -> None:
    copies = (p.Copy(0, 7, 9, "tcp://g:1"),)
    assert "cell 0, which is not held here" in error_of(Driver().ready().told(p.BuildMaps(EPOCH, copies)))


@pytest.mark.parametrize(
    ("messages", "error"),
    [
        ([part(1)], "Partition came before Welcome"),
        ([WELCOME, setup(holders=(0, 1))], "holders of 2 cells; its top tree has 4"),
        ([WELCOME, setup(holders=(0, 1, 2, 3))], "a holder without an endpoint among 3 slaves"),
        ([WELCOME, setup(holders=(0, 0, 0, 0), peers=PEERS[:1])], "no endpoint for slave 1"),
        ([WELCOME, setup(kept=(1,))], "keeps cells [1]; it has []"),
        ([WELCOME, setup(), part(0)], "cell 0, which is not expected"),
        ([WELCOME, setup(), part(1, 1, 2)], "part 1 of 2 of cell 1 is out of order"),
        ([WELCOME, setup(), part(1, 0, 2), part(1, 0, 2)], "out of order"),
        ([WELCOME, setup(), part(1), part(1)], "cell 1, which is not expected"),
        ([WELCOME, setup(), part(1, 0, 2), part(1, 1, 2, triangles(1))], "not in the order of their numbers"),
    ],
)
def test_a_wrong_setup_is_refused(messages: list[Any], error: str) -> None:
    driver = Driver()
    driver(s.Start())
    assert error in error_of(driver.told(*messages))


def test_a_triangle_of_an_unknown_material_is_refused() -> None:
    driver = Driver()
    driver(s.Start())
    wrong = triangles(1)
    wrong.material[0] = 1
    assert "material" in error_of(driver.told(WELCOME, setup(), part(1, held=wrong)))


@pytest.mark.parametrize("area", [-1.0, float("nan"), float("inf")])
def test_an_area_before_a_triangle_that_cannot_be_is_refused(area: float) -> None:
    driver = Driver()
    driver(s.Start())
    wrong = triangles(1)
    wrong.area_before[0] = area
    assert "an area before a triangle" in error_of(driver.told(WELCOME, setup(), part(1, held=wrong)))


# Work.


def test_finishing_goes_before_starting() -> None:
    driver = Driver().ready()
    first, second = PhotonTask(5, 0, 10), PhotonTask(6, 10, 20)
    assert jobs(driver.told(p.StartTask(EPOCH, first), p.StartTask(EPOCH, second))) == [c.StartTask(first)]
    ray, home = batch(Kind.PHOTON), batch(Kind.ENDED, cell=0)
    assert driver.peer(p.PeerBatches(EPOCH, (ray,))) == []
    assert driver.peer(p.PeerBatches(EPOCH, (home,))) == []
    assert jobs(driver.computed(c.StartTask(first))) == [c.HandleBatches((home, ray))]
    assert jobs(driver.computed(c.HandleBatches((home, ray)))) == [c.StartTask(second)]
    assert jobs(driver.computed(c.StartTask(second))) == []


def test_batches_that_go_the_same_way_are_handled_together() -> None:
    driver = Driver().ready()
    [started] = jobs(driver.told(p.StartTask(EPOCH, PhotonTask(5, 0, 10))))
    for _ in range(3):
        driver.peer(p.PeerBatches(EPOCH, (batch(Kind.PHOTON),)))
    [job] = jobs(driver.computed(started))
    assert isinstance(job, c.HandleBatches)
    [joined] = job.batches
    assert (len(joined), joined.credit) == (3, 3)
    assert jobs(driver.computed(job)) == []


def test_ghosts_are_not_joined_since_they_are_counted() -> None:
    driver = Driver().ready()
    [exchange] = jobs(driver.told(p.BuildMaps(EPOCH)))
    ghosts = batch(Kind.GHOST_PHOTONS, home=-1)
    for _ in range(2):
        driver.peer(p.PeerBatches(EPOCH, (ghosts,)))
    assert jobs(driver.computed(exchange, ghosts_expected=2)) == [c.HandleBatches((ghosts,))]
    assert jobs(driver.computed(c.HandleBatches((ghosts,)))) == [c.HandleBatches((ghosts,))]
    assert jobs(driver.computed(c.HandleBatches((ghosts,)))) == [c.BuildMaps()]


def test_batches_and_results_find_their_way() -> None:
    driver = Driver().ready()
    job = c.StartTask(PhotonTask(5, 0, 10))
    driver.told(p.StartTask(EPOCH, job.task))
    away, home, own = batch(Kind.PHOTON, cell=2), batch(Kind.LIT, home=0), batch(Kind.PHOTON, cell=3)
    result = PhotonsTraced(5, 10, 1.0)
    out = driver.computed(job, away, home, own, results=[result])
    assert [i for i in out if isinstance(i, s.ToPeer)] == [
        s.ToPeer(2, p.PeerBatches(EPOCH, (away,))),
        s.ToPeer(0, p.PeerBatches(EPOCH, (home,))),
    ]
    assert to_master(out) == [p.TaskDone(EPOCH, result)]
    assert jobs(out) == [c.HandleBatches((own,))]


@pytest.mark.parametrize("early", [0, 1, 2])
def test_maps_are_built_when_the_last_ghosts_are_in(early: int) -> None:
    driver = Driver().ready()
    ghosts = batch(Kind.GHOST_PHOTONS, home=0)
    for _ in range(early):
        driver.peer(p.PeerBatches(EPOCH, (ghosts,)))
        driver.computed(c.HandleBatches((ghosts,)))
    [exchange] = jobs(driver.told(p.BuildMaps(EPOCH)))
    out = driver.computed(exchange, ghosts_expected=2)
    for _ in range(2 - early):
        assert jobs(out) == []
        driver.peer(p.PeerBatches(EPOCH, (ghosts,)))
        out = driver.computed(c.HandleBatches((ghosts,)))
    assert jobs(out) == [c.BuildMaps()]
    assert jobs(driver.computed(c.BuildMaps())) == [c.FinishMaps()]
    assert to_master(driver.computed(c.FinishMaps())) == [p.MapsBuilt(EPOCH, {})]


def test_too_many_ghosts_are_an_error() -> None:
    driver = Driver().ready()
    ghosts = batch(Kind.GHOST_PHOTONS, home=0)
    for _ in range(2):
        driver.peer(p.PeerBatches(EPOCH, (ghosts,)))
        driver.computed(c.HandleBatches((ghosts,)))
    driver.told(p.BuildMaps(EPOCH))
    assert "2 batches of ghosts and points came; expected 1" in error_of(
        driver.computed(c.ExchangeGhosts(), ghosts_expected=1)
    )


@pytest.mark.parametrize(
    ("message", "job", "outcome", "answer"),
    [
        (p.SetView(EPOCH, make_view()), c.SetView, {}, p.ViewSet(EPOCH)),
        (p.ForgetPhotons(EPOCH, make_world(1).photon_plan), c.ForgetPhotons, {}, p.PhotonsForgotten(EPOCH)),
        (
            p.ReadStatistics(EPOCH),
            c.ReadStatistics,
            {"statistics": {"photons": 5}},
            p.Statistics(EPOCH, {"photons": 5, "dropped": {}}),
        ),
    ],
)
def test_orders_are_carried_out_and_acknowledged(
    message: p.FromMaster, job: type, outcome: dict[str, Any], answer: p.FromSlave
) -> None:
    driver = Driver().ready()
    [ordered] = jobs(driver.told(message))
    assert isinstance(ordered, job)
    assert to_master(driver.computed(ordered, **outcome)) == [answer]


def test_late_messages_are_dropped_and_counted() -> None:
    driver = Driver().ready()
    assert driver.told(p.StartTask(EPOCH - 1, PhotonTask(5, 0, 10))) == []
    assert driver.told(setup(EPOCH)) == []
    assert driver.peer(p.PeerBatches(EPOCH - 1, (batch(Kind.PHOTON),))) == []
    assert driver.slave.dropped == {
        "StartTask of another epoch": 1,
        "Setup of an older epoch": 1,
        "PeerBatches of another epoch": 1,
    }


def test_what_was_computed_for_an_older_epoch_is_dropped() -> None:
    driver = Driver().ready()
    job = c.StartTask(PhotonTask(5, 0, 10))
    driver.told(p.StartTask(EPOCH, job.task))
    driver.told(setup(EPOCH + 1))
    assert driver.computed(job, batch(Kind.PHOTON, cell=2)) == []
    assert driver.slave.dropped == {"outcome of another epoch": 1}


def test_strangers_are_answered_and_counted() -> None:
    driver = Driver().ready()
    for out in (
        driver.peer(p.PeerBatches(EPOCH, (batch(Kind.PHOTON),)), b"stranger"),
        driver.peer(p.PeerHello("another cluster", 0), b"stranger"),
        driver(s.Unreadable(b"stranger", "noise")),
    ):
        [answer] = out
        assert isinstance(answer, s.AnswerPeer)
        assert answer.identity == b"stranger"
    assert sum(driver.slave.dropped.values()) == 3


@pytest.mark.parametrize(
    ("kind", "name", "index"),
    [
        (Kind.SHADE, "prim", -1),
        (Kind.LANDED, "prim", -2),
        (Kind.PHOTON, "prim", -2),
        (Kind.CAMERA, "owner", 4),
        (Kind.PHOTON, "light", 1),
        (Kind.PHOTON, "light", -1),
        (Kind.PHOTON, "bounce", -1),
        (Kind.SAMPLES, "cell", 4),
        (Kind.PROBE, "pixel", -1),
    ],
)
def test_an_index_that_points_outside_is_an_error(kind: Kind, name: str, index: int) -> None:
    good = batch(kind)
    driver = Driver().ready()
    driver.peer(p.PeerBatches(EPOCH, (good,)))
    assert not driver.slave.ended
    good.arrays[name][0] = index
    assert f"{kind.value}.{name} is {index} to {index}" in error_of(driver.peer(p.PeerBatches(EPOCH, (good,))))


@pytest.mark.parametrize("kind", [Kind.PHOTON, Kind.GHOST_PHOTONS])
def test_a_batch_that_is_refused_is_not_kept(kind: Kind) -> None:
    driver = Driver().ready()
    driver.told(p.StartTask(EPOCH, PhotonTask(5, 0, 10)))  # computes, so that what comes meanwhile waits
    wrong = batch(kind, home=1 if kind is Kind.PHOTON else -1)
    wrong.arrays["map" if kind is Kind.GHOST_PHOTONS else "prim"][0] = -2
    watched = weakref.ref(wrong)
    error_of(driver.peer(p.PeerBatches(EPOCH, (wrong,))))
    del wrong
    gc.collect()
    assert watched() is None


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        (batch(Kind.PHOTON, cell=0), "is not for slave 1"),
        (batch(Kind.LIT, home=2), "is not for slave 1"),
        (batch(Kind.PHOTON, cell=4), "for cell 4 and home 1"),
        (batch(Kind.PHOTON, cell=-1), "for cell -1"),
        (batch(Kind.LIT, home=3), "and home 3"),
    ],
)
def test_a_misled_batch_is_an_error(wrong: Batch, error: str) -> None:
    assert error in error_of(Driver().ready().peer(p.PeerBatches(EPOCH, (wrong,))))
