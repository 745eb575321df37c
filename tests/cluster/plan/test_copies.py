"""How many slaves hold the scene together, by the memory that they have."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.cluster.host_memory import PROCESS_BYTES, SHARE_OF_MEMORY, SlaveMemory
from wdpm.cluster.plan.copies import (
    PHOTON_BYTES,
    POINT_BYTES,
    Copies,
    SceneMemory,
    Sharing,
    largest_team,
    points_of,
    scene_memory,
    sharing,
)
from wdpm.kernels.limits import POINTS_LEAST, POINTS_MOST
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.model.textures import Bitmap

GIB = 1 << 30


def slave(room: float) -> SlaveMemory:
    return SlaveMemory("here", 0, round(room) + PROCESS_BYTES)


@pytest.mark.parametrize(("room", "team_size"), [(4, 1), (2, 2), (1.5, 3), (1, 4)])
def test_as_few_as_have_room(room: float, team_size: int) -> None:
    slaves = [slave(room * GIB)] * 4
    assert sharing(Copies.AUTO, slaves, SceneMemory(4 * GIB)).team_size == team_size
    assert sharing(Copies.NONE, slaves, SceneMemory(4 * GIB)).team_size == 4


def test_slaves_of_one_machine_share_its_memory() -> None:
    machine = round((8 * GIB + 4 * PROCESS_BYTES) / SHARE_OF_MEMORY)
    together = [SlaveMemory("one", machine)] * 4
    apart = [SlaveMemory(f"machine {index}", machine) for index in range(4)]
    assert sharing(Copies.AUTO, together, SceneMemory(4 * GIB)).team_size == 2
    assert sharing(Copies.AUTO, apart, SceneMemory(4 * GIB)).team_size == 1


def test_textures_lie_with_every_slave() -> None:
    texture = Bitmap("t", pixels=np.zeros((512, 1024, 3), np.float32))
    assert scene_memory(1000, 0, [texture], 1000).everywhere == scene_memory(1000, 0, [texture]).everywhere + 9000
    needed = scene_memory(1000, 0, [texture, texture])
    assert needed.everywhere == 24 * (2 << 19)
    slaves = [slave(3 * GIB)] * 3
    assert sharing(Copies.AUTO, slaves, SceneMemory(3 * GIB)).team_size == 1
    assert sharing(Copies.AUTO, slaves, SceneMemory(3 * GIB, 1 * GIB)).team_size == 2
    with pytest.raises(
        SettingsError, match=r"take about 3.0 GiB, textures and grids of 2.5 GiB in each; 3 slaves have room for"
    ):
        sharing(Copies.AUTO, slaves, SceneMemory(3 * GIB, 2.5 * GIB))


def test_too_little_memory_in_all() -> None:
    expected = r"take about 4.0 GiB; 2 slaves have room for 1.5 GiB each .*: use more slaves, fewer photons"
    with pytest.raises(SettingsError, match=expected):
        sharing(Copies.AUTO, [slave(1.5 * GIB)] * 2, SceneMemory(4 * GIB))
    with pytest.raises(SettingsError, match=r"have room for 0\.0 GiB each"):
        sharing(Copies.AUTO, [SlaveMemory("here", 0, 1)], SceneMemory(1.0))


@pytest.mark.parametrize(
    ("rooms", "needed", "expected"),
    [
        ([8, 8, 0.2, 8], 3, Sharing(3, 1, 3.0)),  # whoever has nearly nothing is left aside
        ([3, 1.6, 3, 3], 3, Sharing(4, 2, 1.5)),  # or has a share that it has room for
        ([8, 1, 1, 1, 1, 1, 1, 1], 4, Sharing(8, 4, 1.0)),  # one slave alone would do least
        ([8, 1, 1, 1, 1, 1, 1, 1], 6, Sharing(8, 6, 1.0)),
        ([8, 8, 1], 3, Sharing(3, 3, 1.0)),
    ],
)
def test_slaves_of_unequal_memory(rooms: list[float], needed: float, expected: Sharing) -> None:
    found = sharing(Copies.AUTO, [slave(room * GIB) for room in rooms], SceneMemory(needed * GIB))
    assert Sharing(found.slaves, found.team_size, found.room / GIB) == expected


def test_the_scene_is_cut_among_those_that_have_room_for_a_part() -> None:
    slaves = [slave(room * GIB) for room in (8, 0.2, 1, 8)]
    assert sharing(Copies.NONE, slaves, SceneMemory(3 * GIB)) == Sharing(3, 3, 1.0 * GIB)
    with pytest.raises(SettingsError, match=r"4 slaves have room for 0\.2 GiB to 8\.0 GiB each"):
        sharing(Copies.NONE, slaves, SceneMemory(17 * GIB))


def test_teams_are_as_many_as_can_be() -> None:
    assert [largest_team(slaves, 3) for slaves in (1, 3, 5, 6, 7)] == [1, 3, 5, 3, 4]


def test_photons_bring_surface_points_along() -> None:
    assert points_of(0.0) == 0.0
    assert points_of(10.0) == POINTS_LEAST
    assert points_of(1e6) == 2e6
    assert points_of(1e9) == POINTS_MOST
    of_photons = scene_memory(0, 1e6).divided
    assert of_photons == 1e6 * (PHOTON_BYTES + 2 * POINT_BYTES)
    assert scene_memory(0, 1e6, points=0.0).divided == 1e6 * PHOTON_BYTES
    # 100 million photons in a Cornell box, a tenth of them ghosts as well, on four slaves.
    assert scene_memory(36, 1.1e8).divided + 4 * PROCESS_BYTES < 14 * GIB
