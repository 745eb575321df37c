"""Animations of glTF 2.0: where nodes are at a time.

Source: Khronos Group, "glTF 2.0 Specification", section 3.11 and appendix C. Translation, rotation and scale of nodes,
weights of morph targets; LINEAR (spherical for rotations), STEP and CUBICSPLINE. Before the first and after the last
key, values stay.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.gltf.container import GltfFile

Values = NDArray[np.float64]

WIDTHS: Final = {"translation": 3, "rotation": 4, "scale": 3}
"""Numbers of what a channel drives of a node's place."""

WEIGHTS: Final = "weights"
"""Of morph targets: as many numbers as there are of those."""

_PARALLEL = 1.0 - 1e-9  # cosine from which on the sine between two rotations is too small to divide by


class Poses:
    """The nodes of a file at a time.

    All animations of the file play together. Where two drive the same property of a node, the first does.

    Args:
        time: in seconds; None for the nodes as they stand without animation.
        warnings: is told what is left out.

    Raises:
        SceneError: a broken animation.
    """

    def __init__(self, gltf: GltfFile, time: float | None, warnings: list[str]) -> None:
        self._gltf = gltf
        self._warnings = warnings
        self._values: dict[tuple[int, str], list[float]] = {}
        if time is None:
            if gltf.count("animations"):
                warnings.append("animations: everything stands as it does without; --frames A..B renders frames")
            return
        for number in range(gltf.count("animations")):
            self._play(gltf.item("animations", number), number, time)

    def posed(self, node: dict[str, Any], index: int) -> dict[str, Any]:
        """A node with what animations make of it. Raises SceneError where it has a matrix, which cannot be animated."""
        paths = (*WIDTHS, WEIGHTS)
        driven = {path: self._values[index, path] for path in paths if (index, path) in self._values}
        if driven.keys() & WIDTHS and "matrix" in node:
            raise self._gltf.error(f"broken glTF: nodes[{index}] is animated, but has a matrix")
        return {**node, **driven}

    def _play(self, animation: dict[str, Any], number: int, time: float) -> None:
        name = self._gltf.get(animation, "name", str, f"animation {number}")
        samplers = self._gltf.get(animation, "samplers", list, [])
        for channel in self._gltf.get(animation, "channels", list, []):
            where = f'animation "{name}"'
            if not isinstance(channel, dict):
                raise self._gltf.error(f"broken glTF: {where}: a channel is not an object")
            target = self._gltf.get(channel, "target", dict, {})
            path = self._gltf.get(target, "path", str, "")
            if (path not in WIDTHS and path != WEIGHTS) or "node" not in target:
                known = "translation, rotation, scale and weights are read"
                self._warn_once(f'{where}: what drives "{path}" is ignored; {known}')
                continue
            node = self._gltf.get(target, "node", int, -1)
            self._gltf.item("nodes", node)
            if (node, path) in self._values:
                self._warn_once(f"{where}: {path} of nodes[{node}] is driven by another animation already: ignored")
                continue
            sampler = self._gltf.get(channel, "sampler", int, -1)
            if not 0 <= sampler < len(samplers) or not isinstance(samplers[sampler], dict):
                raise self._gltf.error(f"broken glTF: {where}: there is no samplers[{sampler}]")
            self._values[node, path] = self._sample(samplers[sampler], path, time, where).tolist()

    def _sample(self, sampler: dict[str, Any], path: str, time: float, where: str) -> Values:
        """The value at a time."""
        keys = self._gltf.accessor(sampler.get("input")).astype(np.float64)
        values = self._gltf.accessor(sampler.get("output")).astype(np.float64)
        how = self._gltf.get(sampler, "interpolation", str, "LINEAR")
        if how not in _BETWEEN:
            raise self._gltf.error(f'broken glTF: {where}: interpolation "{how}"; expected {", ".join(_BETWEEN)}')
        each = 3 if how == "CUBICSPLINE" else 1
        rows = each * len(keys)
        if path == WEIGHTS and rows and values.shape[1] == 1 and len(values) % rows == 0:
            values = values.reshape(rows, -1)
        width: int = WIDTHS[path] if path in WIDTHS else values.shape[1]
        if not rows or keys.shape[1] != 1 or values.shape != (rows, width):
            raise self._gltf.error(
                f"broken glTF: {where}: {path} has keys of shape {keys.shape} and values of shape {values.shape}, "
                f"expected ({rows}, {width}) values"
            )
        moments = keys[:, 0]
        if not (np.isfinite(moments).all() and np.isfinite(values).all() and (np.diff(moments) > 0.0).all()):
            raise self._gltf.error(f"broken glTF: {where}: {path} needs finite values at times that grow")
        values = values.reshape(len(keys), each, width)
        last = int(np.searchsorted(moments, time, side="right")) - 1
        if last < 0 or last == len(moments) - 1:
            found = values[max(last, 0), each // 2]
        else:
            step = float(moments[last + 1] - moments[last])
            share = (time - float(moments[last])) / step
            found = _BETWEEN[how](values[last], values[last + 1], share, step, path == "rotation")
        return _unit(found, self._gltf, where) if path == "rotation" else found

    def _warn_once(self, message: str) -> None:
        if message not in self._warnings:
            self._warnings.append(message)


def _linear(a: Values, b: Values, share: float, _step: float, turns: bool) -> Values:
    if not turns:
        straight: Values = a[0] * (1.0 - share) + b[0] * share
        return straight
    start, end = a[0], b[0]
    cosine = float(start @ end) / math.sqrt(max(float(start @ start) * float(end @ end), 1e-300))
    if cosine < 0.0:  # the same rotation by the shorter way
        end, cosine = -end, -cosine
    if cosine >= _PARALLEL:
        nearly: Values = start * (1.0 - share) + end * share
        return nearly
    angle = math.acos(cosine)
    turned: Values = (math.sin((1.0 - share) * angle) * start + math.sin(share * angle) * end) / math.sin(angle)
    return turned


def _held(a: Values, _b: Values, _share: float, _step: float, _turns: bool) -> Values:
    return a[0]


def _cubic(a: Values, b: Values, t: float, step: float, _turns: bool) -> Values:
    """Hermite's, by the tangent that leaves one key and the one that comes into the next; rows: in, value, out."""
    value: Values = (
        (2 * t**3 - 3 * t**2 + 1) * a[1]
        + step * (t**3 - 2 * t**2 + t) * a[2]
        + (3 * t**2 - 2 * t**3) * b[1]
        + step * (t**3 - t**2) * b[0]
    )
    return value


_BETWEEN: Final[dict[str, Callable[[Values, Values, float, float, bool], Values]]] = {
    "LINEAR": _linear,
    "STEP": _held,
    "CUBICSPLINE": _cubic,
}


def _unit(rotation: Values, gltf: GltfFile, where: str) -> Values:
    length = float(np.linalg.norm(rotation))
    if not length > 0.0:
        raise gltf.error(f"broken glTF: {where}: a rotation is zero")
    unit: Values = rotation / length
    return unit
