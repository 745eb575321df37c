"""A cluster in simulated time: its own master and slaves, real kernels, and machines and links that are not there."""
