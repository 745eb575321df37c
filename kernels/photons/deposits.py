"""The photons that are stored: in which map, and room for them."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.columns import FromFields, columns_of, item_of, storer
from wdpm.kernels.fields import chosen
from wdpm.kernels.photons.flight import BOUNCE_BITS, Photon
from wdpm.kernels.ray_fields import PHOTON, STORED_PHOTON

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Photon maps.
GLOBAL_MAP = wp.constant(0)
CAUSTIC_MAP = wp.constant(1)
VOLUME_MAP = wp.constant(2)

NO_MAP = wp.constant(-1)
"""In place of a map: nothing is stored."""


_DEPOSIT = {**STORED_PHOTON, **chosen(PHOTON, "light")}


@columns_of(_DEPOSIT)
class StoredPhotons(FromFields):
    """Photons as maps hold them, and the lights that they come from."""


@wp.struct
class Deposits:
    """Room for stored photons: a region of `capacity` for each chunk, and how many it was asked to take."""

    capacity: wp.int32
    count: wp.array[wp.int32]
    photons: StoredPhotons


@item_of(_DEPOSIT)
class Deposit(FromFields):
    """One of them; its map is NO_MAP where nothing is stored."""


_store = storer(StoredPhotons, Deposit)


@wp.func
def store(deposits: wp.ref[Deposits], chunk: wp.int32, p: Photon, d: Deposit) -> bool:
    """Store a photon in its chunk's region; False where no room is left."""
    slot = wp.atomic_add(deposits.count, chunk, 1)
    if slot >= deposits.capacity:
        return False
    d.id = (p.path << wp.int64(BOUNCE_BITS)) | wp.int64(p.bounce)
    d.edges = p.edges
    d.light = p.light
    _store(d, chunk * deposits.capacity + slot, deposits.photons)
    return True
