"""Ctrl-C and `kill -INT` end a command, wherever they find it and whatever the process has inherited."""

from __future__ import annotations

import argparse
import fcntl
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from fake_worker import make_session
from patience import WAIT_S
from slave_threads import SlaveThread, check_picture

from wdpm.cli import compare, main
from wdpm.cli.interrupts import interrupts_raise, no_lost_interrupts, termination_raises
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.versions import versions

pytestmark = pytest.mark.processes

COMMAND = ["compare", "a", "b"]

SLEEPER = f"""
import sys, time
from wdpm.cli import compare, main

def sleep(args):
    print("asleep", flush=True)
    time.sleep(300.0)
    return 0

compare.run = sleep
sys.exit(main.main({COMMAND}))
"""
"""A process with a command that lasts, and says when it has begun."""

TALKER = f"""
import sys
from wdpm.cli import compare, main
from wdpm.standard_streams import take_streams

def talk(args):
    print("talks", flush=True)
    try:
        while True:
            print("one line", file=sys.stderr)
    finally:
        print("one line more " * 9, file=sys.stderr)

take_streams()
compare.run = talk
sys.exit(main.main({COMMAND}))
"""
"""A process with a command that tells more than anybody reads."""

IGNORING = ["sh", "-c", 'trap \'\' INT; exec "$0" "$@"']
"""Starts a program as a shell without job control starts what it puts in the background."""


class Interrupted:
    """As an array of Warp's is when Ctrl-C finds Python in its destructor."""

    def __del__(self) -> None:
        raise KeyboardInterrupt


@pytest.fixture(params=["raised", "ignored"])
def disposition(request: pytest.FixtureRequest) -> Iterator[Any]:
    """What SIGINT does in this process when a command begins, whatever these tests have inherited."""
    wanted: Any = {"raised": signal.default_int_handler, "ignored": signal.SIG_IGN}[request.param]
    before = signal.signal(signal.SIGINT, wanted)
    yield wanted
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("lasts", [True, False])
def test_an_interrupt_in_a_destructor_ends_a_command(
    lasts: bool, disposition: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def command(_: argparse.Namespace) -> int:
        Interrupted()
        if lasts:
            time.sleep(300.0)
        return 0

    monkeypatch.setattr(compare, "run", command)
    assert main.main(COMMAND) == 130
    assert capsys.readouterr().err == "wdpm: interrupted\n"
    assert signal.getsignal(signal.SIGINT) is disposition


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (None, None)])
def test_an_interrupt_outlives_a_compiled_module(
    number: int | None, code: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As OpenEXR's, which is imported when there is something to write."""

    def command(_: argparse.Namespace) -> int:
        try:
            if number is not None:
                signal.raise_signal(number)
        except KeyboardInterrupt:
            pass
        raise ImportError("initialization failed")

    monkeypatch.setattr(compare, "run", command)
    if code is None:
        with pytest.raises(ImportError):
            main.main(COMMAND)
    else:
        assert main.main(COMMAND) == code


@pytest.mark.parametrize(
    ("starter", "number", "code", "word"),
    [
        ([], signal.SIGINT, 130, "interrupted"),
        (IGNORING, signal.SIGINT, 130, "interrupted"),
        ([], signal.SIGTERM, 143, "terminated"),
        ([], signal.SIGHUP, 129, "hung up"),
    ],
    ids=["plain", "ignored", "terminated", "hung up"],
)
def test_a_signal_ends_a_process(starter: list[str], number: int, code: int, word: str) -> None:
    with subprocess.Popen(
        [*starter, sys.executable, "-c", SLEEPER], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "asleep\n"
            process.send_signal(number)
            _, err = process.communicate(timeout=WAIT_S)
        finally:
            process.kill()
    assert (process.returncode, err) == (code, f"wdpm: {word}\n")


@pytest.mark.skipif(sys.platform != "linux", reason="a pipe tells there how much is in it")
@pytest.mark.parametrize("starter", [[], IGNORING], ids=["plain", "ignored"])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_who_reads_no_more_does_not_hold_up_the_end(starter: list[str], number: int) -> None:
    """As `| less` holds a command that tells how far it is; but not once that is to end."""
    with subprocess.Popen(
        [*starter, sys.executable, "-c", TALKER], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stderr is not None
            assert process.stdout.readline() == b"talks\n"
            before = -1
            while (unread := waiting_in(process.stderr.fileno())) != before:
                before = unread
                time.sleep(0.2)
            process.send_signal(number)
            assert process.wait(WAIT_S) == 128 + number
        finally:
            process.kill()


def waiting_in(pipe: int) -> int:
    """Bytes that nobody has read yet."""
    counted = fcntl.ioctl(pipe, termios.FIONREAD, bytes(4))
    return int.from_bytes(counted, sys.byteorder)


@pytest.mark.parametrize(
    ("number", "manager"),
    [(signal.SIGINT, interrupts_raise), (signal.SIGTERM, termination_raises), (signal.SIGHUP, termination_raises)],
)
def test_a_handler_of_somebody_else_stays(number: int, manager: Any) -> None:
    def handler(*_: object) -> None: ...

    before = signal.signal(number, handler)
    try:
        with manager():
            assert signal.getsignal(number) is handler
    finally:
        signal.signal(number, before)


def test_a_terminated_slave_says_goodbye() -> None:
    """As schedulers end it; another one may take its place."""
    with MasterServer("tcp://127.0.0.1:0", 1) as master:
        command = [sys.executable, "-m", "wdpm", "slave", master.endpoint]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            joined = process.stderr.readline()
            assert "joined" in joined
            process.send_signal(signal.SIGTERM)
            _, err = process.communicate(timeout=WAIT_S)
        # A signal that comes between a line's write and its end (standard_streams.py) has it written once more.
        assert (process.returncode, err.removeprefix(joined)) == (143, "wdpm: terminated\n")
        session = make_session(1, 2)
        slave = SlaveThread(master.endpoint, agreed=versions())
        result = master.render(session)
        check_picture(session, result.layers)
        assert [statistics["slave"] for statistics in result.statistics] == [1]
    assert slave.end() is None


@pytest.mark.usefixtures("disposition")
def test_a_command_runs_in_any_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the main thread may set handlers; a notebook's server has commands run in others."""
    monkeypatch.setattr(compare, "run", lambda _: 0)
    codes: list[int] = []
    thread = threading.Thread(target=lambda: codes.append(main.main(COMMAND)))
    thread.start()
    thread.join()
    assert codes == [0]


def test_other_exceptions_in_destructors_go_where_they_went(monkeypatch: pytest.MonkeyPatch) -> None:
    class Faulty:
        def __del__(self) -> None:
            raise ValueError("of a fault")

    told: list[str] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda unraisable: told.append(str(unraisable.exc_value)))
    before = sys.unraisablehook
    with no_lost_interrupts():
        Faulty()
    assert told == ["of a fault"]
    assert sys.unraisablehook is before
