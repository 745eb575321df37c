"""Lights without area on a device, a row each: points, spots, directional lights. What a row means, its kind says."""

from __future__ import annotations

import numpy as np
import warp as wp

from wdpm.scenes.flat.light_table import LightTable

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class DeltaLights:
    """Delta lights; fields as in scenes.flat.light_table, delta_*; x, y and z are the rows of the axes."""

    kind: wp.array[wp.int32]
    position: wp.array[wp.vec3]
    x: wp.array[wp.vec3]
    y: wp.array[wp.vec3]
    z: wp.array[wp.vec3]
    color: wp.array[wp.vec3]
    cutoff: wp.array[wp.float32]
    number: wp.array2d[wp.float32]
    texture: wp.array[wp.int32]


def upload(table: LightTable, device: str) -> DeltaLights:
    """The delta lights on a device."""
    deltas = DeltaLights()
    deltas.kind = wp.array(table.delta_kind, dtype=wp.int32, device=device)
    deltas.position = wp.array(table.delta_position, dtype=wp.vec3, device=device)
    for number, name in enumerate("xyz"):
        axis = np.ascontiguousarray(table.delta_axes[:, number])
        setattr(deltas, name, wp.array(axis, dtype=wp.vec3, device=device))
    deltas.color = wp.array(table.delta_color, dtype=wp.vec3, device=device)
    deltas.cutoff = wp.array(table.delta_cutoff, dtype=wp.float32, device=device)
    deltas.number = wp.array(table.delta_number, dtype=wp.float32, device=device)
    deltas.texture = wp.array(table.delta_texture, dtype=wp.int32, device=device)
    return deltas
