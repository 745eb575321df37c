"""What each slave of a cluster would hold of a scene, and be sent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wdpm.cluster.batch import SCHEMAS, Kind
from wdpm.cluster.master.cell_holders import balanced_holders
from wdpm.cluster.plan.copies import AT_WORK_BYTES, BARE_PHOTON_BYTES, PHOTON_BYTES, points_of, scene_memory
from wdpm.cluster.plan.render_plan import RenderPlan
from wdpm.cluster.work.overlap_band import rows_near
from wdpm.kernels.rays.cells import cell_boxes
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.model.textures import Bitmap


@dataclass(frozen=True)
class Share:
    """What one slave would hold.

    Attributes:
        team: which copy of the scene it would be a part of.
        triangles: as a share of the scene's.
        photons, ghosts: as shares of all photons, foretold from the pilot's. Photons are those of its cells, wherever
            they were traced; ghosts those of its neighbours in its band.
        memory: with its process, what it takes at its peak [bytes]: where that compiles kernels, give or take a tenth;
            where they are compiled, some 60 to 90 MiB less.
        received: of the scene, of photons that were traced elsewhere and of ghosts, before the first bucket [bytes].
    """

    slave: int
    team: int
    cells: int
    triangles: float
    photons: float
    ghosts: float
    memory: int
    received: int


def shares_of(plan: RenderPlan, flat: FlatScene, slaves: int, team_size: int, photons: int) -> tuple[Share, ...]:
    """What each slave would hold, the photons foretold from the pilot's.

    Args:
        team_size: slaves that a team has at least.
        photons: that will be stored in all.
    """
    position = plan.pilot_photons  # of all maps
    band = max((each.band for each in plan.world.maps if each.paths), default=0.0)
    low, high = cell_boxes(plan.world.top_tree.axis, plan.world.top_tree.split)
    inside = [
        np.count_nonzero(np.all((position >= a) & (position < b), axis=1)) for a, b in zip(low, high, strict=True)
    ]
    near = [len(rows_near(position, a, b, band)) for a, b in zip(low, high, strict=True)]
    held = np.array([plan.share_of(cell, flat.triangles) for cell in range(len(low))])
    shapes, standing = flat.triangles.held - len(flat.triangles), len(flat.triangles.instances)
    own, ghosts = np.array(inside) / max(len(position), 1), (np.array(near) - inside) / max(len(position), 1)
    teams = max(1, slaves // team_size)
    texels = sum(each.pixels.nbytes for each in flat.textures if isinstance(each, Bitmap))
    everywhere = texels + flat.media.grids.values.nbytes
    photon_bytes = BARE_PHOTON_BYTES if teams == 1 and not plan.world.irradiance.share else PHOTON_BYTES
    shares = []
    for slave in range(slaves):
        # As master.teams has it: slaves are dealt out to teams one by one.
        team, place, size = slave % teams, slave // teams, len(range(slave % teams, slaves, teams))
        cells = [cell for cell, holder in enumerate(balanced_holders(np.array(plan.burdens), size)) if holder == place]
        triangles, stored, copied = (float(amount[cells].sum()) for amount in (held, own, ghosts))
        own_triangles, own_instances = round(triangles * len(flat.triangles)) + shapes, round(triangles * standing)
        within = stored + copied  # of photons, and of surface points, which lie where photons may
        voxels, points = flat.media.grids.voxels, within * points_of(photons)
        of_photons = within * photons, flat.textures, voxels, own_instances, points, photon_bytes
        needed = scene_memory(own_triangles, *of_photons)
        elsewhere = (stored * (1.0 - 1.0 / teams) + copied) * photons
        received = triangles * _triangle_bytes(flat) + everywhere + elsewhere * _PHOTON_BYTES
        shares.append(
            Share(
                slave,
                team,
                len(cells),
                triangles,
                stored,
                copied,
                round(AT_WORK_BYTES + needed.divided + needed.everywhere),
                round(received),
            )
        )
    return tuple(shares)


def _triangle_bytes(flat: FlatScene) -> int:
    return flat.triangles.nbytes


_PHOTON_BYTES = sum(
    np.dtype(field.dtype).itemsize * int(np.prod(field.shape)) for field in SCHEMAS[Kind.COPIED_PHOTONS].values()
)
"""Of a stored photon on the wire, at most: its whole numbers may travel shorter."""
