"""All kinds of delta lights: the list of what makes their code, and the choice among them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Final

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.lights.directionals import make_directionals
from wdpm.kernels.lights.elements import Lights
from wdpm.kernels.lights.photon_targets import Targets
from wdpm.kernels.lights.points import make_points
from wdpm.kernels.lights.projectors import make_projectors
from wdpm.kernels.lights.samples import DeltaLightCode, DirectSample, Emission
from wdpm.kernels.lights.spots import make_spots
from wdpm.kernels.materials.texture import Textures
from wdpm.scenes.model.lights import DeltaLight, DirectionalLight, PointLight, ProjectorLight, SpotLight

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MAKERS: Final[dict[type[DeltaLight], Callable[[Features], DeltaLightCode]]] = {
    PointLight: make_points,
    SpotLight: make_spots,
    ProjectorLight: make_projectors,
    DirectionalLight: make_directionals,
}
"""What makes the code of each kind; it is asked about in this order."""


def kinds_of(features: Features) -> tuple[DeltaLightCode, ...]:
    """The code of the kinds that features name."""
    return tuple(make(features) for light, make in MAKERS.items() if getattr(features, light.KIND.feature))


@functools.cache
def make_direct_delta(features: Features) -> wp.Function:
    """`direct(lights, textures, number, position, probability) -> DirectSample`, of all kinds that features name."""
    direct = _direct_none
    for code in reversed(kinds_of(features)):
        direct = _direct_of(code.kind, code.direct, direct)
    return direct


@functools.cache
def make_emit_delta(features: Features) -> wp.Function:
    """`emit(lights, textures, targets, aimed, number, u_position, u_direction, u_target) -> Emission`, likewise."""
    emit = _emit_none
    for code in reversed(kinds_of(features)):
        emit = _emit_of(code.kind, code.emit, emit)
    return emit


@wp.func
def _direct_none(
    lights: wp.ref[Lights], textures: wp.ref[Textures], number: wp.int32, position: wp.vec3, probability: wp.float32
) -> DirectSample:
    return DirectSample()


def _direct_of(kind: int, own: wp.Function, others: wp.Function) -> wp.Function:
    """As `others`, with one more kind of light."""

    @wp.func
    def direct(
        lights: wp.ref[Lights], textures: wp.ref[Textures], number: wp.int32, position: wp.vec3, probability: wp.float32
    ) -> DirectSample:
        if lights.deltas.kind[number] == kind:
            return own(lights, textures, number, position, probability)
        return others(lights, textures, number, position, probability)

    return direct


@wp.func
def _emit_none(
    lights: wp.ref[Lights],
    textures: wp.ref[Textures],
    targets: wp.ref[Targets],
    aimed: wp.int32,
    number: wp.int32,
    u_position: wp.vec2,
    u_direction: wp.vec2,
    u_target: wp.float32,
) -> Emission:
    return Emission()


def _emit_of(kind: int, own: wp.Function, others: wp.Function) -> wp.Function:
    """As `others`, with one more kind of light."""

    @wp.func
    def emit(
        lights: wp.ref[Lights],
        textures: wp.ref[Textures],
        targets: wp.ref[Targets],
        aimed: wp.int32,
        number: wp.int32,
        u_position: wp.vec2,
        u_direction: wp.vec2,
        u_target: wp.float32,
    ) -> Emission:
        if lights.deltas.kind[number] == kind:
            return own(lights, textures, targets, aimed, number, u_position, u_direction, u_target)
        return others(lights, textures, targets, aimed, number, u_position, u_direction, u_target)

    return emit
