"""The doctor's checks: what counts as a fault, how often it may come, what to do, and why. One entry each.

The shares are those of what is counted. A check never spoils a forecast where later steps repair or do without what is
wrong (smoothing takes the noise of raw accelerations, recorded speeds are not used).
"""

from rampcast.doctor.checks import clock, identity, motion, ramp, reading, recorded, traffic
from rampcast.doctor.checks.units import units
from rampcast.doctor.finding import Check

_FILES = (
    Check(
        "malformed_rows", "Rows that are not as their format says", "rows", "", look=reading.malformed,
        limit="what the format's page says of each column",
        advice="Get the file again. If only few rows are torn, go on with --skip-bad-rows.",
        warns=0.0, spoils=0.05, why="a file with one bad row in twenty was damaged or changed; what is left has holes",
    ),
    Check(
        "duplicates", "Rows that come more than once", "rows", "1 a row", look=reading.duplicates,
        limit="the same recording, vehicle and frame as a row before",
        advice="Nothing: the first row is kept. The portal's export of NGSIM is known for it.",
        warns=0.01, why="the first is kept, which is right if they are equal",
    ),
    Check(
        "conflicting_duplicates", "Rows that come more than once and differ", "rows", "distance [m]",
        look=reading.conflicts,
        limit="the same recording, vehicle and frame as a row before, another position or lane",
        advice="Two vehicles share an id, or two windows were joined as one: convert each file alone.",
        warns=0.0, spoils=0.01, why="which of the two positions is right is not known; of 1 % each 4 s history has one",
    ),
    Check(
        "clock_slips", "Frame and time do not advance together", "rows", "", look=reading.counted("clock_slips"),
        limit="more than 10 % of a frame off, or Frame_ID and Global_Time that part",
        advice="Use the original file: a spreadsheet rounds long times, and resampling breaks frame numbers.",
        warns=0.0, spoils=0.01, why="speeds are positions over time: a wrong time is a wrong speed",
    ),
    Check(
        "time_backwards", "Time goes backwards", "rows", "how far back [s]", look=identity.out_of_order,
        limit="a frame before that of the row above, of the same vehicle",
        advice="Sort the table by recording, vehicle and frame, as every reader of files does.",
        warns=0.0, spoils=0.0, why="scenes are built from rows in order; a single one out of order breaks its track",
    ),
    Check(
        "rows_off_road", "Rows beside the site's road", "rows", "", look=reading.counted("rows_off_road"),
        limit="more than one lane's width beside the outermost lanes, or 50 m before or behind the section",
        advice="Fine if the files hold other roads too (the opposite carriageway); else the site does not fit them.",
        warns=0.6, why="two carriageways in one file are usual and leave half of the rows on the other one",
    ),
    Check(
        "rows_outside_windows", "Rows outside all recorded windows", "rows", "",
        look=reading.counted("rows_outside_windows"),
        limit="the site's windows, which it names with their times",
        advice="Check the site's windows and its time zone; such rows are kept under the site's name alone.",
        warns=0.01, why="a few seconds beyond a window are usual",
    ),
    Check(
        "rows_interpolated", "Rows whose time lay between two frames", "rows", "",
        look=reading.counted("rows_interpolated"),
        limit="a time that is no whole number of frames",
        advice="They were interpolated to the frames. Fine for recorders of an odd rate; else the time step is wrong.",
        why="interpolation moves a vehicle by less than its own noise",
    ),
    Check(
        "rows_not_vehicles", "Rows of pedestrians, cyclists and things", "rows", "",
        look=reading.counted("rows_not_vehicles"),
        limit="the kinds that the format names",
        advice="They were left out. Many on a motorway: the source's classes are not reliable.",
        warns=0.1, why="one row in ten of something else is no motorway",
    ),
)  # fmt: skip

