"""Slaves on machines that OpenSSH's client reaches, without a question: with keys of SSH, or an agent.

A slave gets its keys through ssh's standard input, and ends when that closes: with the connection, however it ends.
Master and slaves then talk directly to each other, not through ssh.
"""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from wdpm.cluster.master.events import NotComing, StillAwaited
from wdpm.cluster.master.local_slaves import GRACE_S, SlaveProcess
from wdpm.cluster.slave.events import JOINED
from wdpm.placing.asking import answer_of
from wdpm.placing.hosts import Host
from wdpm.placing.own_address import address_towards, listening_address, reached_at
from wdpm.scenes.errors import ClusterError, SettingsError

_OPTIONS = {
    "BatchMode": "yes",  # nobody is there to answer
    "ConnectTimeout": "15",
    "ServerAliveInterval": "15",  # with the next: a machine that has been silent for 90 s is gone, as for the master
    "ServerAliveCountMax": "6",
    "ClearAllForwardings": "yes",
    "ForwardAgent": "no",
    "ForwardX11": "no",
}

FIRST_WAIT_S = 5.0
"""Before a slave whose connection was lost is started again; doubles with each try [s] ..."""

LONGEST_WAIT_S = 300.0
"""... up to this [s]."""

MOST_TRIES = 10
"""In a row, of one slave."""

_HAS_JOINED = f"wdpm slave: {JOINED} "
"""What a slave's last line begins with once it has joined (slave/process.py)."""

_BAD_INPUT = 2
"""Exit code of a slave that would end the same way again."""

QUIET_S = 20.0
"""After which a person hears what ssh has said of a slave that has not joined: ssh itself gives up a machine that does
not answer, but may wait for a key to be touched, and a shell there for a file server, for as long as it takes [s]."""

JOIN_TIMEOUT_S = 120.0
"""How long slaves are waited for unless told otherwise: machines that are there take some seconds, and what comes later
still joins [s]."""

_ASK_S = 30.0
"""How long ssh may take to say what a name means in its configuration [s]."""


@dataclass
class _Place:
    """Room for one slave.

    Attributes:
        process: the last ssh that ran there.
        started_at: when that was [s].
        watched: whether it has not joined yet, so far as is known, and no person has heard why.
        tries: that were needed in a row.
        again_at: when to try again; None while it runs, or for never.
        held: it ended before a render had begun, and is tried again only when one has.
        reason, code: of its last end.
    """

    host: Host
    endpoint: str = ""
    process: SlaveProcess | None = None
    started_at: float = 0.0
    watched: bool = False
    tries: int = 0
    again_at: float | None = None
    held: bool = False
    reason: str = ""
    code: int | None = None


