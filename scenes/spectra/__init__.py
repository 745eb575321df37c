"""Spectra by wavelength, and the colours that they have in linear sRGB."""
