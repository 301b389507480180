"""Units of sources in SI units. Source: the international foot and mile of 1959, which are exact."""

FOOT = 0.3048  # [m]
MILE = 5280 * FOOT  # [m]
MILE_PER_HOUR = MILE / 3600  # [m/s]
KILOMETRE_PER_HOUR = 1 / 3.6  # [m/s]
