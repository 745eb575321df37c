"""From a scene to what a render needs: cells, maps, shares of light, and which effects are computed."""
