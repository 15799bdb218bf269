"""Light that lamps do not send directly: interreflection, ambient and stray light, light below the surface."""
