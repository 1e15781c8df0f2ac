"""Turn depth pixels into metric surfaces: scale, offset and interpolation."""