_IDENTITY = (
    Check(
        "gaps", "Holes in tracks", "rows", "missing [s]", look=identity.gaps,
        limit="2 frames or more, up to 5 s, from a vehicle's row to its next",
        advice="They are filled by straight lines and never scored. Leave out vehicles with many of them.",
        warns=0.001, spoils=0.05, why="with one row in twenty after a hole, every 4 s history is partly made up",
    ),
    Check(
        "missing_moments", "Moments that are missing for everybody", "frames", "missing [s]",
        look=clock.missing_moments,
        limit="frames without any row between two frames that at least two vehicles bridge",
        advice="The recorder stopped, or a part of the file was lost: get it again, or cut the recording there.",
        warns=0.0, spoils=0.05, why="as for holes in tracks",
    ),
    Check(
        "clock_jumps", "Everybody jumps at once", "frames", "median jump [m]", look=clock.clock_jumps,
        limit="more than half of the vehicles seen, and at least three, jump at one frame",
        advice="The clock or the camera jumped there: cut the recording in two at this frame.",
        warns=0.0, spoils=0.001, why="one such frame in 1,000 spoils 4 s of history in every 100 s for all vehicles",
    ),
    Check(
        "reused_ids", "Ids that come back", "vehicles", "away for [s]", look=identity.reused_ids,
        limit="5 s or more without a row: a lost vehicle is found again sooner (docs/methods.md, section 2)",
        advice="The two parts are treated as two tracks. If most ids come back, windows were joined as one.",
        warns=0.01, spoils=0.2, why="no track runs over such a hole, so only counts are wrong; a fifth is no accident",
    ),
    Check(
        "changing_sizes", "Vehicles that change their length", "vehicles", "change [m]", look=identity.changing_sizes,
        limit="0.5 m from one row to the next: more than a length measured in each frame trembles",
        advice="Either two vehicles share the id, or lengths are measured anew in each frame: use their median.",
        warns=0.01, spoils=0.2, why="gaps to the vehicle are wrong by as much, and its track may be two",
    ),
    Check(
        "fragments", "Tracks too short to smooth", "tracks", "rows", look=identity.fragments,
        limit="fewer than 5 rows without a hole of more than 5 s: a cubic needs them",
        advice="They are left out. Many of them: the tracker loses vehicles, so leaders are missing too.",
        warns=0.05, why="a vehicle lost so soon is mostly noise; one track in twenty is a leader now and then",
    ),
    Check(
        "sizes_filled", "Sizes that the source does not give", "rows", "", look=reading.counted("sizes_filled"),
        limit="length or width missing or 0 in the file",
        advice="Typical sizes of their kind stand in. Where lengths are missing, gaps to such vehicles are wrong by a "
        "metre or two; where only widths are, no forecast changes.",
        warns=0.1, why="bumper-to-bumper gaps need the leader's length; 1 to 2 m of 10 m",
    ),
    Check(
        "impossible_sizes", "Lengths that no vehicle has", "rows", "length [m]", look=identity.impossible_sizes,
        limit="below 1 m or above 30 m: a moped is 1.7 m long, the longest road trains in Europe are 25.25 m",
        advice="Look at these vehicles: they may be pedestrians, shadows, or two vehicles taken for one.",
        warns=0.0, spoils=0.1, why="gaps to one leader in ten would be wrong",
    ),
)  # fmt: skip

