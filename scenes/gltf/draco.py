"""Meshes that Draco has compressed (KHR_draco_mesh_compression), by the library DracoPy, which is optional.

A compressed primitive has accessors without data; what is decoded becomes their values.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from wdpm.scenes.gltf.container import GltfFile

DRACO: Final = "KHR_draco_mesh_compression"


def decompress(gltf: GltfFile, primitive: dict[str, Any]) -> None:
    """Supply a primitive's accessors with what is compressed, if it is.

    Raises:
        SceneError: broken, or the library is not there.
    """
    extensions = gltf.get(primitive, "extensions", dict, {})
    if DRACO not in extensions:
        return
    compressed: dict[str, Any] = gltf.get(extensions, DRACO, dict, {})
    mesh = _decoded(gltf, bytes(gltf.view_bytes(compressed.get("bufferView"))))
    attributes = gltf.get(primitive, "attributes", dict, {})
    for name, number in gltf.get(compressed, "attributes", dict, {}).items():
        found = mesh.get_attribute_by_unique_id(number) if isinstance(number, int) else None
        if found is None or name not in attributes:
            raise gltf.error(f'broken glTF: Draco has no attribute {number} for "{name}"')
        gltf.supply(attributes[name], np.asarray(found["data"]))
    if "indices" in primitive:
        gltf.supply(primitive["indices"], np.asarray(mesh.faces).reshape(-1, 1))


def _decoded(gltf: GltfFile, data: bytes) -> Any:
    try:
        import DracoPy
    except ModuleNotFoundError:
        raise gltf.error("its meshes are compressed by Draco: pip install 'wdpm[draco]' reads them") from None
    try:
        mesh = DracoPy.decode(data)
    except Exception as error:  # the library's exceptions have no base of their own
        raise gltf.error(f"broken glTF: Draco: {' '.join(str(error).split())}") from error
    if not hasattr(mesh, "faces"):
        raise gltf.error("broken glTF: Draco: points without triangles")
    return mesh
