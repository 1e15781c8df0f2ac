"""Constants of nature that several packages compute with."""

from __future__ import annotations

GRAVITY = 9.80665  # m/s^2, standard gravity (3rd CGPM, 1901)
AIR_DENSITY = 1.204  # kg/m^3, dry air at 20 degC and 101.325 kPa
NORMAL_90 = 1.645  # standard deviations: half the central 90 % of a normal distribution, and up to its percentile 95