_MOTION = (
    Check(
        "cannot_smooth", "The recording cannot be smoothed", "recordings", "", look=motion.unsmoothable,
        limit="tracks of 5 rows or more, and a time step that smoothing takes",
        advice="Without smoothing there are no speeds and no forecasts: see the reason.",
        warns=0.0, spoils=0.0, why="every later step needs smoothed states",
    ),
    Check(
        "units", "Units that look wrong", "quantities", "value", look=units,
        limit="median car 3.3 to 6.5 m, lanes 2.5 to 5 m apart, median speed up to 70 m/s, recorded speed within "
        "0.8 to 1.25 of the derived one or in a known unit",
        advice="Convert the file once, from its own units: each format's page names them; a mapping file states them.",
        warns=0.0, spoils=0.0, why="every number would be wrong by the factor",
    ),
    Check(
        "teleports", "Vehicles that jump", "rows", "jump [m]", look=motion.teleports,
        limit="2 m (half a small car) and all that 8 m/s² allow away from where the two rows before and after say",
        advice="Two vehicles share the id, or the tracker swapped them: leave these vehicles out, or cut their tracks. "
        "In simulated traffic, the simulator changes lanes in one step: let it take its time (in SUMO with "
        "--lanechange.duration 3).",
        warns=0.0, spoils=0.001, why="at 10 rows a second, one in 1,000 is one in every 100 s of a track",
    ),
    Check(
        "impossible_speeds", "Speeds that no vehicle has", "rows", "speed [m/s]", look=motion.speeds,
        limit="70 m/s (252 km/h), above the 250 km/h to which makers limit fast cars, where it is no jump",
        advice="If nearly all are too fast, the unit or the time step is wrong; if a few, they are jumps.",
        warns=0.0, spoils=0.01, why="a forecast is speed times time",
    ),
    Check(
        "raw_accelerations", "Accelerations beyond grip, before smoothing", "accelerations", "a [m/s²]",
        look=motion.raw_accelerations,
        limit="8 m/s², about the grip of a dry road (docs/methods.md, section 2), of second differences of positions",
        advice="Noise of the positions, which smoothing takes away. Never use accelerations derived without it.",
        warns=0.05, why="smoothing is made for it; the finding after smoothing tells what it leaves",
    ),
    Check(
        "accelerations", "Accelerations beyond grip, after smoothing", "smoothed rows", "a [m/s²]",
        look=motion.accelerations,
        limit="8 m/s², about the grip of a dry road",
        advice="Look at the examples: jumps, swapped ids and wrong time stamps survive smoothing. Leave them out.",
        warns=0.0, spoils=0.01, why="one state in 100 is one in every 20 s of a track",
    ),
    Check(
        "hard_accelerations", "Very hard accelerations, after smoothing", "smoothed rows", "a [m/s²]",
        look=motion.hard_accelerations,
        limit="3.41 m/s² = 11.2 ft/s², where NGSIM clips its own (Coifman and Li 2017), up to 8 m/s²",
        advice="Drivers brake so hard now and then. A large share is noise that smoothing left.",
        warns=0.05, why="emergency braking is rare; in one row of twenty it is not that",
    ),
    Check(
        "jerks", "Jerks that no vehicle has, after smoothing", "smoothed rows", "jerk [m/s³]", look=motion.jerks,
        limit="15 m/s³ (Punzo, Borzacchiello and Ciuffo 2011, Transportation Research C 19)",
        advice="Noise that smoothing left. Positions and speeds are hardly touched by it.",
        warns=0.01, why="no model of rampcast uses jerks",
    ),
    Check(
        "backing", "Vehicles that back up", "smoothed rows", "v [m/s]", look=motion.backing,
        limit="1 m/s backwards after smoothing, which is more than the noise of a vehicle that stands",
        advice="On a motorway nobody backs up: the tracker slid back, or swapped two vehicles.",
        warns=0.001, spoils=0.05, why="car-following laws know no negative speeds",
    ),
    Check(
        "against_traffic", "Vehicles that drive the wrong way", "vehicles", "moved [m]", look=motion.against_traffic,
        limit="5 m or more behind its first row at its last",
        advice="x must grow downstream. Separate the carriageways, or turn the reference line of the site round.",
        warns=0.0, spoils=0.1, why="leader and follower are swapped for such vehicles; one in ten is a carriageway",
    ),
    Check(
        "standing", "Vehicles that never move", "vehicles", "seen [s]", look=motion.standing,
        limit="less than 2 m in all of 60 s or more: a stop-and-go wave lets a vehicle go sooner",
        advice="Parked vehicles, signs and shadows: leave them out, they would be leaders of others.",
        warns=0.0, spoils=0.1, why="one vehicle in ten that stands would block the lanes",
    ),
    Check(
        "recorded_speeds", "Recorded speeds that the positions do not bear out", "rows compared", "difference [m/s]",
        look=recorded.recorded_speeds,
        limit="2 m/s off the mean speed over 1 s: 10 m after 5 s",
        advice="rampcast uses the derived speed. Many rows off: compare the units and the time step of the file.",
        warns=0.01, why="recorded speeds are used for nothing but this comparison",
    ),
    Check(
        "recorded_accelerations", "Recorded accelerations that the positions do not bear out", "rows compared",
        "difference [m/s²]", look=recorded.recorded_accelerations,
        limit="3 m/s² off the mean acceleration over 2 s: the difference between driving on and braking hard",
        advice="rampcast uses the derived acceleration. NGSIM's recorded ones are known to be wrong.",
        warns=0.05, why="recorded accelerations are used for nothing but this comparison",
    ),
    Check(
        "clipped_accelerations", "Recorded accelerations that end at a limit", "rows", "a [m/s²]",
        look=recorded.clipped_accelerations,
        limit="more than 0.1 % of the rows, and 20, have exactly the largest or the smallest value",
        advice="The source clips its accelerations (NGSIM at 3.41 m/s²): do not calibrate with them.",
        warns=0.01, why="recorded accelerations are used for nothing but comparison",
    ),
)  # fmt: skip