class SshSlaves:
    """Slaves on some hosts.

    Args:
        hosts: and how many on each.
        program: `wdpm` there, one word.
        threads: of each; None for its part of the cores.
        memory: most that each may use [bytes].
        device: that they compute on.

    Raises:
        SettingsError: ssh is not there, or a host cannot be found.
    """

    def __init__(
        self,
        hosts: Sequence[Host],
        program: str = "wdpm",
        *,
        threads: int | None = None,
        memory: int | None = None,
        device: str = "cpu",
    ) -> None:
        self._program = program
        self._threads = threads
        self._memory = memory
        self._device = device
        self._places = [_Place(host) for host in hosts for _ in range(host.slaves)]
        names = {host: self._real_name(host) for host in hosts}
        self._numbers = {host: address_towards([name, *names.values()]) for host, name in names.items()}
        self.listen_at = listening_address(next(iter(self._numbers.values())))
        self._keys: Callable[[], bytes] = bytes
        self._complete = False
        self._over = False

    def __len__(self) -> int:
        return len(self._places)

    def start(self, endpoint: str, keys: Callable[[], bytes]) -> None:
        """Start a slave in each place."""
        self._keys = keys
        for place in self._places:
            place.endpoint = reached_at(self._numbers[place.host], endpoint)
            self._start(place)

    def ended(self) -> Iterable[NotComing | StillAwaited]:
        """Look after the slaves. Their numbers are of other machines, so none is named: the master sees who is lost.

        One that ends before all have joined is not waited for; those that are left begin. Of one that is long in
        joining, a person hears once what ssh has said.
        """
        if self._over:
            return ()
        failed = [place for place in self._places if self._look_after(place)]
        if all(place.process is None and place.again_at is None for place in self._places):
            begun = "no slave is left:" if self._complete else "no slave runs on"
            raise ClusterError(f"{begun} {(failed or self._places)[-1].reason}")
        left = sum(place.process is not None for place in self._places)
        not_coming = [NotComing(f"no slave runs on {place.reason}", left) for place in failed if place.held]
        return [*not_coming, *self._news_of_quiet()]

    def all_joined(self) -> None:
        """From now on a slave that is lost is started again, and so are those that were not waited for."""
        self._complete = True

    def no_more(self) -> None:
        """Start none any more."""
        self._over = True

    def stop(self) -> None:
        """Close the connections, wait, kill those that stay."""
        self._over = True
        running = [place.process for place in self._places if place.process is not None]
        for process in running:
            process.let_go()
        deadline = time.monotonic() + GRACE_S
        for process in running:
            process.stop(deadline - time.monotonic())
        for place in self._places:
            place.process = None

    def _news_of_quiet(self) -> Iterable[StillAwaited]:
        """What to tell of slaves that have not joined for a while; of each once."""
        now = time.monotonic()
        for place in self._places:
            if self._complete or place.process is None or not place.watched or now < place.started_at + QUIET_S:
                continue
            place.watched = False
            last = place.process.last_line
            if not last.startswith(_HAS_JOINED):
                said = f"has said last: {last}" if last else "has said nothing"
                yield StillAwaited(f"{place.host.name}: no slave has joined from there for {QUIET_S:.0f} s; ssh {said}")

    def _look_after(self, place: _Place) -> bool:
        """Start it if it is time for that; returns whether it has just ended."""
        now = time.monotonic()
        if place.process is None:
            if self._complete and place.held:
                self._try_later(place, now)
            elif place.again_at is not None and now >= place.again_at:
                self._start(place)
            return False
        reason = place.process.ended()
        if reason is None:
            return False
        place.code = place.process.exit_code
        place.process.stop(0.0)
        place.process, place.reason, place.held = None, f"{place.host.name}: {reason}", not self._complete
        if self._complete:
            self._try_later(place, now)
        return True

    def _try_later(self, place: _Place, now: float) -> None:
        place.held = False
        if place.code != _BAD_INPUT and place.tries < MOST_TRIES:
            place.again_at = now + min(FIRST_WAIT_S * 2.0**place.tries, LONGEST_WAIT_S)
            place.tries += 1

    def _start(self, place: _Place) -> None:
        place.again_at = None
        place.process = SlaveProcess(self._command(place), self._keys())
        place.started_at, place.watched = time.monotonic(), True

    def _command(self, place: _Place) -> list[str]:
        words = [self._program, "slave", place.endpoint, "--keys", "-", "--life-line", "--device", self._device]
        words += ["--share", str(place.host.slaves)] if self._threads is None else ["--threads", str(self._threads)]
        words += [] if self._memory is None else ["--memory", f"{-(-self._memory // 1024)}K"]
        options = [word for name, value in _OPTIONS.items() for word in ("-o", f"{name}={value}")]
        # ssh hands one line to a shell there, whatever it is given.
        return ["ssh", "-T", *options, "--", place.host.name, shlex.join(words)]

    def _real_name(self, host: Host) -> str:
        """The machine that a host's name means in the configuration of ssh."""
        command = ["ssh", "-G", "--", host.name]
        try:
            lines = answer_of(command, _ASK_S).splitlines()
        except SettingsError as error:
            raise SettingsError(f"--hosts needs OpenSSH's client: {error}") from None
        names = [line.partition(" ")[2] for line in lines if line.startswith("hostname ")]
        return names[0] if names else host.name.rpartition("@")[2]
