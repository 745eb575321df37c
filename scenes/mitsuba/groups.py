"""Mitsuba's `shapegroup` and `instance`: shapes that are read once and stand in several places."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.model.scene import Instance, Mesh
from wdpm.scenes.model.transforms import Matrix

MOST_INSTANCES = 1 << 20
"""Meshes that instances of a scene stand for, at most: some bytes each, and nested ones multiply."""

Members = list[tuple[Mesh, Matrix]]
"""Meshes, and where they stand in the space of their group."""


class GroupReader:
    """Reads groups when an instance first asks for them.

    Args:
        read_meshes: of a shape plugin.
    """

    def __init__(self, read_meshes: Callable[[Plugin], list[Mesh]]) -> None:
        self._read_meshes = read_meshes
        self._groups: dict[int, Members] = {}
        self._count = 0

    def read(self, plugin: Plugin) -> list[Instance]:
        """What an `instance` stands for, in world space.

        Raises:
            SceneError: it names no group, or its transform flattens space.
        """
        members = self._placed(plugin)
        self._count += len(members)
        if self._count > MOST_INSTANCES:
            raise plugin.error(f"{plugin}: with it, instances stand for more than {MOST_INSTANCES:,} meshes")
        return [Instance(f"{mesh.name} in {plugin.name}", mesh, to_world) for mesh, to_world in members]

    def _placed(self, plugin: Plugin) -> Members:
        """The members of an instance's group, moved by the instance."""
        at = plugin.at("to_world")
        to_world = plugin.take_transform("to_world")
        matrix = np.eye(4) if to_world is None else to_world
        if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix[:3, :3]) < 3:
            raise at.error(f"{plugin}: the transform flattens space: its matrix has no inverse")
        group = plugin.take_one("shape")
        if group is None or group.type != "shapegroup":
            found = "nothing" if group is None else f"{group}"
            raise plugin.error(f'{plugin} stands for {found}; expected a <ref> to a shape of type "shapegroup"')
        plugin.finish()
        return [(mesh, matrix @ inner) for mesh, inner in self._members(group)]

    def _members(self, group: Plugin) -> Members:
        """The meshes of a group. None holds itself: documents with circles are refused before."""
        key = id(group.element)
        if key not in self._groups:
            members: Members = []
            for shape in group.take_nested("shape"):
                if shape.type == "shapegroup":
                    raise shape.error(f"{group} holds another group; let an instance of that stand in it")
                if shape.type == "instance":
                    members += self._placed(shape)
                else:
                    members += [(mesh, np.eye(4)) for mesh in self._read_meshes(shape)]
                if len(members) > MOST_INSTANCES:
                    raise shape.error(f"{group}: nested instances stand for more than {MOST_INSTANCES:,} meshes")
            group.finish()
            self._groups[key] = members
        return self._groups[key]
