"""The Cornell box over real processes and sockets: the same bits as in one process."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wdpm
from wdpm.cluster.messages import protocol
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.transport.host_share import PREFIX, host_share
from wdpm.progress import SilentProgress

pytestmark = pytest.mark.sockets

SETTINGS: dict[str, Any] = {"photons": 5000, "spp": 2, "k": 20}


def pixels(image: wdpm.Image) -> Mapping[str, Any]:
    """All layers but the one that shows the partition."""
    return {name: layer for name, layer in image.layers.items() if name != "cell"}


@pytest.fixture(scope="module")
def scene() -> wdpm.Scene:
    return wdpm.load("cornell-box", size=(48, 40))


@pytest.fixture(scope="module")
def alone(scene: wdpm.Scene) -> wdpm.Image:
    return wdpm.render(scene, **SETTINGS)


@pytest.mark.parametrize(("slaves", "copies"), [(2, Copies.NONE), (3, Copies.AUTO)])
def test_a_cluster_gives_the_bits_of_one_process(
    slaves: int, copies: Copies, scene: wdpm.Scene, alone: wdpm.Image
) -> None:
    expected = pixels(alone)
    with wdpm.Cluster.local(slaves=slaves, copies=copies) as cluster:
        for routing in wdpm.Routing:
            image = cluster.render(scene, **SETTINGS, routing=routing)
            assert pixels(image).keys() == expected.keys()
            for name, layer in pixels(image).items():
                np.testing.assert_array_equal(layer.view(np.uint32), expected[name].view(np.uint32))
        report = image.metadata["report"]
        assert len(report["slaves"]) == slaves
        assert sum(slave["photons"] for slave in report["slaves"]) == report["photons"]["stored"] > 0
        travelled = sum(slave["rays_in"] for slave in report["slaves"])
        assert travelled > 0 if copies is Copies.NONE else travelled == 0
        for slave in report["slaves"]:
            check_account(slave, alone=copies is not Copies.NONE)
        assert not any(slave["spent_s"] or slave["messages"] for slave in alone.metadata["report"]["slaves"])


def check_account(slave: dict[str, Any], *, alone: bool) -> None:
    """What a slave must tell of its time and its messages, however long it took."""
    spent, messages = slave["spent_s"], slave["messages"]
    assert tuple(spent) == protocol.SPENT
    assert min(spent.values()) >= 0
    assert spent[protocol.COMPUTING] > 0
    assert messages["Statistics"] == messages["ViewSet"] == 1
    batches = sum(slave["batches_by_rays"].values())
    assert batches == sum(slave["batches_by_bytes"].values()) >= messages.get("PeerBatches", 0)
    assert (batches > 0) == ("PeerBatches" in messages)
    if not alone:
        assert batches > 0
        # Each has at least the power of two that it is counted under.
        below = sum(int(power) * count for power, count in slave["batches_by_bytes"].items())
        assert 0 < below <= slave["bytes_out"]


class Kill(SilentProgress):
    """Kills a process when a phase begins, and keeps in mind what slaves had made for each other by then."""

    def __init__(self, phase: str, process: int, folder: Path) -> None:
        self._phase = phase
        self._process = process
        self._folder = folder
        self.made: list[Path] | None = None

    def start(self, phase: str, total: int | None = None) -> None:  # noqa: ARG002
        if phase == self._phase and self.made is None:
            self.made = list(self._folder.glob(f"{PREFIX}*"))
            os.kill(self._process, signal.SIGKILL)


@pytest.mark.skipif(host_share(Path()) is None, reason="only Linux has such memory")
@pytest.mark.parametrize("phase", ["map", "render"])
def test_a_killed_slave_leaves_nothing_and_others_make_what_it_made(
    phase: str, scene: wdpm.Scene, alone: wdpm.Image
) -> None:
    with wdpm.Cluster.local(slaves=3) as cluster:
        folder = Path(cluster.endpoint.removeprefix("ipc://")).parent
        victim = cluster.processes[-1]
        kill = Kill(phase, victim, folder)
        image = cluster.render(scene, **SETTINGS, progress=kill)
        for name, layer in pixels(image).items():
            np.testing.assert_array_equal(layer.view(np.uint32), pixels(alone)[name].view(np.uint32))
        assert kill.made
        assert victim not in cluster.processes
    assert not folder.exists()
