"""The photons that are stored: in which map, and room for them."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.photons.flight import BOUNCE_BITS, Photon

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Photon maps.
GLOBAL_MAP = wp.constant(0)
CAUSTIC_MAP = wp.constant(1)
VOLUME_MAP = wp.constant(2)

NO_MAP = wp.constant(-1)
"""In place of a map: nothing is stored."""


@wp.struct
class Deposits:
    """Room for stored photons: a region of `capacity` for each chunk, and how many it was asked to take."""

    capacity: wp.int32
    count: wp.array[wp.int32]
    id: wp.array[wp.int64]
    edges: wp.array[wp.int32]
    front: wp.array[wp.int32]
    map: wp.array[wp.int32]
    light: wp.array[wp.int32]
    position: wp.array[wp.vec3]
    flux: wp.array[wp.vec3]
    normal: wp.array[wp.vec3]
    direction: wp.array[wp.vec3]


@wp.struct
class Deposit:
    """A photon as a map holds it.

    Attributes:
        map: NO_MAP where nothing is stored.
        front: 1 where it arrived at the front of a surface, and in a medium.
        flux: that arrives.
        normal: geometric normal on the side that it arrived at; in a medium, (number of the medium, 0, 0).
        direction: to where it came from, unit.
    """

    map: wp.int32
    front: wp.int32
    position: wp.vec3
    flux: wp.vec3
    normal: wp.vec3
    direction: wp.vec3


@wp.func
def store(deposits: Deposits, chunk: wp.int32, p: Photon, d: Deposit) -> bool:
    """Store a photon in its chunk's region; False where no room is left."""
    slot = wp.atomic_add(deposits.count, chunk, 1)
    if slot >= deposits.capacity:
        return False
    slot += chunk * deposits.capacity
    deposits.id[slot] = (p.path << wp.int64(BOUNCE_BITS)) | wp.int64(p.bounce)
    deposits.edges[slot] = p.edges
    deposits.front[slot] = d.front
    deposits.map[slot] = d.map
    deposits.light[slot] = p.light
    deposits.position[slot] = d.position
    deposits.flux[slot] = d.flux
    deposits.normal[slot] = d.normal
    deposits.direction[slot] = d.direction
    return True
