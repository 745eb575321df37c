"""Polygons of mesh files, cut into triangles."""
