"""Where caustics come from, as photons tell it to paths: their flight, lobes for regions of space, their worth."""
