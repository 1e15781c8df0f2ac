"""Virtual KES tests of a fitted fabric, and its comparison with measured fabrics."""
