"""Check and repair of the folder in which Taichi keeps compiled kernels, before Taichi reads the folder."""
