"""A highlight over a diffuse surface, as old file formats have it: a mixture of two scattering functions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wdpm.scenes.model.bsdfs import Blend, Bsdf, Conductor, Diffuse, Distribution
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Color, VertexColors


def highlight_over(
    diffuse: Color, specular: Color, alpha: tuple[float, float], distribution: Distribution
) -> tuple[Bsdf, float]:
    """A Lambertian surface and a metal that reflects everything, mixed so that both reflect what is asked for.

    Each part is divided by its own share of the mixture. Where both together reflect more than they receive, both are
    lowered by the same factor, as Mitsuba 0.6's `phong` and `ward` do.

    Args:
        diffuse, specular: reflectances.
        alpha: roughness of the highlight along both tangents; 0 is a mirror.

    Returns:
        The mixture, and what both reflect together where they are largest; above 1 they were divided by it.
    """
    most_diffuse, most_specular = largest(diffuse), largest(specular)
    total = most_diffuse + most_specular
    if most_specular == 0.0:
        return Diffuse(capped(diffuse)), total
    divisor = min(total, 1.0)
    metal = Conductor(
        specular_reflectance=capped(scaled(specular, divisor / most_specular)),
        alpha_u=alpha[0],
        alpha_v=alpha[1],
        distribution=distribution,
    )
    if most_diffuse == 0.0:
        return metal, total
    return Blend(Diffuse(capped(scaled(diffuse, divisor / most_diffuse))), metal, most_specular / total), total


def largest(colour: Color) -> float:
    """The largest channel of a colour, or of a texture; of colours at vertices, 1."""
    match colour:
        case Bitmap():
            return float(colour.pixels.max(initial=0.0))
        case Checkerboard():
            return max(*colour.color0, *colour.color1)
        case VertexColors():
            return colour.scale
    return max(colour)


def scaled(colour: Color, factor: float) -> Color:
    """A colour or a texture times a number."""
    if factor == 1.0:
        return colour
    match colour:
        case Bitmap():
            return replace(colour, pixels=colour.pixels * np.float32(factor))
        case Checkerboard():
            return replace(colour, color0=_times(colour.color0, factor), color1=_times(colour.color1, factor))
        case VertexColors():
            return replace(colour, scale=colour.scale * factor)
    return _times(colour, factor)


def capped(colour: Color) -> Color:
    """A colour or a bitmap with what lies above 1 (if only by rounding) lowered to 1."""
    if largest(colour) <= 1.0 or isinstance(colour, VertexColors):
        return colour
    match colour:
        case Bitmap():
            return replace(colour, pixels=np.minimum(colour.pixels, np.float32(1.0)))
        case Checkerboard():
            return replace(colour, color0=_least(colour.color0), color1=_least(colour.color1))
    return _least(colour)


def _times(colour: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    return colour[0] * factor, colour[1] * factor, colour[2] * factor


def _least(colour: tuple[float, float, float]) -> tuple[float, float, float]:
    return min(colour[0], 1.0), min(colour[1], 1.0), min(colour[2], 1.0)
