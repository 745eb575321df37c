"""The data classes that a loader fills: what a scene is made of."""
