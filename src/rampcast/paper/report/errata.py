"""Where the paper is wrong or silent, and what rampcast does instead.

Source of each: the paper (Li, Fischer, Kontar, Ahn, arXiv 2108.10397) read against its own equations, against NGSIM's
data set descriptions, and against the recordings.
"""

from typing import NamedTuple


class Erratum(NamedTuple):
    """One place where the paper cannot be followed as printed."""

    number: int
    title: str
    text: str
    repair: str


ERRATA = (
    Erratum(
        1,
        "The date of the recording",
        "The paper gives the I-80 windows the date and hours of the US-101 recording (15 June 2005, 7:50 to 8:35).",
        "I-80 was recorded on 13 April 2005 at 16:00, 17:00 and 17:15; window 1 lies 45 minutes before window 2.",
    ),
    Erratum(
        2,
        "The law called Gipps'",
        "The printed law is a Gazis-Herman-Rothery law without the own-speed factor, not that of Gipps (1981), and "
        "raises a negative number to a real power.",
        "It is kept under the name “Gipps (paper)” with sign and size separated: "
        "a = α sign(v_m − v_i) |v_m − v_i|^β / s^γ. The law of 1981 is offered beside it.",
    ),
    Erratum(
        3,
        "The braking limit of Algorithm 1",
        "Accelerations below B are raised to B, with B fitted between 0.5 and 5 m/s²: no vehicle could ever brake.",
        "The limit is read as −B. The two laws without A and B are held within ±3.41 m/s².",
    ),
    Erratum(
        4,
        "The gap",
        "Gaps run from front to front, so the fitted standstill gap swallows the leader's length.",
        "Corrected mode takes the leader's length off; paper mode keeps the front-to-front gap.",
    ),
    Erratum(
        5,
        "Thirty-two separate forests",
        "The forests for different t need not agree or grow with t, balanced samples hide how rare a lane change is, "
        "and vehicles that leave the recorded road too early are dropped.",
        "Corrected mode also scores on all samples at their natural base rate, and counts what was censored.",
    ),
    Erratum(
        6,
        "Only vehicles seen for 19 s",
        "Asking for 19 s of track on 500 m of road picks the slow traffic.",
        "Corrected mode takes every scene, scores each second for which the truth exists, and states n.",
    ),
    Erratum(
        7,
        "When a lane change happens",
        "The lane label changes where the labelled ramp lane ends on the map, for most vehicles at the same place.",
        "Paper mode dates a lane change by the label; corrected mode by the crossing of the lane line.",
    ),
    Erratum(
        8,
        "Windows that overlap",
        "The files of windows 2 and 3 share about 3 minutes (17:12:45 to 17:15:46), so that training on 1 and 3 and "
        "testing on 2 is to test on traffic that was trained on.",
        "Paper mode keeps it. Corrected mode leaves all rows out of training that were recorded, by their Global_Time, "
        "while the test window was.",
    ),
    Erratum(
        9,
        "An initial trajectory that knows the future",
        "Trajectories are smoothed as a whole before the initial 4 s are cut from them, so that these know of the "
        "second that follows.",
        "Paper mode keeps it: its first seconds are flattered. In corrected mode every state is made from the raw rows "
        "up to t = 0 alone.",
    ),
    Erratum(
        10,
        "An actual leader abreast",
        "The actual leader can be abreast of the central vehicle, at a gap of nothing. The IDM then brakes without "
        "bound, and the mean squared error of such a fit is thousands, where the mean over all in print is 0.08 m²/s⁴.",
        "Gaps below 1 m count as 1 m. Tables of parameters count such drivers, and give the error without them too.",
    ),
)
