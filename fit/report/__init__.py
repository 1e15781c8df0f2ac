"""The report: fit result and diagnosis as one self-contained HTML file."""
