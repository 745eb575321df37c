"""Where irradiance records are made: their gather rays, wave by wave, and how many more each of them needs."""