_TRAFFIC = (
    Check(
        "overlaps", "Vehicles that overlap", "rows", "overlap [m]", look=traffic.overlaps,
        limit="a front ahead of the rear of the next vehicle in the same lane and frame",
        advice="Positions, lengths or lanes of one of the two are wrong. Car-following laws break at gaps below 0.",
        warns=0.0, spoils=0.01, why="with one row in 100, a vehicle followed for 20 s overlaps once on average",
    ),
    Check(
        "lane_flicker", "Lanes that flicker", "lane changes", "stays [s]", look=traffic.lane_flicker,
        limit="back in the old lane within 2 s: one lane change takes several seconds",
        advice="A vehicle on a line is put now here, now there. Use the crossing of the line as the lane change.",
        warns=0.02, spoils=0.2, why="when the lane changes is what is forecast; a fifth of the changes would be none",
    ),
    Check(
        "lanes_against_positions", "Lanes that the positions do not bear out", "rows", "off the lane's centre [m]",
        look=traffic.lanes_against_positions,
        limit="more than one lane's width from the centre of the lane; ramp lanes between gore and ramp end only",
        advice="The site does not fit the recording, or lanes are labelled late: see the picture.",
        warns=0.01, spoils=0.2, why="leaders are sought by lane: a fifth of them would be someone in another lane",
    ),
    Check(
        "off_lanes", "Rows in none of the site's lanes", "rows", "lane", look=traffic.off_lanes,
        limit="a lane number that the site does not list",
        advice="Shoulders and gores are usual. If many: add the lane to the site file.",
        warns=0.01, spoils=0.5, why="such vehicles are nobody's leader; half of all: it is another site",
    ),
)  # fmt: skip

_RAMP = (
    Check(
        "no_history", "Nobody is seen for 4 s on the ramp", "recordings", "", look=ramp.history,
        limit="20 steps of 0.2 s in a row in a ramp lane: the paper's history",
        advice="There is nothing to forecast: check which lane is the ramp with rampcast site, or record longer.",
        warns=0.0, spoils=0.0, why="a forecast needs 4 s of observation",
    ),
    Check(
        "virtual_neighbours", "Neighbours that nobody fills", "neighbours", "of six missing",
        look=ramp.virtual_neighbours,
        limit="leader, follower and four in the target lane, at every second of every on-ramp vehicle",
        advice="Standing stand-ins take their place, as in the paper. Many: the recording lacks lanes, or is short.",
        notes=0.5, warns=0.7, spoils=0.95,
        why="light traffic leaves a half empty; with 19 of 20 missing there is no traffic to react to",
    ),
    Check(
        "unseen_merges", "On-ramp vehicles whose merge is never seen", "on-ramp vehicles", "seen [s]",
        look=ramp.unseen_merges,
        limit="no row outside the ramp lanes",
        advice="They train and test positions, not lane changes. Record further downstream if it is most of them.",
        notes=0.25, warns=0.5, spoils=0.99, why="without any merge there is no lane change to learn or to score",
    ),
    Check(
        "short_stays", "On-ramp vehicles seen for less than 19 s", "on-ramp vehicles", "seen [s]",
        look=ramp.short_stays,
        limit="19 s: 4 s of history and 15 s of horizon (the paper, section Data Set)",
        advice="Far horizons are scored on the few that are seen longer: look at n beside every error.",
        notes=0.25, warns=0.5, why="shorter tracks still give shorter horizons",
    ),
    Check(
        "cut_tracks", "Tracks that begin or end inside the section", "ends of tracks", "from the edge [m]",
        look=ramp.cut_tracks,
        limit="50 m inside of where 9 in 10 tracks of a lane begin or end, and not when the recording does",
        advice="The tracker lost or found them late; others do not see them before or after. Nothing to mend here.",
        warns=0.05, why="neighbours that appear late are missing before; rampcast marks them as not there",
    ),
)  # fmt: skip

CHECKS: tuple[Check, ...] = (*_FILES, *_IDENTITY, *_MOTION, *_TRAFFIC, *_RAMP)
