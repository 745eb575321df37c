"""Where a ray meets a triangle, and which cells it crosses."""
