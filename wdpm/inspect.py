"""What is in a scene, and what each slave would hold of it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from wdpm.cluster.partition import rows_near
from wdpm.cluster.plan import Plan, make_plan
from wdpm.kernels.cells import cell_boxes
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.scene_settings import settings_for
from wdpm.scenes.geometry import FlatScene, flatten
from wdpm.scenes.model import Bitmap, Scene

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True)
class Share:
    """What one slave would hold.

    Attributes:
        triangles: as a share of the scene's.
        photons, ghosts: as shares of all photons, foretold from the pilot's.
    """

    slave: int
    cells: int
    triangles: float
    photons: float
    ghosts: float


@dataclass(frozen=True)
class Inspection:
    """A scene in figures.

    Attributes:
        extent: largest absolute coordinate after the scene is moved to its centre [scene units].
        lights: name and power [W], mean of the channels.
        paths: photon paths that a render with default settings would shoot.
        gather_radius: largest gather radius of such a render [scene units].
        dropped: triangles that are left out, by cause.
    """

    name: str
    meshes: int
    triangles: int
    materials: int
    textures: int
    lights: tuple[tuple[str, float], ...]
    size: tuple[int, int]
    extent: float
    photons: int
    paths: int
    gather_radius: float
    slaves: tuple[Share, ...]
    dropped: dict[str, int]
    warnings: tuple[str, ...]

    def to_json(self) -> str:
        """All of it as JSON."""
        return json.dumps(asdict(self), indent=2)

    def print(self, console: Console) -> None:
        """All of it as tables."""
        from rich.table import Table

        facts = Table(title=self.name, title_justify="left", show_header=False, box=None)
        rows = {
            "triangles": f"{self.triangles:,} in {self.meshes:,} meshes",
            "materials": f"{self.materials:,}, {self.textures:,} textures",
            "image": f"{self.size[0]} x {self.size[1]}",
            "extent": f"{self.extent:g} from its centre",
            "photons": f"{self.paths:,} paths for {self.photons:,} photons (default)",
            "gather radius": f"{self.gather_radius:.4g} at most",
        }
        rows |= {f"light {name}": f"{power:.4g} W" for name, power in self.lights[:12]}
        if len(self.lights) > 12:
            rows["lights"] = f"{len(self.lights) - 12:,} more"
        if self.dropped:
            rows["left out"] = ", ".join(f"{count:,} triangles: {cause}" for cause, count in self.dropped.items())
        for name, value in rows.items():
            facts.add_row(name, value)
        console.print(facts)
        table = Table(title="What each slave would hold", title_justify="left", box=None)
        for column in ("slave", "cells", "triangles", "photons", "ghosts"):
            table.add_column(column, justify="right")
        for share in self.slaves:
            amounts = (share.triangles, share.photons, share.ghosts)
            table.add_row(str(share.slave), str(share.cells), *(f"{amount:.1%}" for amount in amounts))
        console.print(table)
        for warning in self.warnings:
            console.print(f"warning: {warning}", markup=False, highlight=False)


def inspect(scene: Scene, *, slaves: int = 4) -> Inspection:
    """Look at a scene as a render with default settings would.

    Args:
        slaves: how many to divide it among.
    """
    settings = settings_for(scene)
    compile_kernels("cpu")
    flat = flatten(scene)
    launcher = Launcher("cpu")
    plan = make_plan(flat, settings, slaves, launcher)
    power = np.bincount(
        np.concatenate([plan.world.lights.triangle_light, plan.world.lights.point_light]),
        plan.world.lights.power,
        minlength=len(flat.light_names),
    )
    return Inspection(
        name=scene.name,
        meshes=len(scene.meshes),
        triangles=len(flat.triangles),
        materials=len(scene.materials),
        textures=sum(isinstance(material.reflectance, Bitmap) for material in scene.materials),
        lights=tuple((name, float(power[i])) for i, name in enumerate(flat.light_names)),
        size=(flat.camera.width, flat.camera.height),
        extent=flat.extent,
        photons=settings.photons,
        paths=plan.world.paths,
        gather_radius=plan.world.radius,
        slaves=_shares(plan, flat, slaves),
        dropped=flat.dropped,
        warnings=scene.warnings,
    )


def _shares(plan: Plan, flat: FlatScene, slaves: int) -> tuple[Share, ...]:
    """What each slave would hold, the photons foretold from the pilot's."""
    position = plan.pilot_photons
    tree = plan.world.top_tree
    low, high = cell_boxes(tree.axis, tree.split)
    triangles, photons, ghosts = np.zeros(slaves), np.zeros(slaves), np.zeros(slaves)
    for cell, worker in enumerate(plan.holders):
        inside = np.count_nonzero(np.all((position >= low[cell]) & (position < high[cell]), axis=1))
        near = len(rows_near(position, low[cell], high[cell], plan.world.band))
        triangles[worker] += len(plan.rows[cell]) / len(flat.triangles)
        photons[worker] += inside / max(len(position), 1)
        ghosts[worker] += (near - inside) / max(len(position), 1)
    return tuple(
        Share(
            worker, plan.holders.count(worker), float(triangles[worker]), float(photons[worker]), float(ghosts[worker])
        )
        for worker in range(slaves)
    )
