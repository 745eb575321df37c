"""What an error costs in time, on a scene and a machine: sweeps, figures and their page."""
