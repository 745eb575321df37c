"""Paths from the camera: rays, vertices, what is seen there, and the sums that make a pixel."""
