"""Measure where the hanger's markers, the sensor's depth and gravity really are, from frames at rest."""
