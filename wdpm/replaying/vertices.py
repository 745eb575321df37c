"""What a replay of a sample tells: vertices, and what each adds."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

RGB = tuple[float, float, float]
Vector = tuple[float, float, float]

LAYERS = ("direct", "indirect", "caustic", "volume")


@dataclass(frozen=True)
class ShadowRay:
    """A shadow ray of a vertex.

    Attributes:
        light: name of the light that it goes to; None where none was found.
        carries: what arrives if nothing is in the way, weighted by all that comes before [W / (sr m²)].
        arrives: what does; None where it is blocked, or carried nothing.
        passes: surfaces that it met and that may let light pass straight through.
    """

    light: str | None
    carries: RGB
    arrives: RGB | None
    passes: int = 0


@dataclass(frozen=True)
class Gather:
    """A gather of photons at a vertex.

    Attributes:
        photons: that were found.
        radius: of the gather [scene units].
        truncated: whether they were fewer than it looked for.
        radiance: weighted by all that comes before [W / (sr m²)].
    """

    photons: int
    radius: float
    truncated: bool
    radiance: RGB


@dataclass(frozen=True)
class Onward:
    """The ray that goes on from a vertex.

    Attributes:
        throughput: what is seen by it counts for so much in the sample.
        pdf: density of its direction at the last vertex that scattered it [1 / sr]; 0 for a mirror's.
        medium: that it is in; None for none.
    """

    direction: Vector
    throughput: RGB
    pdf: float
    medium: str | None


@dataclass(frozen=True)
class Hit:
    """What a ray has hit.

    Attributes:
        mesh, material: their names.
        triangle: its number in the mesh, from 0; prim: among all triangles of the scene that are rendered.
        position: in the scene's coordinates; u, v: weights of the triangle's second and third corner.
        t: in units of the ray's direction; distance: in scene units.
        normal: geometric, on the side that is seen; shading_normal: interpolated and bent.
        front: whether the front is seen.
        leaf: kind of the material's part that was chosen; color: its albedo or base colour; specular: what its
            interface reflects; alpha: roughness along the tangents.
    """

    mesh: str
    material: str
    triangle: int
    prim: int
    position: Vector
    u: float
    v: float
    t: float
    distance: float
    normal: Vector
    shading_normal: Vector
    front: bool
    leaf: str
    color: RGB
    specular: RGB
    alpha: tuple[float, float]


@dataclass(frozen=True)
class Collision:
    """Where a path collided in a medium, in path tracing.

    Attributes:
        position: in the scene's coordinates.
        distance: from the vertex before, in scene units.
    """

    medium: str
    position: Vector
    distance: float


@dataclass(frozen=True)
class ReplayVertex:
    """A vertex of a camera path, or (neither hit nor collision) its end beyond the scene. Light is in W / (sr m²).

    Attributes:
        bounce: vertices before.
        edges: of the path so far; passing straight through a surface makes none.
        medium: that the arriving ray is in; None for none.
        throughput: of the arriving ray.
        emission: light of the surface itself, or of the environment.
        direct: shadow rays. At the first vertex their mean counts; further on, each carries its share.
        indirect, caustic: gathers in the two maps of photons on surfaces; None without a map or a diffuse part.
        volume: light that the medium before the vertex scatters into the ray.
        onward: None where the path ends: absorbed, ended by Russian roulette, or nothing left to look for.
    """

    bounce: int
    edges: int
    medium: str | None
    throughput: RGB
    hit: Hit | None
    collision: Collision | None
    emission: RGB
    direct: tuple[ShadowRay, ...]
    indirect: Gather | None
    caustic: Gather | None
    volume: RGB
    onward: Onward | None


@dataclass(frozen=True, eq=False)
class Replay:
    """A sample of a pixel.

    Attributes:
        x, y, sample: which; counted from 0 and from the upper left.
        vertices: in the order of the path.
        layers: what the sample adds to its pixel: name of layer -> float64, shape [3]. A pixel is the sum of its
            samples in their order, divided by their number and rounded to float32, bit for bit.
        guards: how often each guard acted on this sample, by cause.
    """

    x: int
    y: int
    sample: int
    vertices: tuple[ReplayVertex, ...]
    layers: dict[str, NDArray[np.float64]]
    guards: dict[str, int] = field(default_factory=dict)

    @property
    def value(self) -> NDArray[np.float64]:
        """All layers together, as in the layer `beauty`, float64, shape [3]."""
        return ((self.layers["direct"] + self.layers["indirect"]) + self.layers["caustic"]) + self.layers["volume"]

    def to_json(self) -> str:
        """One JSON object; what is not finite is NaN or Infinity, as JavaScript has them."""
        plain = {
            "pixel": [self.x, self.y],
            "sample": self.sample,
            "vertices": [asdict(vertex) for vertex in self.vertices],
            "layers": {name: layer.tolist() for name, layer in self.layers.items()},
            "value": self.value.tolist(),
            "guards": self.guards,
        }
        return json.dumps(plain, indent=2)
