"""Progress: bars for a terminal, few lines for a log, nothing if quiet."""

from __future__ import annotations

import io
from collections.abc import Callable

import pytest
from rich.console import Console

from wdpm.progress import BarProgress, PlainProgress, SilentProgress, TimeLeft, make_progress


class Clock:
    """A clock that stands still until it is moved."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class FlushCounter(io.StringIO):
    flushes = 0

    def flush(self) -> None:
        self.flushes += 1
        super().flush()


def test_plain_lines_come_at_most_every_two_seconds() -> None:
    stream, clock = FlushCounter(), Clock()
    progress = PlainProgress(stream, clock)
    progress.start("render", 100)
    for _ in range(50):
        clock.now += 0.125
        progress.advance(2)
    progress.finish()
    progress.finish()
    lines = stream.getvalue().splitlines()
    assert lines == [
        "render ...",
        "render: 32 of 100 (32%), about 4 s left",
        "render: 64 of 100 (64%), about 2 s left",
        "render: 96 of 100 (96%), about 0 s left",
        "render: done in 6.2 s",
    ]
    assert stream.flushes >= len(lines)


def test_signs_of_life_are_no_lines_where_nothing_more_is_done() -> None:
    stream, clock = io.StringIO(), Clock()
    progress = PlainProgress(stream, clock)
    clock.now += 10
    progress.advance(0)
    progress.start("compile")
    clock.now += 10
    progress.advance(0)
    progress.start("render", 10)
    for amount in (0, 0, 3, 0, 0):
        clock.now += 10
        progress.advance(amount)
    assert stream.getvalue().splitlines() == [
        "compile ...",
        "compile: done in 10.0 s",
        "render ...",
        "render: 0 of 10 (0%)",
        "render: 3 of 10 (30%), about 47 s left",
    ]


def test_the_time_left_is_in_proportion() -> None:
    left = TimeLeft(5.0, 400)
    assert left.seconds(5.0) is None
    for second in range(1, 11):
        left.advance(5.0 + second, 10)
    assert left.seconds(15.0) == pytest.approx(30.0)


def test_the_time_left_goes_by_what_is_fast_now() -> None:
    """Something had to be waited for at first: kernels, or a slave."""
    left = TimeLeft(0.0, 300)
    for tenth in range(31, 151):
        left.advance(tenth / 10, 1)
    assert left.seconds(15.0) == pytest.approx(18.0, rel=0.05)


@pytest.mark.parametrize(
    "done",
    [
        lambda second: second**2,  # ever faster
        lambda second: 1 if second < 8 else 100,  # a first unit that took long
        lambda second: 100 if second < 5 else 101,
        lambda second: 0 if second < 10 else 5,
    ],
)
def test_of_uneven_work_no_end_is_foretold(done: Callable[[int], int]) -> None:
    left, before = TimeLeft(0.0, 1000), 0
    for second in range(1, 11):
        left.advance(float(second), done(second) - before)
        before = done(second)
    assert left.seconds(10.0) is None


def test_plain_lines_of_several_phases_notes_and_a_failure() -> None:
    stream, clock = io.StringIO(), Clock()
    progress = PlainProgress(stream, clock)
    progress.start("load")
    progress.note("3 triangles dropped")
    clock.now += 3
    progress.advance()
    progress.start("partition", 4)
    progress.advance()
    progress.start("render", 10)
    progress.finish()
    assert stream.getvalue().splitlines() == [
        "load ...",
        "3 triangles dropped",
        "load: 1",
        "load: done in 3.0 s",
        "partition ...",
        "partition: went on at 1 of 4 in 0.0 s",
        "render ...",
        "render: stopped at 0 of 10 in 0.0 s",
    ]


def test_bars_show_every_phase_and_notes() -> None:
    stream = io.StringIO()
    progress = BarProgress(Console(file=stream, force_terminal=True, width=100, no_color=True))
    progress.start("load")
    progress.note("compiling [kernels], once")
    progress.start("render", 4)
    progress.advance(3)
    progress.finish()
    progress.finish()
    text = stream.getvalue()
    assert "compiling [kernels], once" in text
    last = text.rsplit("load", 1)[-1]
    assert "1/1" in last
    assert "render" in last
    assert "3/4" in last


def test_a_terminal_gets_bars_a_file_gets_lines_and_quiet_gets_nothing() -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    bars = make_progress(stream=Terminal())
    bars.finish()
    assert isinstance(bars, BarProgress)
    assert isinstance(make_progress(stream=io.StringIO()), PlainProgress)
    assert isinstance(make_progress(quiet=True, stream=Terminal()), SilentProgress)


def test_silence(capsys: pytest.CaptureFixture[str]) -> None:
    progress = make_progress(quiet=True)
    progress.start("render", 2)
    progress.advance()
    progress.note("anything")
    progress.finish()
    assert capsys.readouterr() == ("", "")
