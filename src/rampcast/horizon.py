"""The time grid of every forecast: 4 s of past and 15 s of future in steps of 0.2 s, as in the paper."""

STEP = 0.2  # [s] the paper, section "Data Set"
STEPS_PER_SECOND = round(1.0 / STEP)
WHOLE_SECONDS = slice(STEPS_PER_SECOND - 1, None, STEPS_PER_SECOND)  # of the steps after t = 0
EDGE = 1e-6  # [s] by which a row may lie off the ends of a span of time
SAME_STEP = 1e-9  # [s] times that differ by less are the same
PAST = 20  # steps of history, the last of them at t = 0; the paper: 4 s
FUTURE = 75  # steps of horizon; the paper: 15 s
