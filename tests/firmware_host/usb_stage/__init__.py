"""Sensors that are not there: models that answer control transfers, in this process or behind a mocked USB bus."""
