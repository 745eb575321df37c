"""Clusters in simulated time, where the answer is known: one core, no links' time, links' time alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import refusal

from wdpm.bench.simulation import measure, paper
from wdpm.bench.simulation.backend import SimulatedBackend
from wdpm.bench.simulation.clock import Clock
from wdpm.bench.simulation.cluster import Hardware
from wdpm.bench.simulation.machines import Link, Machine, Processor, Thread
from wdpm.bench.simulation.measure import Description, losses
from wdpm.bench.simulation.message_costs import FREE, MessageCosts
from wdpm.bench.simulation.records import SETTING_UP, Recorder, Spent
from wdpm.cli import main
from wdpm.cluster.plan.copies import Copies
from wdpm.images.comparison import compare
from wdpm.progress import SilentProgress
from wdpm.rendering.in_process import render_in_process
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.scene_settings import settings_for
from wdpm.scenes.load import load

FAST = Link(float("inf"), 0.0)
SMALL = {"spp": 1, "photons": 2000}
SIZE = (24, 24)


def run(clock: Clock) -> float:
    """To the end."""
    while clock.step():
        pass
    return clock.now


# Processors and links.


def test_things_happen_in_order() -> None:
    clock, seen = Clock(), []
    for name, seconds in (("late", 2.0), ("first", 1.0), ("second", 1.0)):
        clock.after(seconds, lambda name=name: seen.append((name, clock.now)))  # type: ignore[misc]
    assert run(clock) == 2.0
    assert seen == [("first", 1.0), ("second", 1.0), ("late", 2.0)]


@pytest.mark.parametrize(("cores", "expected"), [(1, [3.0, 5.0, 6.0]), (2, [1.5, 2.5, 3.5]), (3, [1.0, 2.0, 3.0])])
def test_threads_share_cores_evenly(cores: int, expected: list[float]) -> None:
    """Work of 1, 2 and 3 seconds that begins together. Two cores: each has 2/3 of one until 1.5, then one each."""
    clock, ended = Clock(), []
    processor = Processor(clock, cores)
    for seconds in (1.0, 2.0, 3.0):
        processor.run(seconds, lambda: ended.append(clock.now))
    run(clock)
    assert ended == pytest.approx(expected)


def test_work_that_begins_later_slows_others_from_then_on() -> None:
    clock, ended = Clock(), []
    processor = Processor(clock, 1)
    processor.run(2.0, lambda: ended.append(("first", clock.now)))
    clock.after(1.0, lambda: processor.run(0.5, lambda: ended.append(("second", clock.now))))
    run(clock)
    assert ended == [("second", pytest.approx(2.0)), ("first", pytest.approx(2.5))]


def test_a_thread_does_one_thing_after_another() -> None:
    clock, seen = Clock(), []
    thread = Thread(Processor(clock, 4))
    for number in range(3):
        thread.submit(lambda number=number: (1.0, lambda: seen.append((number, clock.now))))  # type: ignore[misc]
    assert run(clock) == 3.0
    assert seen == [(0, 1.0), (1, 2.0), (2, 3.0)]
    assert thread.busy_s == 3.0


def arrivals(link: Link, sends: list[tuple[int, int, int]], machines: int = 3) -> tuple[list[float], list[Machine]]:
    """When messages come that are sent together: from, to, bytes."""
    clock = Clock()
    there = [Machine(clock, 1, link) for _ in range(machines)]
    came: dict[int, float] = {}
    for number, (source, target, size) in enumerate(sends):
        there[source].send(there[target], size, lambda number=number: came.setdefault(number, clock.now))  # type: ignore[misc]
    run(clock)
    return [came[number] for number in range(len(sends))], there


def test_a_message_takes_latency_and_its_bytes() -> None:
    assert arrivals(Link(1e6, 0.25), [(0, 1, 500_000)])[0] == pytest.approx([0.75])


def test_a_machine_sends_one_message_at_a_time() -> None:
    came, there = arrivals(Link(1e6, 0.25), [(0, 1, 500_000), (0, 2, 500_000)])
    assert came == pytest.approx([0.75, 1.25])
    assert there[0].wire_s == pytest.approx(1.0)
    assert (there[0].sent, there[1].received) == (1_000_000, 500_000)


def test_a_machine_receives_one_message_at_a_time() -> None:
    assert arrivals(Link(1e6, 0.25), [(0, 2, 500_000), (1, 2, 500_000)])[0] == pytest.approx([0.75, 1.25])


def test_both_directions_go_at_once() -> None:
    assert arrivals(Link(1e6, 0.25), [(0, 1, 500_000), (1, 0, 500_000)])[0] == pytest.approx([0.75, 0.75])


def test_messages_within_a_machine_use_no_link() -> None:
    assert arrivals(Link(1.0, 9.0), [(0, 0, 500_000)])[0] == [0.0]


# Whole clusters.


def session_seconds(slaves: int, link: Link, team: int, messages: MessageCosts = FREE) -> tuple[float, Recorder]:
    scene = load("cornell-box", size=SIZE)
    settings = settings_for(scene, **SMALL)
    hardware = Hardware(slaves, slaves, 1, link, messages)
    with SimulatedBackend(hardware, team) as backend:
        image = render_in_passes(scene, backend, settings)
        expected = render_in_process(scene, settings, workers=1, threads=1)
        assert compare(measure.pixels(image), measure.pixels(expected)).bits_equal
        return backend.session_s, backend.recorders[0]


def total(recorder: Recorder) -> float:
    return sum(phase.spent.busy_s for phase in recorder.phases)


def test_one_slave_on_one_core_takes_the_sum_of_all_that_is_computed() -> None:
    seconds, recorder = session_seconds(1, FAST, 1)
    assert seconds == pytest.approx(total(recorder), rel=1e-6)


def test_a_fast_network_leaves_no_more_time_than_there_is_work() -> None:
    seconds, recorder = session_seconds(3, FAST, 3)
    assert total(recorder) / 3 <= seconds <= total(recorder)
    assert sum(recorder.messages.values()) > 30


def test_a_slow_link_takes_the_bytes_that_go_over_it() -> None:
    rate = 20_000.0
    seconds, recorder = session_seconds(2, Link(rate, 0.0), 2)
    busiest = max(sum(phase.spent.wires[machine] for phase in recorder.phases) for machine in (0, 1))
    assert busiest > 4 * total(recorder)
    assert busiest <= seconds <= sum(recorder.sizes.values()) / rate + total(recorder)


def test_latency_counts_once_for_every_step_that_waits_for_another() -> None:
    near, far = (session_seconds(2, Link(float("inf"), latency), 2) for latency in (0.0, 5.0))
    steps = (far[0] - near[0]) / 5.0
    # Setup and cells, their answers; photons; maps; view; buckets; statistics: each there and back at least once.
    assert 10 <= steps <= sum(far[1].messages.values())


def test_messages_cost_the_processors_at_both_ends() -> None:
    free, dear = (session_seconds(2, FAST, 2, costs)[1] for costs in (FREE, MessageCosts(0.25, 0.5, 0.0)))
    count = sum(dear.messages.values())
    spent = sum(sum(phase.spent.messages) + phase.spent.master for phase in dear.phases)
    assert spent == pytest.approx(2 * 0.75 * count, abs=0.1 * count)
    assert sum(sum(phase.spent.messages) for phase in free.phases) < 0.1 * count


def test_losses_add_up() -> None:
    """Two slaves, 1 s planned, then 4 s in which they compute 3 s and 2 s, 0.5 s of messages, where one takes 5 s."""
    recorder = Recorder()
    recorder.phase(SETTING_UP, 0.0, Spent((0.0, 0.0), (0.0, 0.0), 0.0, (0.0, 0.0)))
    recorder.phase("render", 0.0, Spent((0.0, 0.0), (0.0, 0.0), 0.0, (0.0, 0.0)))
    recorder.phase("", 4.0, Spent((3.0, 2.0), (0.25, 0.125), 0.125, (0.0, 0.0)))
    lost = losses([recorder], Hardware(2, 2, 1, FAST, FREE), 1.0, 5.0)
    expected = {"plan": 0.1, "repeated": 0.1, "messages": 0.05, "render": 0.25}
    assert lost == pytest.approx({**dict.fromkeys(lost, 0.0), **expected})
    assert sum(lost.values()) + 5.0 / 10.0 == pytest.approx(1.0)


def test_simulations_with_copies_and_without() -> None:
    description = Description(Link(1.25e9, 50e-6))
    figures = measure.simulate("cornell-box", (2,), tuple(Copies), description, SilentProgress(), size=SIZE, **SMALL)
    assert [(run.slaves, run.copies) for run in figures.runs] == [(2, "none"), (2, "auto")]
    assert all(run.bits_equal for run in figures.runs)
    assert all(sum(run.lost.values()) == pytest.approx(1.0 - run.speed_up / run.slaves) for run in figures.runs)
    assert all(run.inflation > 1.0 for run in figures.runs)
    assert [run.triangles == 1.0 for run in figures.runs] == [False, True]
    assert figures.runs[0].sent > 0


# The command.


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "simulated.json"
    words = "bench scaling cornell-box --simulate 2..2 --copies auto --link 1Gb --latency 1ms --size 16x16 --spp 1"
    picture = tmp_path / "speed.svg"
    assert main.main([*words.split(), "--photons", "1k", "--json", str(file), "--plot", str(picture)]) == 0
    assert "most lost to" in picture.read_text()
    [scene] = json.loads(file.read_text())["simulated"]
    assert scene["hardware"] == (
        "slaves of one thread, a machine each with 1 core, the master on the first; "
        "1 Gbit/s and 1000 us between machines"
    )
    assert scene["runs"][0]["bits_equal"]
    assert "Simulated: slaves of one thread" in capsys.readouterr().out


def test_the_papers_table(capsys: pytest.CaptureFixture[str]) -> None:
    words = "bench paper cornell-box --simulate --slaves 0,4 --size 16x16 --spp 1 --photons 1k"
    assert main.main(words.split()) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "1.8-2.8; 0.33-0.34; 0.27-0.28; 1.5e-6 to 6.7e-5" in shown
    assert "* simulated: slaves of one thread, a machine each" in shown


def test_the_papers_scenes_are_looked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(paper.FOLDER, str(tmp_path))
    assert paper.paper_scenes() == paper.STAND_INS
    (tmp_path / "sponza").mkdir()
    file = tmp_path / "sponza" / "scene.xml"
    file.write_text("<scene/>")
    assert paper.paper_scenes() == (str(file),)


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--plot", "speed.svg", "give --simulate"),
        ("--simulate", "512", "at most 256 slaves"),
        ("--simulate", "8..2", "has no size in it"),
        ("--link", "10", "is no bandwidth"),
        ("--link", "0Gb", "is no bandwidth"),
        ("--latency", "50", "is no latency"),
        ("--memory", "2G --simulate 2..4", "simulated ones have room"),
    ],
)
def test_mistakes_are_one_line(option: str, value: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert words in refusal(["bench", "scaling", "cornell-box", option, *value.split()], capsys)
