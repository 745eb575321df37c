"""Where slaves run: placed by Slurm, Dask or SSH, with keys of the run."""
