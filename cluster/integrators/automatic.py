"""Either of the others, as a trial finds them to suit the scene (plan.integrator_trial)."""

from __future__ import annotations

from wdpm.cluster.integrators.photons import PhotonMapping


class Automatic(PhotonMapping):
    """Photon mapping, unless a trial finds that path tracing leaves less error for its price.

    Until that is known it is what photon mapping is.
    """

    name = "auto"
    words = "photon mapping or path tracing"
    option_help = "auto: the one of these with less error for the same time in a short trial of the scene"
    stands_for_others = True
