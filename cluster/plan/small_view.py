"""What a trial looks at before a render is planned: the view in few pixels, and the scene without photons."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import IrradiancePlan, MapPlan
from wdpm.scenes.model.scene import Camera, PixelFilter


@contextmanager
def without_photons(pilot: PhotonPilot) -> Iterator[CellWorker]:
    """The pilot's worker in the same world with no photon map, for as long as the context lasts."""
    world, worker = pilot.world, pilot.worker
    nothing = replace(world, global_map=MapPlan(), caustic_map=MapPlan(), volume_map=MapPlan())
    worker.adopt(replace(nothing, irradiance=IrradiancePlan()))
    try:
        yield worker
    finally:
        worker.adopt(world)


def small(camera: Camera, pixels: int) -> Camera:
    """The same view in some `pixels` pixels, each with samples of its own; as it is if it has no more."""
    whole = math.sqrt(pixels / (camera.width * camera.height))
    if whole >= 1.0:
        return replace(camera, filter=PixelFilter())
    size = [max(round(side * whole), 1) for side in (camera.width, camera.height)]
    if camera.crop is None or camera.full_size is None:
        return replace(camera, width=size[0], height=size[1], filter=PixelFilter())
    shrunk = [size[0] / camera.width, size[1] / camera.height]
    left, top, _, _ = camera.crop
    full = (max(round(camera.full_size[0] * shrunk[0]), size[0]), max(round(camera.full_size[1] * shrunk[1]), size[1]))
    crop = (
        min(round(left * shrunk[0]), full[0] - size[0]),
        min(round(top * shrunk[1]), full[1] - size[1]),
        size[0],
        size[1],
    )
    return replace(camera, width=size[0], height=size[1], crop=crop, full_size=full, filter=PixelFilter())
