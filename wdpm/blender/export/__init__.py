"""From what Blender has evaluated to a wdpm Scene, without a file between."""
