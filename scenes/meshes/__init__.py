"""Reading meshes: OBJ with MTL, PLY, STL, OFF; and round shapes as triangles."""
