"""wdpm: global illumination by distributed photon mapping."""
