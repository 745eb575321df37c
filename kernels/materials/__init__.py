"""Materials: from a hit to a scattering function, and how light scatters there and in media."""
