"""The report: fit result and diagnosis as one HTML file that needs nothing else."""
