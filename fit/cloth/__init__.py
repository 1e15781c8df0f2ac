"""Cloth simulator: mesh, material, support, contact, and whole rollouts of many candidates in parallel."""
