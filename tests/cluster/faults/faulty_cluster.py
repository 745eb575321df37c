"""A cluster in one process whose slaves are killed, cut off from each other, and joined by others, as a seed says.

Deliveries are shuffled, so a fault meets every order of messages there may be. There is no clock but the turns: a
second passes when all wait for who stands still.
"""

from __future__ import annotations

import random
import time
from typing import Any

from wdpm.cluster.in_process import MemoryCluster, Post
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.jobs import Job, WorkerFactory
from wdpm.cluster.transport.memory import Channel, MemoryNetwork

LIMITS = ClusterLimits(peer_gone_s=0.0, photon_task_paths=100, part_triangles=4)


class HoldingPost(Post):
    """Delivers nothing to slaves that stand still.

    Attributes:
        still: their networks.
    """

    def __init__(self, shuffle: random.Random) -> None:
        super().__init__(shuffle)
        self.still: set[object] = set()

    def deliver(self) -> Channel | None:
        held = {channel: self._channels.pop(channel) for channel in [*self._channels] if channel.receiver in self.still}
        delivered = super().deliver()
        for channel, waiting in held.items():
            waiting.extend(self._channels.pop(channel, ()))
        self._channels |= held
        return delivered


class FaultyCluster(MemoryCluster):
    """A cluster that suffers.

    Args:
        seed: of the order of deliveries and of the faults.
        every: turns between two faults, on average.
        faults: how many there are, in all sessions.
        stops: whether slaves also stand still, as processes that SIGSTOP stops, some until they count as dead.
    """

    def __init__(
        self,
        make_worker: WorkerFactory,
        slaves: int,
        seed: int,
        *,
        every: int,
        faults: int,
        most: int = 0,
        stops: bool = False,
    ) -> None:
        self._random = random.Random(seed)
        self._make_worker = make_worker
        self._every, self._faults = every, faults
        self._stops = stops
        self._turns = 0
        self._now = time.monotonic()
        self.suffered: list[str] = []
        shuffle = random.Random(seed + 1)
        super().__init__(make_worker, slaves, limits=LIMITS, shuffle=shuffle)
        self._post = self._holding = HoldingPost(shuffle)
        self._master._clock = lambda: self._now
        self._master.state._members.most = max(most, slaves)
        self._started = True

    def _add_slave(self, *how: Any) -> None:
        super()._add_slave(*how)
        list(self._slaves.values())[-1]._clock = lambda: self._now

    def render(self, session: Session, *_: Any) -> SessionResult:
        self._session, self._progress, self._display, self._result = session, None, None, None
        self._master.handle(m.Begin(session))
        idle = 0
        while self._result is None:
            idle = 0 if self._turn() else idle + 1
            if self._holding.still and self._random.random() < 0.02:
                self._holding.still.clear()
                idle = 0
            patience = 1000 if self._holding.still else 100
            assert idle < patience, f"the cluster waits for nothing in phase {self._master.state.phase.value}"
        for _ in range(self._random.randint(0, 30)):  # what is said after the end, and before the next session
            self._step()
        self._session = None
        return self._result

    def _turn(self) -> bool:
        """A message, and perhaps a fault; False if no message was on its way."""
        self._turns += 1
        if self._faults and self._random.random() < 1.0 / self._every:
            self._suffer()
        if self._step():
            return True
        self._tick()  # only timers are left
        return False

    def _suffer(self) -> None:
        kinds = ["join", "cut"] + (["kill", "leave"] if len(self._slaves) > 1 else [])
        kinds += ["stop"] if self._stops else []
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
        if kind == "stop":
            self._holding.still.add(network)
            self._wake_if_all_stand_still()
            return
        if kind == "leave":
            shell.handle(s.Leave("it was asked to"))
        self._remove(network)

    def _remove(self, network: Any) -> None:
        shell = self._slaves.pop(network)
        del self._computes[network]
        network.close()
        self._holding.still.discard(network)
        self._wake_if_all_stand_still()
        self._master.handle(m.SlaveLost(shell._identity, "killed"))
        for other in list(self._slaves.values()):
            other.find_broken_connections()

    def _wake_if_all_stand_still(self) -> None:
        if self._holding.still.issuperset(self._slaves):
            self._holding.still.clear()

    def _tick(self) -> None:
        self._now += 1.0 if self._holding.still else 0.0
        self._master.handle(m.Tick())
        for network, shell in list(self._slaves.items()):
            if network not in self._holding.still:
                shell.handle(s.Tick())

    def _submit(self, network: MemoryNetwork, job: Job) -> None:
        def do() -> None:
            if network in self._computes:  # killed meanwhile, otherwise
                outcome = self._computes[network].start(job)
                assert outcome is not None
                self._slaves[network].handle(s.Computed(outcome))

        self._post.put(Channel(network, network), do)
