"""What more cores would bring: reckoned from schedules whose ends are known, and from a render."""

from __future__ import annotations

import json
import threading
from pathlib import Path as File

import pytest
import warp as wp

from wdpm.bench.cores import recorder as module
from wdpm.bench.cores.measure import OnCores, Reckoned, measure
from wdpm.bench.cores.recorder import Recorder, TimedLauncher
from wdpm.bench.cores.schedule import Alone, Path, Phase, Render, arrivals, last_end
from wdpm.cli.main import main
from wdpm.cluster.work.processes.forked_tasks import can_fork
from wdpm.devices import available_cores
from wdpm.progress import SilentProgress
from wdpm.scenes.errors import SettingsError

forks = pytest.mark.skipif(not can_fork("cpu"), reason="processes are forked on Linux alone")


@pytest.mark.parametrize(
    ("durations", "ready", "end"),
    [
        ([], [0.0, 0.0], 0.0),
        ([3.0], [1.0, 2.0], 4.0),
        ([1.0, 1.0, 1.0, 1.0], [0.0, 0.0], 2.0),
        ([1.0, 1.0, 5.0], [0.0, 0.0], 6.0),  # in this order: the long one comes last
        ([5.0, 1.0, 1.0], [0.0, 0.0], 5.0),
        ([1.0, 1.0, 1.0], [0.0, 10.0], 3.0),  # who comes late has nothing to do
        ([2.0, 2.0], [0.5, 1.0], 3.0),
    ],
)
def test_tasks_go_to_who_is_free_first(durations: list[float], ready: list[float], end: float) -> None:
    assert last_end(durations, ready) == end


def test_processes_come_one_after_another() -> None:
    assert arrivals(3, 2.0, together=False) == [2.0, 4.0, 6.0]


@pytest.mark.parametrize(
    ("count", "begins"),
    [
        (0, []),
        (1, [1.0]),
        (2, [2.0, 1.0]),
        # The first forks 2, which forks 3; then 1; then 0.
        (4, [3.0, 2.0, 2.0, 2.0]),
    ],
)
def test_processes_that_fork_each_other_begin_once_they_have(count: int, begins: list[float]) -> None:
    assert arrivals(count, 1.0, together=True) == begins


def test_sixteen_processes_are_there_after_five_forks() -> None:
    assert max(arrivals(16, 1.0, together=True)) == 5.0
    assert max(arrivals(16, 1.0, together=False)) == 16.0


def test_what_is_done_alone_takes_as_long_on_any_cores() -> None:
    assert Alone(2.0).path(16) == Path(alone=2.0)


def test_launches_take_as_long_as_their_chunks_on_all_cores() -> None:
    alone = Alone(1.0, ((1.0, 1.0, 1.0, 1.0), (3.0, 1.0)))
    assert alone.path(1) == Path(alone=1.0, launches=8.0)
    assert alone.path(2) == Path(alone=1.0, launches=2.0 + 3.0)
    assert alone.path(4) == Path(alone=1.0, launches=1.0 + 3.0)


def test_what_is_done_beside_is_hidden_where_there_are_cores_for_it() -> None:
    alone = Alone(2.0, ((1.0, 1.0),), beside=3.0)
    assert alone.path(4) == Path(alone=2.0, launches=1.0)
    assert alone.path(2) == Path(alone=2.0, launches=1.0, even=0.5)  # 7 s of work on two cores
    assert alone.path(1).seconds == 7.0


def test_a_phase_is_its_tasks_and_who_waits() -> None:
    assert Phase((2.0, 2.0, 2.0, 2.0), there=2).path(2) == Path(even=4.0)
    assert Phase((2.0, 2.0, 2.0), there=2).path(2) == Path(even=3.0, waiting=1.0)
    late = Phase((2.0, 2.0), forked=2, fork=0.5, together=False)
    assert late.path(2) == Path(even=2.0, waiting=1.0)


def test_a_first_process_that_is_busy_takes_a_share() -> None:
    assert Phase((2.0, 2.0), there=2, first_process=1.0).path(2) == Path(even=2.5)


def test_processes_are_no_more_than_cores() -> None:
    """Those of the pass before have ended when others are forked."""
    assert Phase((1.0, 1.0), there=2, forked=2).path(2) == Path(even=1.0)


def test_a_render_is_the_sum_of_its_parts() -> None:
    render = Render([Alone(1.0), Phase((2.0, 2.0, 2.0), there=2), Alone(0.5)])
    assert render.path(2) == Path(alone=1.5, even=3.0, waiting=1.0)
    assert render.path(2).seconds == 5.5
    assert render.tasks == 3
    assert (render.path(2) - Path(alone=0.5)).seconds == 5.0


