"""A cluster in one process whose slaves are killed, cut off from each other, and joined by others, as a seed says.

Deliveries are shuffled, so a fault meets every order of messages there may be; there is no clock but the turns.
"""

from __future__ import annotations

import random
from functools import partial
from typing import Any

from wdpm.cluster.in_process import MemoryCluster
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.jobs import Job, WorkerFactory
from wdpm.cluster.transport.memory import Channel, MemoryNetwork

LIMITS = ClusterLimits(peer_gone_s=0.0, photon_task_paths=100, part_triangles=4)


class FaultyCluster(MemoryCluster):
    """A cluster that suffers.

    Args:
        seed: of the order of deliveries and of the faults.
        every: turns between two faults, on average.
        faults: how many there are, in all sessions.
    """

    def __init__(
        self, make_worker: WorkerFactory, slaves: int, seed: int, *, every: int, faults: int, most: int = 0
    ) -> None:
        self._random = random.Random(seed)
        self._make_worker = make_worker
        self._every, self._faults = every, faults
        self._turns = 0
        self.suffered: list[str] = []
        super().__init__(make_worker, slaves, limits=LIMITS, shuffle=random.Random(seed + 1))
        self._master.state._members.most = max(most, slaves)
        self._started = True

    def render(self, session: Session, *_: Any) -> SessionResult:
        self._session, self._progress, self._display, self._result = session, None, None, None
        self._master.handle(m.Begin(session))
        idle = 0
        while self._result is None:
            self._turns += 1
            if self._faults and self._random.random() < 1.0 / self._every:
                self._suffer()
            idle = 0 if self._step() else idle + 1
            if idle:  # only timers are left
                self._tick()
            assert idle < 100, f"the cluster waits for nothing in phase {self._master.state.phase.value}"
        for _ in range(self._random.randint(0, 30)):  # what is said after the end, and before the next session
            self._step()
        self._session = None
        return self._result

    def _suffer(self) -> None:
        kinds = ["join", "cut"] + (["kill", "leave"] if len(self._slaves) > 1 else [])
        kind = self._random.choice(kinds)
        self._faults -= 1
        self.suffered.append(f"{kind} at turn {self._turns} in {self._master.state.phase.value}")
        if kind == "join":
            self._add_slave(1000 + self._turns, self._make_worker, LIMITS, 1)
            return
        network = self._random.choice(list(self._slaves))
        shell = self._slaves[network]
        if kind == "cut":
            for number in list(shell._peers):
                if number in shell._peers and self._random.random() < 0.5:
                    shell._lose_peer(number)
            return
        if kind == "leave":
            shell.handle(s.Leave("it was asked to"))
        self._remove(network)

    def _remove(self, network: Any) -> None:
        shell = self._slaves.pop(network)
        del self._computes[network]
        network.close()
        self._master.handle(m.SlaveLost(shell._identity, "killed"))
        for other in list(self._slaves.values()):
            other.find_broken_connections()

    def _tick(self) -> None:
        self._master.handle(m.Tick())
        for shell in list(self._slaves.values()):
            shell.handle(s.Tick())

    def _submit(self, network: MemoryNetwork, job: Job) -> None:
        def do() -> None:
            if network in self._computes:  # killed meanwhile, otherwise
                outcome = self._computes[network].start(job)
                assert outcome is not None
                self._slaves[network].handle(s.Computed(outcome))

        self._post.put(Channel(network, network), do)


FAULTY = partial(FaultyCluster, every=60, faults=6)
