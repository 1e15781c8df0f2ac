"""Third-party simulators, each in a separate Python process; used by the fitter and by the blind check."""
