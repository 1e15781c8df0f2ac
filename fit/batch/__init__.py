"""Batch fits of every take of a folder or bucket, on this machine or a cluster, robust against killed processes."""
