"""What the attributes of an element say: numbers, vectors, transforms."""

from __future__ import annotations

import math

import numpy as np

from wdpm.scenes.errors import did_you_mean
from wdpm.scenes.mitsuba.document import Element
from wdpm.scenes.model import transforms
from wdpm.scenes.model.transforms import Matrix


def numbers(text: str, at: Element) -> list[float]:
    """Numbers between spaces and commas; each must be finite."""
    try:
        values = [float(token) for token in text.replace(",", " ").split()]
    except ValueError:
        raise at.error(f'<{at.tag}>: expected numbers, got "{text}"') from None
    if not all(map(math.isfinite, values)):
        raise at.error(f'<{at.tag}>: expected finite numbers, got "{text}"')
    return values


def xyz(element: Element, missing: float) -> tuple[float, float, float]:
    """A vector as `value="x y z"`, `value="all"` or `x= y= z=`; axes that are not given have the value `missing`."""
    if "value" in element.attributes:
        values = numbers(element.attributes["value"], element)
        if len(values) == 1:
            values *= 3
    else:
        values = [_number(element, axis, missing) for axis in "xyz"]
    if len(values) != 3:
        raise element.error(f"<{element.tag}>: expected three numbers, got {len(values)}")
    return values[0], values[1], values[2]


def _number(element: Element, attribute: str, missing: float) -> float:
    values = numbers(element.attributes.get(attribute, str(missing)), element)
    if len(values) != 1:
        raise element.error(f'<{element.tag}>: "{attribute}" must be one number')
    return values[0]


def _triple(element: Element, attribute: str) -> list[float]:
    values = numbers(element.attribute(attribute), element)
    if len(values) != 3:
        raise element.error(f'<{element.tag}>: "{attribute}" must be three numbers, got {len(values)}')
    return values


def read_transform(element: Element) -> Matrix:
    """The product of a <transform>'s children; the first is applied first."""
    matrix = np.eye(4)
    for child in element.children:
        try:
            matrix = _one_transform(child) @ matrix
        except ValueError as error:
            raise child.error(f"<{child.tag}>: {error}") from error
    return matrix


def _one_transform(child: Element) -> Matrix:
    match child.tag.lower():  # 0.6 wrote lookAt
        case "translate":
            return transforms.translation(xyz(child, 0.0))
        case "scale":
            return transforms.scaling(xyz(child, 1.0))
        case "rotate":
            return transforms.rotation(xyz(child, 0.0), _number(child, "angle", 0.0))
        case "lookat":
            return transforms.look_at(_triple(child, "origin"), _triple(child, "target"), _up(child))
        case "matrix":
            return _matrix(child)
    raise child.error(
        f"<transform>: unknown element <{child.tag}>"
        + did_you_mean(child.tag, ["translate", "scale", "rotate", "lookat", "matrix"])
    )


def _up(child: Element) -> list[float]:
    if "up" in child.attributes:
        return _triple(child, "up")
    # any direction that is not the line of sight
    forward = np.subtract(_triple(child, "target"), _triple(child, "origin"))
    return [float(axis == np.argmin(np.abs(forward))) for axis in range(3)]


def _matrix(child: Element) -> Matrix:
    values = np.array(numbers(child.attribute("value"), child))
    if len(values) == 9:
        matrix = np.eye(4)
        matrix[:3, :3] = values.reshape(3, 3)
    elif len(values) == 16:
        matrix = values.reshape(4, 4)
    else:
        raise child.error(f"<matrix>: expected 16 or 9 numbers, got {len(values)}")
    if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        raise child.error('<matrix>: the last row must be "0 0 0 1"; projective transforms are not supported')
    return matrix
