"""Nodes that compute each pixel for itself, as functions of arrays.

Formulas are those of Cycles (intern/cycles/kernel/svm), which Blender's manual describes under "Shader Nodes".
"""

from __future__ import annotations

import colorsys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Inputs = list[Array]
"""Of the node, in the order of its sockets that are in use; shape [3] or [height, width, 3], a number three times."""

PixelNode = Callable[[Any, str, Inputs], Any]
"""Takes the node, the name of its output, and its inputs."""

PIXEL_NODES: dict[str, PixelNode] = {}
"""By Blender's name of the node's class."""

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def _computes(*kinds: str) -> Callable[[PixelNode], PixelNode]:
    def add(function: PixelNode) -> PixelNode:
        PIXEL_NODES.update(dict.fromkeys(kinds, function))
        return function

    return add


def grey(array: Array) -> Array:
    """A colour as a number, three times."""
    return np.repeat((array @ _LUMINANCE)[..., None], 3, axis=-1)


@_computes("ShaderNodeRGB", "ShaderNodeValue")
def _output(node: Any, _: str, __: Inputs) -> Any:
    value = node.outputs[0].default_value
    return np.full(3, value) if isinstance(value, float) else np.array(tuple(value)[:3])


@_computes("ShaderNodeRGBToBW")
def _rgb_to_bw(_: Any, __: str, inputs: Inputs) -> Any:
    return grey(inputs[0])


@_computes("ShaderNodeGamma")
def _gamma(_: Any, __: str, inputs: Inputs) -> Any:
    return np.where(inputs[0] > 0.0, np.maximum(inputs[0], 0.0) ** inputs[1], inputs[0])


@_computes("ShaderNodeInvert")
def _invert(_: Any, __: str, inputs: Inputs) -> Any:
    share, colour = inputs
    return colour + (1.0 - 2.0 * colour) * share


@_computes("ShaderNodeBrightContrast")
def _bright_contrast(_: Any, __: str, inputs: Inputs) -> Any:
    colour, bright, contrast = inputs
    return np.maximum((1.0 + contrast) * colour + bright - 0.5 * contrast, 0.0)


@_computes("ShaderNodeHueSaturation")
def _hue_saturation(_: Any, __: str, inputs: Inputs) -> Any:
    hue, saturation, value, share, colour = inputs
    shape = np.broadcast_shapes(*(each.shape for each in inputs))
    columns = [np.broadcast_to(each, shape).reshape(-1, 3) for each in (hue, saturation, value, colour)]
    turned = np.empty_like(columns[3])
    for i, (h, s, v, c) in enumerate(zip(*columns, strict=True)):
        of_hue, of_saturation, of_value = colorsys.rgb_to_hsv(*c)
        changed = (of_hue + h[0] + 0.5) % 1.0, min(max(of_saturation * s[0], 0.0), 1.0), of_value * v[0]
        turned[i] = colorsys.hsv_to_rgb(*changed)
    return np.maximum(colour + (turned.reshape(shape) - colour) * share, 0.0)


@_computes("ShaderNodeClamp")
def _clamp(node: Any, _: str, inputs: Inputs) -> Any:
    value, least, most = inputs
    if node.clamp_type == "RANGE":
        least, most = np.minimum(least, most), np.maximum(least, most)
    return np.minimum(np.maximum(value, least), most)


@_computes("ShaderNodeMapRange")
def _map_range(node: Any, _: str, inputs: Inputs) -> Any:
    value, from_least, from_most, to_least, to_most = inputs[:5]
    span = from_most - from_least
    share = np.divide(value - from_least, span, out=np.zeros_like(value - span), where=span != 0.0)
    if node.interpolation_type in ("SMOOTHSTEP", "SMOOTHERSTEP"):
        share = np.clip(share, 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)
    result = to_least + share * (to_most - to_least)
    return np.clip(result, np.minimum(to_least, to_most), np.maximum(to_least, to_most)) if node.clamp else result


@_computes("ShaderNodeSeparateColor", "ShaderNodeSeparateRGB")
def _separate(_: Any, output: str, inputs: Inputs) -> Any:
    channel = {"R": 0, "G": 1, "B": 2}.get(output[0], 0)
    return np.repeat(inputs[0][..., channel : channel + 1], 3, axis=-1)


@_computes("ShaderNodeCombineColor", "ShaderNodeCombineRGB")
def _combine(_: Any, __: str, inputs: Inputs) -> Any:
    shape = np.broadcast_shapes(*(each.shape for each in inputs))
    return np.stack([np.broadcast_to(each, shape)[..., 0] for each in inputs], axis=-1)


