"""What lights give: a way from a place to a light, and a photon as it leaves one; and what makes both, by kind."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class DirectSample:
    """A way to a light. What arrives by it is scattering * cos * radiance / pdf.

    Attributes:
        direction: towards the light, unit.
        end: of the shadow segment.
        radiance: radiance; of a delta light, the irradiance across the direction.
        pdf: pdf_solid_angle times probability of the element, of a delta light just the latter. 0: nothing arrives.
        delta: 1 where only this way leads to the light: a point, spot or directional.
        light: which light of the scene.
    """

    direction: wp.vec3
    end: wp.vec3
    radiance: wp.vec3
    pdf: wp.float32
    delta: wp.int32
    light: wp.int32


@wp.struct
class Emission:
    """A photon as it leaves a light.

    Attributes:
        flux: that of a map of one path: divide by the number of paths. Zero where nothing is sent.
        medium: that it starts in, -1 for none.
    """

    light: wp.int32
    element: wp.int32
    origin: wp.vec3
    direction: wp.vec3
    flux: wp.vec3
    medium: wp.int32


@dataclass(frozen=True, eq=False)
class DeltaLightCode:
    """What kernels do for a kind of delta light, compiled for some features; `number` is the light's row.

    Attributes:
        kind: its number, scenes.model.light_kind.
        direct: `(lights, textures, number, position, probability) -> DirectSample`, the way there from a place;
            probability is that with which the light was chosen.
        emit: `(lights, textures, targets, aimed, number, u_position, u_direction, u_target) -> Emission`, a photon;
            aimed is 1 where it is only of use if it meets a target.
    """

    kind: int
    direct: wp.Function
    emit: wp.Function


@wp.func
def towards(position: wp.vec3, end: wp.vec3, probability: wp.float32) -> DirectSample:
    """The way to a point from which intensity is still to be set."""
    s = DirectSample()
    s.end = end
    way = end - position
    if wp.dot(way, way) > 0.0:
        s.direction = wp.normalize(way)
        s.pdf = probability
    return s
