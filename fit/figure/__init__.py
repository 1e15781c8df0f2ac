"""Simulation of a fitted skirt or T-shirt that a walking figure wears."""
