"""Floors below which a measured quantity is not resolved, so that real powers of it stay finite."""

MINIMUM_SPEED = 0.1  # [m/s]; positions good to 0.3 m, smoothed over 2 s, give speeds good to about 0.1 m/s
MINIMUM_SPEED_DIFFERENCE = 0.1  # [m/s]; the same; |v_m - v_i|^beta with beta < 0 diverges at equal speeds
RECORDED_LIMIT = 3.41  # [m/s^2]; 11.2 ft/s^2, at which NGSIM clips its accelerations (Coifman & Li 2017, TR-B 105)
MINIMUM_GAP = 1.0  # [m]; vehicles in a queue stand further apart, and NGSIM positions are no better than this (Coifman
# & Li 2017): a smaller or negative gap is an overlap of forecasts, or noise
