"""Samples of pixels from the camera to the end of their paths, in one launch."""
