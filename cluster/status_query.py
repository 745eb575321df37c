"""Asking a master how far it is, without being a slave of it."""

from __future__ import annotations

import time

from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.registry import transport_of
from wdpm.cluster.transport.transport import TURN_S, Connection, Network, Role
from wdpm.scenes.errors import ClusterError, MasterLostError, ProtocolError

ANSWERS = packing.by_name(protocol.ToReader)

_ASK_AGAIN_S = 1.0


def ask_status(master: str, keys: Keys | None, patience: float) -> protocol.StatusReport:
    """How far the master at an address is.

    Args:
        master: of any transport, tcp://HOST:PORT say.
        keys: whose owner the master lets in: a reader, a slave or the master itself; None if it has none.
        patience: how long to wait for it [s].

    Raises:
        MasterLostError: no master answers.
        ClusterError: it does not accept the keys, or speaks another protocol.
    """
    transport = transport_of(master)
    resolved = transport.resolve(master)
    network = transport.open(keys)
    try:
        return _ask(network, resolved, time.monotonic() + patience)
    finally:
        network.close()


def _ask(network: Network, master: str, until: float) -> protocol.StatusReport:
    refused = False
    while time.monotonic() < until:
        connection = network.connect(master, Role.MASTER, ANSWERS)
        try:
            answer = _answer(network, connection, min(until, time.monotonic() + _ASK_AGAIN_S))
            connection.broke()
            refused = refused or connection.refused()
        finally:
            connection.close(deliver=False)
        if answer is not None:
            return answer
    if refused:
        raise ClusterError(
            f"the master at {master} does not accept these keys; give --keys with a folder that `wdpm keys add` made, "
            "or none if the master has none"
        )
    raise MasterLostError(f"no master answers at {master}; check that one runs there, and the address")


def _answer(network: Network, connection: Connection, until: float) -> protocol.StatusReport | None:
    """What a master says before a time; a connection that nobody has taken by then is tried once more."""
    asked = False
    while time.monotonic() < until:
        asked = asked or connection.send(protocol.AskStatus())
        network.wait(TURN_S)
        match connection.receive():
            case protocol.StatusReport() as report:
                return report
            case protocol.Rejected(reason):
                raise ClusterError(f"the master does not tell: {reason}")
            case ProtocolError() as error:
                raise error
    return None
