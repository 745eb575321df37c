"""The other slaves as a slave knows them: whose connection is whose, and who has not answered yet.

A slave greets each peer when a world is set up, and each answers. Without an answer nothing would be sent for certain:
a connection that never came about (a firewall, a machine that the network does not reach) takes batches without a word.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from wdpm.cluster.limits import MOST_SLAVES
from wdpm.cluster.messages import endpoints, protocol
from wdpm.cluster.slave.events import AnswerPeer, Instruction, ToMaster


class Peers:
    """The state of a slave's connections with its peers.

    Args:
        answer_s: time after which the person hears that a peer has not answered [s].
        dead_s: time after which the master does, and the render ends: the peer may only be stopped [s].
    """

    def __init__(self, answer_s: float, dead_s: float) -> None:
        self._answer_s = min(answer_s, dead_s)
        self._dead_s = dead_s
        self._numbers: dict[bytes, int] = {}
        self._early: dict[bytes, protocol.PeerHello] = {}
        self._endpoints: dict[int, str] = {}
        self._awaited: dict[int, float] = {}
        self._late: set[int] = set()

    def number_of(self, identity: bytes) -> int | None:
        """Which slave sends over a connection; None if it has not said so."""
        return self._numbers.get(identity)

    def keep_early(self, identity: bytes, hello: protocol.PeerHello) -> bool:
        """Keep a greeting that came before this slave knows its own cluster; False if too many are kept.

        The last slave to join may have the slowest link: others then hear of it, and greet it, before its Welcome.
        """
        if identity not in self._early and len(self._early) >= MOST_SLAVES:
            return False
        self._early[identity] = hello
        return True

    def take_early(self) -> list[tuple[bytes, protocol.PeerHello]]:
        """The greetings that were kept, in the order in which they came."""
        early, self._early = list(self._early.items()), {}
        return early

    def greeted(self, identity: bytes, hello: protocol.PeerHello, own: int) -> list[Instruction]:
        """A peer of the same cluster has said who it is."""
        self._numbers[identity] = hello.number
        return [AnswerPeer(identity, protocol.PeerWelcome(own))]

    @property
    def endpoints(self) -> dict[int, str]:
        """Those that it is connected with, or tries to be, by number."""
        return dict(self._endpoints)

    def set_up(self, endpoints: Mapping[int, str], now: float) -> list[int]:
        """Be connected with these peers and no others. Returns those that are new, whose answers are awaited."""
        new = [peer for peer, endpoint in endpoints.items() if self._endpoints.get(peer) != endpoint]
        self._endpoints = dict(endpoints)
        self._awaited = {peer: since for peer, since in self._awaited.items() if peer in endpoints}
        self._awaited |= dict.fromkeys(new, now)
        self._late = self._late.intersection(endpoints).difference(new)
        return new

    def forget(self) -> None:
        """The cluster is gone: nobody is known, and nobody awaited."""
        self._endpoints, self._awaited, self._numbers = {}, {}, {}

    def answered(self, peer: int, answer: protocol.PeerAnswer) -> list[Instruction]:
        """A peer has answered; tell the master if it is not who it should be."""
        greeted = self._awaited.pop(peer, None) is None
        match answer:
            case protocol.Rejected() if greeted:
                # It was reached, and does not know this slave any more: it has lost its master, who may not know yet.
                self.lost(peer)
                return [ToMaster(protocol.PeerGone(peer))]
            case protocol.PeerWelcome(number) if number == peer:
                return []
            case protocol.PeerWelcome(number):
                return self._unreachable([peer], f"slave {number} answers there")
            case protocol.Rejected(reason):
                return self._unreachable([peer], reason)

    def lost(self, peer: int) -> None:
        """The connection to a peer broke, which is told to the master. It is new when it is wanted again."""
        self._awaited.pop(peer, None)
        self._endpoints.pop(peer, None)

    def stood_still(self, seconds: float) -> None:
        """This process stood still for so long, and could not have heard an answer [s]."""
        self._awaited = {peer: since + seconds for peer, since in self._awaited.items()}

    def overdue(self, now: float) -> list[Instruction]:
        """Tell the master of peers that have not answered: first a word for the person, later that none comes."""
        dead = [peer for peer, since in self._awaited.items() if now - since >= self._dead_s]
        for peer in dead:
            del self._awaited[peer]
        late = [
            peer for peer, since in self._awaited.items() if now - since >= self._answer_s and peer not in self._late
        ]
        self._late.update(late)
        return [*(self._note(peer) for peer in late), *self._unreachable(dead, f"no answer within {self._dead_s:g} s")]

    def _note(self, peer: int) -> ToMaster:
        endpoint, left = self._endpoints[peer].partition("#")[0], self._dead_s - self._answer_s
        asked = endpoints.check_reach(endpoint, "does a firewall keep slaves apart?")
        waits = f"after {self._answer_s:g} s; it waits for {left:g} s more ({asked})"
        return ToMaster(protocol.Note(f"has no answer of slave {peer} at {endpoint} {waits}"))

    def _unreachable(self, peers: Sequence[int], reason: str) -> list[Instruction]:
        return [ToMaster(protocol.PeerUnreachable(peer, reason)) for peer in peers]