@_computes("ShaderNodeValToRGB")
def _color_ramp(node: Any, output: str, inputs: Inputs) -> Any:
    steps = np.linspace(0.0, 1.0, 257)
    table = np.array([tuple(node.color_ramp.evaluate(step)) for step in steps])
    share = np.clip(inputs[0] @ _LUMINANCE, 0.0, 1.0)
    channels = (3, 3, 3) if output == "Alpha" else (0, 1, 2)
    return np.stack([np.interp(share, steps, table[:, channel]) for channel in channels], axis=-1)


@_computes("ShaderNodeRGBCurve")
def _curves(node: Any, _: str, inputs: Inputs) -> Any:
    share, colour = inputs
    mapping = node.mapping
    mapping.initialize()
    steps = np.linspace(0.0, 1.0, 257)
    tables = [np.array([mapping.evaluate(curve, step) for step in steps]) for curve in mapping.curves]
    both = [np.interp(np.interp(colour[..., c], steps, tables[3]), steps, tables[c]) for c in range(3)]
    return colour + (np.stack(both, axis=-1) - colour) * share


@_computes("ShaderNodeMix", "ShaderNodeMixRGB")
def _mix(node: Any, _: str, inputs: Inputs) -> Any:
    share, a, b = inputs
    if node.bl_idname == "ShaderNodeMixRGB":
        share, result_clamped = np.clip(share, 0.0, 1.0), node.use_clamp
    else:
        share = np.clip(share, 0.0, 1.0) if node.clamp_factor else share
        result_clamped = node.data_type == "RGBA" and node.clamp_result
    kind = node.blend_type if getattr(node, "data_type", "RGBA") == "RGBA" else "MIX"
    blended = _BLENDS.get(kind, _BLENDS["MIX"])(a, b)
    result = a + (blended - a) * share
    return np.clip(result, 0.0, 1.0) if result_clamped else result


_BLENDS: dict[str, Callable[[Array, Array], Array]] = {
    "MIX": lambda _, b: b,
    "ADD": lambda a, b: a + b,
    "MULTIPLY": lambda a, b: a * b,
    "SUBTRACT": lambda a, b: a - b,
    "SCREEN": lambda a, b: 1.0 - (1.0 - a) * (1.0 - b),
    "DIVIDE": lambda a, b: np.divide(a, b, out=np.zeros_like(a + b), where=b != 0.0),
    "DIFFERENCE": lambda a, b: np.abs(a - b),
    "DARKEN": np.minimum,
    "LIGHTEN": np.maximum,
    "OVERLAY": lambda a, b: np.where(a < 0.5, 2.0 * a * b, 1.0 - 2.0 * (1.0 - a) * (1.0 - b)),
}


@_computes("ShaderNodeMath")
def _math(node: Any, _: str, inputs: Inputs) -> Any:
    values = [grey(each) for each in inputs]
    result = _MATH[node.operation](*values) if node.operation in _MATH else values[0]
    return np.clip(result, 0.0, 1.0) if node.use_clamp else result


_MATH: dict[str, Callable[..., Array]] = {
    "ADD": np.add,
    "SUBTRACT": np.subtract,
    "MULTIPLY": np.multiply,
    "DIVIDE": _BLENDS["DIVIDE"],
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b: np.where(a >= 0.0, np.abs(a) ** b, 0.0),
    "SQRT": lambda a: np.sqrt(np.maximum(a, 0.0)),
    "ABSOLUTE": np.abs,
    "MINIMUM": np.minimum,
    "MAXIMUM": np.maximum,
    "LESS_THAN": lambda a, b: (a < b).astype(np.float64),
    "GREATER_THAN": lambda a, b: (a > b).astype(np.float64),
    "ROUND": lambda a: np.floor(a + 0.5),
    "FLOOR": np.floor,
    "CEIL": np.ceil,
    "FRACT": lambda a: a - np.floor(a),
}


def unsupported_mode(node: Any) -> str | None:
    """What a node of PIXEL_NODES is set to that is not supported; None if all is. Its first input goes through then,
    or the second of a mix."""
    if node.bl_idname == "ShaderNodeMath" and node.operation not in _MATH:
        return str(node.operation)
    blends = node.bl_idname == "ShaderNodeMixRGB" or getattr(node, "data_type", None) == "RGBA"
    if blends and node.blend_type not in _BLENDS:
        return str(node.blend_type)
    if node.bl_idname in ("ShaderNodeSeparateColor", "ShaderNodeCombineColor") and node.mode != "RGB":
        return str(node.mode)
    return None
