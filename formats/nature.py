"""Constants of nature, and a quantile of the normal distribution, with which several packages compute."""

from __future__ import annotations

GRAVITY = 9.80665  # m/s^2, standard gravity (3rd CGPM, 1901)
AIR_DENSITY = 1.204  # kg/m^3, dry air at 20 degC and 101.325 kPa; p / (287.05 J/(kg K) T)
NORMAL_90 = 1.645  # 95 % quantile of the standard normal distribution, half the width of its central 90 %
