"""Light from no lamp: interreflection, ambient and stray light in shadows, light that spreads below the surface."""
