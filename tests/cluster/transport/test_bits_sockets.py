"""The Cornell box over real processes and sockets: the same bits as in one process."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import wdpm
from wdpm.cluster.plan.copies import Copies

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
