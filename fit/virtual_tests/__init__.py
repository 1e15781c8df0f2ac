"""Test a fitted fabric virtually as a KES instrument would, and place it among measured fabrics."""
