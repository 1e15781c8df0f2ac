"""Fit every take of a folder or bucket over night, on this machine or a cluster, and survive killed processes."""
