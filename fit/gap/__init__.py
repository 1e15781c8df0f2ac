"""Diagnosis of the sim-to-real gap: its location, the unmodelled effect that causes it, and the share it closes."""
