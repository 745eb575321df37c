"""All integrators, by name."""

from __future__ import annotations

from enum import Enum

from wdpm.cluster.integrators.algorithm import Algorithm
from wdpm.cluster.integrators.automatic import Automatic
from wdpm.cluster.integrators.path import PathTracing
from wdpm.cluster.integrators.photons import PhotonMapping


class Integrator(Enum):
    """How light is found: one line for each algorithm. The value of a member is the algorithm's name.

    Attributes:
        algorithm: all that depends on which integrator it is.
    """

    _value_: str
    algorithm: Algorithm

    PHOTONS = PhotonMapping()
    PATH = PathTracing()
    AUTO = Automatic()

    def __new__(cls, algorithm: Algorithm) -> Integrator:
        """A member of the algorithm's name."""
        member = object.__new__(cls)
        member._value_ = algorithm.name
        member.algorithm = algorithm
        return member


REFERENCE = Integrator.PATH
"""The one without bias, that others are held against."""