class Clock:
    """CPU time of a thread, and of its process, that a test lets pass."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.thread = self.process = 0.0
        monkeypatch.setattr(module.time, "thread_time", lambda: self.thread)
        monkeypatch.setattr(module.time, "process_time", lambda: self.process)
        monkeypatch.setattr(module, "can_fork_siblings", lambda: False)
        monkeypatch.setattr(module, "forks_of_the_first", lambda count: count)

    def let_pass(self, thread: float, others: float = 0.0) -> None:
        self.thread += thread
        self.process += thread + others


def test_a_render_is_taken_down_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    recorder = Recorder()
    clock.let_pass(1.5, 3.0)
    recorder.launched([0.5, 1.0, 1.5], 0.5)  # of the 1.5 s of this thread, and the 3 s of others
    clock.let_pass(0.5)
    recorder.forked(2, 0.5)
    for number in (7, 8):
        recorder.handed_out(number)
    clock.let_pass(0.25)
    recorder.handed_out(9)
    for number, cpu_s in ((8, 3.0), (7, 2.0), (9, 1.0)):
        recorder.done(number, cpu_s)
    clock.let_pass(4.0)
    recorder.handed_out(7)  # of another phase
    recorder.done(7, 6.0)
    clock.let_pass(0.125)
    assert recorder.end().parts == [
        Alone(1.0, ((0.5, 1.0, 1.5),), 0.5),
        Phase((2.0, 3.0, 1.0), forked=2, fork=0.25, together=False, first_process=0.25),
        Alone(4.0),
        Phase((6.0,), there=2, together=False),
        Alone(0.125),
    ]
    clock.let_pass(2.0)
    assert recorder.end().parts == [Alone(2.0)]


@wp.kernel
def number_all(offset: int, numbers_out: wp.array(dtype=int)) -> None:
    item = offset + wp.tid()
    numbers_out[item] = item


def test_launches_that_the_rendering_thread_cuts_are_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    cut: list[int] = []
    monkeypatch.setattr(Recorder, "launched", lambda _, chunks, __: cut.append(len(chunks)))
    launcher = TimedLauncher(2, Recorder())

    def number(count: int) -> list[int]:
        numbers = wp.zeros(count, dtype=int, device="cpu")
        launcher(number_all, count, grain=4, numbers_out=numbers)
        return list(numbers.numpy())

    assert number(3) == [0, 1, 2]
    assert cut == []
    assert number(12) == list(range(12))
    assert cut == [3]
    other = threading.Thread(target=number, args=(12,))
    other.start()
    other.join()
    assert cut == [3]
    launcher.stop_threads()


@forks
def test_a_render_is_reckoned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.rendering.in_process.WORTH_FORKING", 48 * 32)
    found = measure("cornell-box", [3, 2], SilentProgress(), size=(48, 32), spp=2)
    assert [run.cores for run in found.runs] == [1, 2, 3]
    assert [run.tasks > 0 for run in found.runs] == [False, True, True]
    alone, *others = found.runs
    assert alone.path.waiting == alone.path.launches == 0.0
    assert all(run.path.even > 0 for run in others)
    assert found.times(alone) == 1.0
    assert others[-1].wall_s is None or available_cores() > 2


def made() -> OnCores:
    runs = (
        Reckoned(1, Path(alone=8.0), 0, 8.5),
        Reckoned(16, Path(alone=0.5, launches=0.25, even=0.2, waiting=0.05), 229, None),
    )
    return OnCores("hall.xml", "hall.xml: 8x8, 4 samples", runs)


def test_the_table_says_that_it_is_a_reckoning() -> None:
    grid = made().grid()
    assert [row[:3] for row in grid.rows] == [("1", "8.00 s", "1.00"), ("16", "1.00 s", "8.00")]
    assert [row[-1] for row in grid.rows] == ["8.50 s", "-"]
    assert grid.notes[0].startswith("Reckoned, not measured")


def test_the_command(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: File) -> None:
    asked: list[object] = []

    def noted(name: str, cores: tuple[int, ...], _: object, **chosen: object) -> OnCores:
        asked.append((name, cores, chosen))
        return made()

    monkeypatch.setattr("wdpm.bench.cores.measure.measure", noted)
    out = tmp_path / "cores.json"
    assert main(["bench", "cores", "cornell-box", "--cores", "2,16", "--spp", "4", "--json", str(out)]) == 0
    assert asked == [("cornell-box", (2, 16), {"size": None, "spp": 4})]
    assert "hall.xml: 8x8, 4 samples" in capsys.readouterr().out
    [scene] = json.loads(out.read_text())["cores"]
    assert [run["times_as_fast"] for run in scene["runs"]] == [1.0, 8.0]
    assert scene["runs"][1]["path"]["seconds"] == 1.0


@pytest.mark.parametrize(("cores", "error"), [("0", "--cores"), ("2,x", "--cores"), ("5000", "at most 4096 processes")])
def test_cores_that_cannot_be(cores: str, error: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["bench", "cores", "cornell-box", "--cores", cores])
    except SystemExit as end:
        code = end.code
    assert code == 2
    assert error in capsys.readouterr().err


def test_a_system_that_forks_no_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.bench.cores.measure.can_fork", lambda _: False)
    with pytest.raises(SettingsError, match="nothing to be reckoned"):
        measure("cornell-box", [2], SilentProgress())
