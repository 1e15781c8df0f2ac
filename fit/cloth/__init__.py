"""The cloth: mesh, material, what drives it, and whole rollouts of many candidates at once."""
