"""Blender's volume shaders as homogeneous media."""

from __future__ import annotations

import numpy as np

from wdpm.blender.export.sockets import Output, Socket
from wdpm.blender.export.values import Values
from wdpm.scenes.model.scene import Medium

_KINDS = ("ShaderNodeVolumeAbsorption", "ShaderNodeVolumeScatter", "ShaderNodeVolumePrincipled")


def read_medium(name: str, socket: Socket, values: Values) -> Medium | None:
    """The medium that feeds a Volume socket, or None. What is not homogeneous becomes so, which is noted.

    Args:
        name: for messages.
    """
    source = socket.source
    if source is None:
        return None
    if source.kind == "ShaderNodeAddShader":
        parts = [read_medium(name, source.input(i), values) for i in (0, 1)]
        return _sum(name, [part for part in parts if part is not None])
    if source.kind not in _KINDS:
        values.note(f"{source.label} as a volume is not supported: it is left out")
        return None
    density = _mean(source, "Density", values)[0]
    colour = np.clip(_mean(source, "Color", values), 0.0, 1.0)
    if source.kind == "ShaderNodeVolumeAbsorption":
        return _medium(name, np.zeros(3), (1.0 - colour) * density, 0.0)
    g = float(np.clip(_mean(source, "Anisotropy", values)[0], -0.999, 0.999))
    if source.kind == "ShaderNodeVolumeScatter":
        if source.node.phase != "HENYEY_GREENSTEIN":
            values.note("phase functions other than Henyey-Greenstein are not supported: that one is used")
        return _medium(name, colour * density, np.zeros(3), g)
    if _mean(source, "Emission Strength", values)[0] > 0.0 or _mean(source, "Blackbody Intensity", values)[0] > 0.0:
        values.note("emission of a volume is left out")
    # Cycles: what is not scattered is absorbed, less the square root of the colour of absorption.
    tint = np.sqrt(np.clip(_mean(source, "Absorption Color", values), 0.0, 1.0))
    return _medium(name, colour * density, np.maximum((1.0 - colour) * (1.0 - tint), 0.0) * density, g)


def _mean(source: Output, name: str, values: Values) -> np.ndarray:
    value = values.read(source.input(name))
    if value.image is not None or value.colors is not None:
        values.note(f"{name} of {source.label} varies: its mean is used")
    return np.array(value.mean)


def _medium(name: str, scattering: np.ndarray, absorption: np.ndarray, g: float) -> Medium | None:
    extinction = scattering + absorption
    if not extinction.max() > 0.0:
        return None
    albedo = np.divide(scattering, extinction, out=np.zeros(3), where=extinction > 0.0)
    return Medium(name, _rgb(extinction), _rgb(albedo), g)


def _sum(name: str, media: list[Medium]) -> Medium | None:
    if len(media) < 2:
        return media[0] if media else None
    scattering = [np.array(each.sigma_t) * np.array(each.albedo) for each in media]
    absorption = sum(np.array(each.sigma_t) - part for each, part in zip(media, scattering, strict=True))
    weights = [part.mean() for part in scattering]
    g = sum(each.g * w for each, w in zip(media, weights, strict=True)) / max(sum(weights), 1e-30)
    return _medium(name, np.sum(scattering, axis=0), np.asarray(absorption), g)


def _rgb(values: np.ndarray) -> tuple[float, float, float]:
    red, green, blue = (float(each) for each in values)
    return red, green, blue
