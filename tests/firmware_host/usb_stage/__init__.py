"""Simulated sensors: models that answer control transfers, in this process or behind a mocked USB bus."""
