"""From a scene and settings to an image: preparation, passes, results."""
