"""Areas of instances' triangles where they stand: the floats that scenes.flat.areas computes of copies.

A forest has a thousand million of them. Each is worked out when it is asked for; none is kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays.instances import DeviceInstances, instance_among, instance_corner
from wdpm.scenes.flat.instances import Instances

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = 1 << 20
"""Triangles that are asked for at once."""


@wp.func
def instance_area(instances: wp.ref[DeviceInstances], instance: wp.int32, prim: wp.int32) -> wp.float64:
    """Area of an instance's triangle, operation by operation as scenes.flat.areas has it."""
    row = instances.first[instance] + prim - instances.base[instance]
    p = wp.vec3d(instance_corner(instances, instance, row, 0))
    e = wp.vec3d(instance_corner(instances, instance, row, 1)) - p
    f = wp.vec3d(instance_corner(instances, instance, row, 2)) - p
    x = e[1] * f[2] - e[2] * f[1]
    y = e[2] * f[0] - e[0] * f[2]
    z = e[0] * f[1] - e[1] * f[0]
    return wp.float64(0.5) * wp.sqrt(x * x + y * y + z * z)


@wp.kernel
def _measure(
    instances: DeviceInstances,
    begin: wp.int32,
    first: wp.int32,
    last: wp.int32,
    offset: wp.int32,
    area_out: wp.array[wp.float64],
) -> None:
    i = offset + wp.tid()
    instance = instance_among(instances, begin + i, first, last)
    area = wp.float64(0.0)
    if instance >= 0:
        area = instance_area(instances, instance, begin + i)
    area_out[i] = area


@wp.kernel
def _find_before(
    instances: DeviceInstances,
    share_before: wp.array[wp.float64],
    instance_before: wp.array[wp.float64],
    instance_area: wp.array[wp.float64],
    begin: wp.int32,
    first: wp.int32,
    last: wp.int32,
    offset: wp.int32,
    before_out: wp.array[wp.float64],
) -> None:
    """Operation by operation as scenes.flat.shapes has it."""
    i = offset + wp.tid()
    instance = instance_among(instances, begin + i, first, last)
    before = wp.float64(0.0)
    if instance >= 0:
        row = instances.first[instance] + begin + i - instances.base[instance]
        before = instance_before[instance] + instance_area[instance] * share_before[row]
    before_out[i] = before


class InstanceAreas:
    """Areas of the triangles of some instances.

    Args:
        uploaded: the instances on the launcher's device (rays.instances.DeviceInstances).
    """

    def __init__(self, instances: Instances, uploaded: Any, launcher: Launcher) -> None:
        self._base = instances.base.astype(np.int64)
        self._ends = self._base + instances.sizes
        self._uploaded, self._launcher = uploaded, launcher
        before = instances.shapes.share_before, instances.area_before, instances.area
        self._before = [wp.array(each, dtype=wp.float64, device=launcher.device) for each in before]

    def of(self, begin: int, end: int) -> NDArray[np.float64]:
        """Areas of the triangles with the global numbers begin to end - 1, 0 for those of no instance."""
        area = wp.empty(end - begin, dtype=wp.float64, device=self._launcher.device)
        self._launcher(_measure, end - begin, **self._range(begin, end), area_out=area)
        areas: NDArray[np.float64] = area.numpy()
        return areas

    def before(self, begin: int, end: int) -> NDArray[np.float64]:
        """What area comes before each of them (scenes.flat.surface_order), 0 for those of no instance."""
        before = wp.empty(end - begin, dtype=wp.float64, device=self._launcher.device)
        share, start, area = self._before
        self._launcher(
            _find_before,
            end - begin,
            **self._range(begin, end),
            share_before=share,
            instance_before=start,
            instance_area=area,
            before_out=before,
        )
        areas: NDArray[np.float64] = before.numpy()
        return areas

    def _range(self, begin: int, end: int) -> dict[str, Any]:
        """Arguments of kernels that look for numbers among the instances that may have them."""
        first = int(self._ends.searchsorted(begin, side="right"))
        return {
            "instances": self._uploaded,
            "begin": begin,
            "first": first,
            "last": int(self._base.searchsorted(end)),
        }

    def blocks(self, most: int = BLOCK) -> Iterator[tuple[int, int]]:
        """Ranges of at most so many numbers, in which all instances' triangles are, and few others."""
        if not len(self._base):
            return
        start, stop = int(self._base[0]), int(self._ends[0])
        for base, end in zip(self._base[1:].tolist(), self._ends[1:].tolist(), strict=True):
            if end - start > most:
                yield from _cut(start, stop, most)
                start = base
            stop = end
        yield from _cut(start, stop, most)


def _cut(start: int, stop: int, most: int) -> Iterator[tuple[int, int]]:
    for begin in range(start, stop, most):
        yield begin, min(begin + most, stop)
