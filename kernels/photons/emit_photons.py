"""Photon paths as they begin: emitted by the lights, and on their way to the first cell that they meet."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.lights.lights import Lights, Targets, make_lights
from wdpm.kernels.lights.steering import StartNumbers, Steering, steered
from wdpm.kernels.made_for import made_for
from wdpm.kernels.materials.medium import Media
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.maths.random import PURPOSE_CAUSTIC, PURPOSE_EMISSION, rounded_down, sample_1d, sample_2d
from wdpm.kernels.photons.flight import (
    Flight,
    dimension_of,
    make_into_medium,
    new_photon,
    path_streams,
    store_photon,
    without_hit,
)
from wdpm.kernels.rays.cells import Cells, next_cell

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class EmitScene:
    """What emission needs of a scene.

    Attributes:
        targets: what the caustic pass aims at.
        steering, caustic_steering: of each pass.
        cumulative, caustic_cumulative: shares of the light elements up to and with each, by pass.
    """

    lights: Lights
    textures: Textures
    media: Media
    cells: Cells
    targets: Targets
    steering: Steering
    caustic_steering: Steering
    cumulative: wp.array[wp.float64]
    caustic_cumulative: wp.array[wp.float64]


@wp.struct
class EmitOrders:
    """Which paths are emitted.

    Attributes:
        first: number of the launch's first path.
        global_paths: paths from this number on belong to the caustic pass, and are aimed.
    """

    first: wp.int64
    global_paths: wp.int64
    seed: wp.uint32


@wp.kernel
def first_cells(cells: Cells, flight: Flight, offset: wp.int32, next_cell_out: wp.array[wp.int32]) -> None:
    """The first cell on the way of each photon that was just emitted; -1 for one that carries nothing."""
    i = offset + wp.tid()
    next_cell_out[i] = -1
    if wp.max(flight.flux[i]) > 0.0:
        next_cell_out[i] = next_cell(cells, flight.origin[i], flight.direction[i], flight.t[i], -1)


@wp.func
def start_numbers(steering: wp.ref[Steering], index: wp.uint32, streams: wp.uint32) -> StartNumbers:
    """The numbers that a path begins with."""
    s = StartNumbers()
    s.element = sample_1d(index, dimension_of(streams, 0))
    s.point = wp.vec2d(sample_2d(index, dimension_of(streams, 1)))
    s.direction = wp.vec2d(sample_2d(index, dimension_of(streams, 2)))
    s.target = sample_1d(index, dimension_of(streams, 3))
    s.weight = 1.0
    if steering.count > 0:
        s = steered(steering, s)
    return s


@wp.kernel
def numbers_of_paths(
    steering: Steering,
    seed: wp.uint32,
    purpose: wp.uint32,
    offset: wp.int32,
    numbers_out: wp.array2d[wp.float64],
) -> None:
    """The numbers that the first paths of a pass begin with, shape [paths, 6].

    Args:
        purpose: of the pass's random numbers.
    """
    i = offset + wp.tid()
    s = start_numbers(steering, wp.uint32(i), path_streams(seed, purpose, wp.int64(i)))
    numbers_out[i, 0] = s.element
    for axis in range(2):
        numbers_out[i, 1 + axis] = s.point[axis]
        numbers_out[i, 3 + axis] = s.direction[axis]
    numbers_out[i, 5] = s.target


@functools.cache
def make_emit_photons(features: Features) -> wp.Kernel:
    """The kernel that starts photon paths."""
    emit = make_lights(features).emit
    into_medium = make_into_medium(features)

    @made_for(features)
    def emit_photons(scene: EmitScene, orders: EmitOrders, offset: wp.int32, flight_out: Flight) -> None:
        """Start the paths `orders.first` + i."""
        i = offset + wp.tid()
        path = orders.first + wp.int64(i)
        number = path
        purpose = PURPOSE_EMISSION
        shares = scene.cumulative
        aimed = wp.int32(0)
        if path >= orders.global_paths:
            number = path - orders.global_paths
            purpose = PURPOSE_CAUSTIC
            shares = scene.caustic_cumulative
            aimed = 1
        index = wp.uint32(number)
        streams = path_streams(orders.seed, purpose, number)
        start = StartNumbers()
        if aimed == 1:
            start = start_numbers(scene.caustic_steering, index, streams)
        else:
            start = start_numbers(scene.steering, index, streams)
        emitted = emit(
            scene.lights,
            scene.textures,
            shares,
            scene.targets,
            aimed,
            start.element,
            wp.vec2(rounded_down(start.point[0]), rounded_down(start.point[1])),
            wp.vec2(rounded_down(start.direction[0]), rounded_down(start.direction[1])),
            wp.float32(start.target),
        )
        p = without_hit(new_photon(path, orders.seed))
        p.edges = 1
        p.medium = emitted.medium
        p.light = emitted.light
        p.origin = emitted.origin
        p.direction = emitted.direction
        p.flux = emitted.flux * start.weight
        if wp.static(features.media):
            if emitted.medium >= 0:
                p = into_medium(p, scene.media, scene.cells, scene.lights.offset_min)
        store_photon(p, i, flight_out)

    return emit_photons
