"""Third-party simulators as generators of the blind check."""
