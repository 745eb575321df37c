"""wdpm on a real Dask cluster of processes: the bits of one process, also where workers are lost and come."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from digests import same_bits
from patience import wait_until

import wdpm
from wdpm.cli.main import main
from wdpm.cluster.master.events import NotComing, StillAwaited
from wdpm.cluster.plan.copies import Copies
from wdpm.images.image import Image, load
from wdpm.progress import Progress
from wdpm.scenes.errors import ClusterError, SettingsError

dask_config = pytest.importorskip("dask.config", reason="Dask is not installed: pip install 'wdpm[dask]'")
distributed = pytest.importorskip("distributed", reason="distributed is not installed: pip install 'wdpm[dask]'")

from wdpm.placing.dask_slaves import MOST_FAILURES, NO_WORKERS, DaskSlaves  # noqa: E402 - needs distributed

# Dask's own sockets and event loops are closed by its garbage collection.
pytestmark = [pytest.mark.dask, pytest.mark.filterwarnings("default")]

SETTINGS: dict[str, Any] = {"photons": 20_000, "spp": 32}


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """Of two workers, in processes of their own, that nannies watch.

    15 s after it has lost a worker, a LocalCluster looks whether the nanny has started another one; if that one has
    just been killed as well, the nanny is closed, and never starts one again. Here, where workers are killed again and
    again, it waits for longer.
    """
    with (
        dask_config.set({"distributed.deploy.lost-worker-timeout": "1h"}),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, memory_limit="3GB", dashboard_address=None) as dask,
        distributed.Client(dask) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def scene() -> wdpm.Scene:
    return wdpm.load("cornell-box", size=(96, 96))


@pytest.fixture(scope="module")
def alone(scene: wdpm.Scene) -> Image:
    return wdpm.render(scene, **SETTINGS)


class At(Progress):
    """Does something once when a phase has come so far."""

    def __init__(self, phase: str, do: Any) -> None:
        self._phase = phase
        self._do = do
        self.notes: list[str] = []

    def start(self, phase: str, total: int | None = None) -> None:  # noqa: ARG002
        if phase == self._phase and self._do is not None:
            do, self._do = self._do, None
            do()

    def note(self, text: str) -> None:
        self.notes.append(text)


def slaves_of(client: Any) -> dict[str, int]:
    """Tasks of wdpm that run, by worker."""
    running = client.processing()
    return {worker: n for worker, keys in running.items() if (n := sum("wdpm-slave" in str(key) for key in keys))}


@pytest.mark.parametrize("copies", list(Copies))
def test_the_bits_of_one_process(copies: Copies, client: Any, scene: wdpm.Scene, alone: Image) -> None:
    with wdpm.Cluster.on_dask(client, slaves=8, copies=copies) as cluster:
        image = cluster.render(scene, **SETTINGS)
        assert set(slaves_of(client).values()) == {1}
    assert same_bits(image, alone)
    slaves = image.metadata["report"]["slaves"]
    assert len(slaves) == 2
    wait_until(lambda: not slaves_of(client))
    assert client.submit(sum, [1, 2], pure=False).result(30) == 3, "Dask's own work goes on"


def test_no_more_slaves_than_are_wanted(client: Any, scene: wdpm.Scene, alone: Image) -> None:
    with wdpm.Cluster.on_dask(client, slaves=1) as cluster:
        image = cluster.render(scene, **SETTINGS)
    assert same_bits(image, alone)
    assert len(image.metadata["report"]["slaves"]) == 1


def test_workers_that_are_killed_again_and_again(client: Any, scene: wdpm.Scene, alone: Image) -> None:
    """More often than Dask lets a task lose its worker; their nannies start others, which get slaves."""
    with wdpm.Cluster.on_dask(client) as cluster:
        for _ in range(4):
            wait_until(lambda: len(slaves_of(client)) == 2)
            victim = sorted(slaves_of(client))[0]
            process = client.run(os.getpid, workers=[victim])[victim]
            watched = At("render", lambda process=process: os.kill(process, signal.SIGKILL))
            image = cluster.render(scene, **SETTINGS, progress=watched)
            assert same_bits(image, alone)
            wait_until(lambda victim=victim: victim not in client.nthreads() and len(client.nthreads()) == 2)


def test_a_worker_that_comes_later_gets_a_slave(scene: wdpm.Scene, alone: Image) -> None:
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, memory_limit="3GB", dashboard_address=None) as dask,
        distributed.Client(dask) as client,
        wdpm.Cluster.on_dask(client) as cluster,
    ):
        assert same_bits(cluster.render(scene, **SETTINGS), alone)
        dask.scale(2)
        wait_until(lambda: len(slaves_of(client)) == 2)
        wait_until(lambda: len(cluster._master.slaves()) == 2)
        image = cluster.render(scene, **SETTINGS)
        assert same_bits(image, alone)
        assert len(image.metadata["report"]["slaves"]) == 2


def test_a_worker_on_which_no_slave_runs_is_done_without(scene: wdpm.Scene, alone: Image) -> None:
    """Three times it failed there, and then the render, though others waited."""
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, memory_limit="3GB", dashboard_address=None) as dask,
        distributed.Client(dask) as client,
    ):
        broken = sorted(client.nthreads())[0]
        client.run(exec, "import os; os.environ['PYTHONHOME'] = '/nowhere'", workers=[broken])
        told = At("", None)
        with wdpm.Cluster.on_dask(client) as cluster:
            image = cluster.render(scene, **SETTINGS, progress=told)
        assert same_bits(image, alone)
        assert len(image.metadata["report"]["slaves"]) == 1
        [note] = [note for note in told.notes if "no slave runs on" in note]
        assert note.startswith(f"no slave runs on {broken}: it ended with exit code 1")


class Scheduler:
    """What DaskSlaves asks a client: workers that a test names, and tasks that run until it says otherwise."""

    asynchronous = False
    scheduler = SimpleNamespace(address="inproc://scheduler")

    def __init__(self, *workers: str) -> None:
        self.workers = set(workers)
        self.tasks: dict[str, list[SimpleNamespace]] = {}

    def nthreads(self) -> dict[str, int]:
        return dict.fromkeys(self.workers, 1)

    def submit(self, *_: Any, workers: list[str], **__: Any) -> SimpleNamespace:
        task = SimpleNamespace(status="pending", result=lambda: "it fell over", cancel=lambda: None)
        task.done = lambda: task.status == "finished"
        self.tasks.setdefault(workers[0], []).append(task)
        return task


def looked(slaves: DaskSlaves) -> list[NotComing]:
    slaves._look("tcp://127.0.0.1:1", bytes)
    return list(slaves.ended())


def test_workers_that_are_lost_or_no_good_before_all_have_joined() -> None:
    scheduler = Scheduler("inproc://a", "inproc://b", "inproc://c")
    slaves = DaskSlaves(scheduler, 8)
    assert looked(slaves) == []
    scheduler.workers.remove("inproc://a")
    assert looked(slaves) == [NotComing("inproc://a is lost", 2)]
    for times in range(MOST_FAILURES):
        assert len(scheduler.tasks["inproc://b"]) == times + 1
        scheduler.tasks["inproc://b"][-1].status = "finished"
        told = looked(slaves)
    assert told == [NotComing("no slave runs on inproc://b: it fell over", 1)]
    slaves.all_joined()
    scheduler.workers.add("inproc://d")
    assert looked(slaves) == []
    scheduler.workers.remove("inproc://d")
    assert looked(slaves) == [], "the master sees for itself who is lost"
    for _ in range(MOST_FAILURES):
        scheduler.tasks["inproc://c"][-1].status = "finished"
        slaves._look("tcp://127.0.0.1:1", bytes)
    with pytest.raises(ClusterError, match="a slave cannot run on a worker of Dask: inproc://c: it fell over"):
        list(slaves.ended())


def test_a_cluster_without_workers_is_said_once() -> None:
    """It may be one that adapts: to tasks of others."""
    scheduler = Scheduler()
    slaves = DaskSlaves(scheduler, 8)
    assert looked(slaves) == [StillAwaited(NO_WORKERS)]
    assert looked(slaves) == []
    scheduler.workers.add("inproc://a")
    assert looked(slaves) == []
    assert list(scheduler.tasks) == ["inproc://a"]


def test_slaves_that_cannot_run_are_said(client: Any, scene: wdpm.Scene) -> None:
    reason = r"a slave cannot run on a worker of Dask: tcp://.*there is no device 'cuda:9'"
    with wdpm.Cluster.on_dask(client, device="cuda:9") as cluster, pytest.raises(ClusterError, match=reason):
        cluster.render(scene, **SETTINGS)


def test_a_render_from_the_command_line(client: Any, alone: Image, tmp_path: Path) -> None:
    words = ["cornell-box", "--size", "96x96", "--photons", "20k", "--spp", "32", "-o", str(tmp_path / "box.exr"), "-q"]
    assert main(["render", *words, "--dask", client.scheduler.address, "--slaves", "2"]) == 0
    assert same_bits(load(tmp_path / "box.exr"), alone)


def test_no_scheduler(capsys: pytest.CaptureFixture[str]) -> None:
    with dask_config.set({"distributed.comm.timeouts.connect": "1s"}):
        assert main(["render", "cornell-box", "--dask", "tcp://127.0.0.1:9"]) == 1
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("wdpm:")]
    assert len(lines) == 1
    assert "no scheduler of Dask answers at tcp://127.0.0.1:9" in lines[0]


def test_what_is_no_client() -> None:
    with pytest.raises(SettingsError, match="not asynchronous"):
        wdpm.Cluster.on_dask("tcp://127.0.0.1:8786")
