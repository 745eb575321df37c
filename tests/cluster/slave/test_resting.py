"""When a slave's loop lets messages lie: while few rows wait for more, and for a moment while its worker computes."""

from __future__ import annotations

from fake_worker import arrays
from slave_driver import EPOCH, HELLO, PEER, WELCOME, Driver, part, setup
from slave_driver import jobs as jobs_of

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave import jobs
from wdpm.cluster.slave.job_queue import FEW_ROWS, HOLD_S
from wdpm.cluster.slave.loop import FROM_PEER, SlaveShell
from wdpm.cluster.slave.machine import Slave
from wdpm.cluster.transport.memory import MemoryTransport
from wdpm.cluster.transport.transport import Role


def message(rows: int) -> p.PeerBatches:
    return p.PeerBatches(EPOCH, (Batch.of_task(Kind.PHOTON, 5, 1, 1, 1, arrays(Kind.PHOTON, rows)),))


def test_messages_lie_while_none_is_wanted() -> None:
    driver = Driver(hold_s=HOLD_S).ready()
    network = MemoryTransport().open(None)
    listener = network.listen("memory://resting", Role.SLAVE, FROM_PEER)
    shell = SlaveShell(
        driver.slave, network, listener, "memory://nobody", lambda _: None, lambda _: None, lambda: driver.now
    )
    assert shell.rest_s(came=True) == 0.0, "a worker that is at nothing waits for messages"
    assert driver.peer(message(1)) == []
    assert shell.rest_s(came=True) == HOLD_S, "few rows wait for more"
    driver.now += HOLD_S
    assert shell.rest_s(came=True) == 0.0
    [job] = jobs_of(driver(s.Wake()))
    assert shell.rest_s(came=True) == HOLD_S, "the worker computes"
    assert shell.rest_s(came=False) == 0.0, "the next message wakes the loop, if the one before is long ago"
    driver.computed(job)
    assert shell.rest_s(came=True) == 0.0
    [job] = jobs_of(driver.peer(message(FEW_ROWS)))
    assert shell.rest_s(came=True) == HOLD_S
    network.close()


def test_short_jobs_are_done_at_once_and_others_submitted() -> None:
    driver = Driver(hold_s=HOLD_S).ready()
    network = MemoryTransport().open(None)
    listener = network.listen("memory://at-once", Role.SLAVE, FROM_PEER)
    submitted: list[jobs.Job] = []
    done: list[jobs.Job] = []

    def run_here(job: jobs.Job) -> s.Event:
        done.append(job)
        return s.Computed(jobs.Outcome(job))

    shell = SlaveShell(
        driver.slave,
        network,
        listener,
        "memory://nobody",
        submitted.append,
        lambda _: None,
        lambda: driver.now,
        run_here=run_here,
    )
    driver.peer(message(1))
    driver.now += HOLD_S
    shell.handle(s.Wake())
    assert (len(submitted), len(done)) == (1, 0), "the first may load kernels"
    shell.handle(s.Computed(jobs.Outcome(submitted[0]), 0.001))
    driver.peer(message(1))
    driver.now += HOLD_S
    shell.handle(s.Wake())
    assert (len(submitted), len(done)) == (1, 1)
    assert not driver.slave.computes, "its outcome was taken in"
    network.close()


def test_a_peer_whose_loss_a_short_job_finds_is_lost_once() -> None:
    transport, now = MemoryTransport(), 0.0
    network, others = transport.open(None), transport.open(None)
    peers = [others.listen(f"memory://{name}", Role.SLAVE, FROM_PEER) for name in ("first", "third")]
    submitted: list[jobs.Job] = []

    def run_here(job: jobs.Job) -> s.Event:
        onward = Batch.of_task(Kind.PHOTON, 5, 1, 2, 1, arrays(Kind.PHOTON, 1))
        return s.Computed(jobs.Outcome(job, (onward,)))

    shell = SlaveShell(
        Slave(HELLO, "memory://nobody", 60.0, ClusterLimits(), None, HOLD_S),
        network,
        network.listen("memory://second", Role.SLAVE, FROM_PEER),
        "memory://nobody",
        submitted.append,
        lambda _: None,
        lambda: now,
        run_here=run_here,
    )
    shell.handle(s.Start())
    for said in (WELCOME, setup(peers=("memory://first", "memory://second", "memory://third")), part(1), part(3)):
        shell.handle(s.MasterSaid(said))
    shell.handle(s.Computed(jobs.Outcome(submitted.pop())))
    shell.handle(s.PeerSaid(PEER, p.PeerHello("cluster", 0)))
    shell.handle(s.PeerSaid(PEER, message(1)))
    now += HOLD_S
    shell.handle(s.Wake())
    shell.handle(s.Computed(jobs.Outcome(submitted.pop())))
    shell.handle(s.PeerSaid(PEER, message(1)))
    now += HOLD_S
    for peer in peers:
        peer.close()
    shell.find_broken_connections()  # of the first, by which rows for the third begin that have waited for long enough
    assert shell.error is None
    assert not shell.state.computes
    assert not submitted
    network.close()
    others.close()
