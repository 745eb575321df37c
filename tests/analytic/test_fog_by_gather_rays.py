"""Light of a medium that gather rays find on their way: a furnace full of mist, in which all radiance is known."""

from __future__ import annotations

import numpy as np
import pytest
from fog import WHITE, foggy_furnace
from furnaces import rendered

from wdpm.cluster.render_settings import Indirect, Integrator
from wdpm.scenes.model.scene import Medium

SIGMA = 0.5


@pytest.mark.parametrize("indirect", [Indirect.MAP, Indirect.GATHER, Indirect.CACHE])
def test_walls_reflect_what_mist_sends_them(indirect: Indirect) -> None:
    """Radiance 2 leaves the walls, and the mist before them leaves its share: it is in the layers of surfaces.

    Of samples one in sixteen looks for light of the mist, for all. While of a record's rays as few did, it had more
    light of the mist the rarer they were, as those that brought much drew further rays to their neighbours: these
    layers had 8 % too much. What gather rays of samples found of it was in the layer of the medium.
    """
    what = foggy_furnace(Medium("mist", (SIGMA,) * 3, WHITE))
    image = rendered(
        what,
        spp=64,
        photons=60_000,
        volume_photons=60_000,
        integrator=Integrator.PHOTONS,
        indirect=indirect,
        all_effects=True,
    )
    by_surfaces = image.layers["direct"].astype(np.float64) + image.layers["indirect"]
    exact = 2.0 * np.exp(-SIGMA * image.layers["depth"].astype(np.float64).mean())
    # Gather rays in mist see the same volume photons: their own noise is some 2 % of a third of this light.
    assert by_surfaces.mean() == pytest.approx(exact, rel=0.02)
