"""The places of a table: their unit by how fast vehicles are, plane or road by how they move, and what agrees."""

from typing import Any, Final

import numpy as np
import polars as pl

from rampcast.formats.readers.plain.mapping import ACCELERATIONS, LENGTHS, REFERENCES, SPEEDS
from rampcast.formats.steps.earth import in_metres, nearest_meridian
from rampcast.start.asking import Answers, Ask, Proposal, Question, StartError, answer_to
from rampcast.start.clock import seconds_of
from rampcast.start.motion import Motion, believable, fast, motion_of, nearest_factor, ratio
from rampcast.start.names import ALONG, key_of, unit_in, words_of

UTM: Final = 10_000.0  # [m] a coordinate beyond is one of a map, in metres
ASIDE: Final = 0.08  # of the way that vehicles on a straight road move across it, at most
WIDEST: Final = 45.0  # [m] of a road that runs along an axis
ALONG_AXIS: Final = 0.98  # of the vehicles move the same way on a table along the road
NGSIM: Final = {"vehicle": "vehicleid", "x": "localx", "y": "localy"}  # whose positions are of the front
CENTRE_WORDS: Final = {"center", "centre", "cx", "cy", "xc", "yc", "xcenter", "ycenter"}


def places_of(table: pl.DataFrame, columns: dict[str, str], answers: Answers, ask: Ask, proposal: Proposal) -> None:
    """Proposes places, and the speeds, accelerations and headings that agree with them."""
    moment = seconds_of(table, columns, proposal.values)
    vehicle = table[columns["vehicle"]] if "vehicle" in columns else table["vehicle"]
    if "latitude" in columns:
        motion = _on_earth(table, columns, vehicle, moment, proposal)
    else:
        motion = _on_plane_or_road(table, columns, vehicle, moment, answers, ask, proposal)
    _speed(table, columns, motion, answers, proposal)
    _acceleration(columns, answers, proposal)
    _heading(table, columns, motion, proposal)
    _reference(columns, answers, proposal)


def _on_earth(
    table: pl.DataFrame, columns: dict[str, str], vehicle: pl.Series, moment: pl.Series, proposal: Proposal
) -> Motion:
    latitude, longitude = (table[columns[name]] for name in ("latitude", "longitude"))
    meridian = nearest_meridian(longitude.drop_nulls().to_numpy())
    x, y = in_metres(latitude.to_numpy(), longitude.to_numpy(), meridian)
    zone = int((float(longitude.drop_nulls()[0]) + 180) // 6) + 1
    proposal.values["meridian"] = meridian
    proposal.say("latitude", columns["latitude"], f"'{columns['latitude']}', degrees")
    how = f"put into a plane around {meridian:g} degrees east (in UTM's zone {zone})"
    proposal.say("longitude", columns["longitude"], f"'{columns['longitude']}', degrees; {how}")
    return motion_of(vehicle, moment, pl.Series(x), pl.Series(y))


def _on_plane_or_road(
    table: pl.DataFrame, columns: dict[str, str], vehicle: pl.Series, moment: pl.Series, answers: Answers, ask: Ask,
    proposal: Proposal,
) -> Motion:  # fmt: skip
    x, y = table[columns["x"]], table[columns["y"]] if "y" in columns else None
    motion = motion_of(vehicle, moment, x, y)
    unit, why = _length_unit(table, columns, motion, answers, ask)
    factor = LENGTHS.get(unit) or float(unit)
    metres = Motion(motion.dt, motion.dx * factor, motion.dy * factor, motion.at)
    if not len(metres.dt):
        raise StartError(
            "no vehicle has two rows at two times: these are no trajectories. Is the id right? --column vehicle=NAME"
        )
    axes, is_plane, shape = _axes(table, columns, metres, factor, answers)
    proposal.reasons.append(f"{'plane' if is_plane else 'road'}: {shape}")
    for name, (column, flip) in axes.items():
        value: dict[str, Any] = {"column": column} | (
            {"unit": unit if unit in LENGTHS else factor} if unit != "m" else {}
        )
        value |= {"flip": True} if flip else {}
        proposal.say(name, value if len(value) > 1 else column, f"'{column}' in {unit}{', turned' * flip}, by {why}")
    if is_plane:
        proposal.values["plane"] = True
    return metres


def _length_unit(
    table: pl.DataFrame, columns: dict[str, str], motion: Motion, answers: Answers, ask: Ask
) -> tuple[str, str]:
    """Returns the unit of x and y, and what told it."""
    name = columns["x"]
    said, named = answers.units.get("x", ""), unit_in(name)
    if said:
        return said, "what was said"
    speeds = motion.speed
    if named == "px" or "px" in words_of(name):
        text = f"How many metres is a pixel? '{name}' is in pixels, and pixels do not tell."
        return answer_to(Question(text, "--unit x=METRES, as --unit x=0.05"), ask), "what was answered"
    if named in LENGTHS:
        return named, "its name"
    if "speed" in columns:
        recorded = table[columns["speed"]].cast(pl.Float64, strict=False).to_numpy()[motion.at]
        speed_unit = answers.units.get("speed") or unit_in(columns["speed"])
        if speed_unit in SPEEDS:
            found = nearest_factor(ratio(recorded * SPEEDS[speed_unit], speeds), {u: 1 / f for u, f in LENGTHS.items()})
            if found:
                return found, f"'{columns['speed']}', which is in {speed_unit}"
    largest = max(float(table[columns[one]].abs().max() or 0.0) for one in ("x", "y") if one in columns)  # type: ignore[arg-type]
    fitting = [unit for unit in ("m", "ft", "cm", "mm", "km") if believable(speeds, LENGTHS[unit])]
    if largest > UTM and believable(speeds, 1.0):
        return "m", "how large it is (a map's easting and northing)"
    if fitting and fitting[0] == "m" and fast(speeds) < 50:
        return "m", f"how fast vehicles are ({fast(speeds) * 3.6:.0f} km/h, the fastest in twenty)"
    if fitting:
        fastest = fast(speeds) * LENGTHS[fitting[0]] * 3.6
        return fitting[0], f"how fast vehicles are ({fastest:.0f} km/h, the fastest in twenty)"
    text = (
        f"Which unit has '{name}'? Vehicles move {fast(speeds):.3g} of it in a second: no speed in m, ft, cm, mm or km."
    )
    option = "--unit x=ft, or --unit x=0.05 (metres in one); or is the time another, as --unit time=ms?"
    return answer_to(Question(text, option), ask), "what was answered"


def _axes(
    table: pl.DataFrame, columns: dict[str, str], motion: Motion, factor: float, answers: Answers
) -> tuple[dict[str, tuple[str, bool]], bool, str]:
    """Returns the column of x and y and whether it is turned, whether they are a plane, and why."""
    if "y" not in columns:
        flip = float(np.median(motion.dx)) < 0
        return {"x": (columns["x"], flip)}, False, f"there is no y; x {'falls' if flip else 'grows'} as vehicles drive"
    as_they_are = {"x": (columns["x"], False), "y": (columns["y"], False)}
    if answers.plane:
        return as_they_are, True, "what was said"
    nearest = min(float(table[columns[one]].abs().min() or 0.0) for one in ("x", "y"))  # type: ignore[arg-type]
    if answers.plane is None and nearest * factor > UTM:
        return as_they_are, True, "places are those of a map"
    moved = np.hypot(motion.dx, motion.dy)
    is_moving = moved > 0.2 * fast(moved)
    along_x, along_y = (float(np.median(np.abs(d[is_moving]) / moved[is_moving])) for d in (motion.dx, motion.dy))
    extent = {one: float(np.ptp(table[columns[one]].drop_nulls().to_numpy())) * factor for one in ("x", "y")}
    for along, across, share_across in (("x", "y", along_y), ("y", "x", along_x)):
        forward = (motion.dx if along == "x" else motion.dy)[is_moving] > 0
        share = float(forward.mean())
        is_road = answers.plane is False or key_of(columns[along]) in ALONG
        one_way = max(share, 1 - share) >= ALONG_AXIS
        if (is_road and along == "x") or (share_across <= ASIDE and extent[across] <= WIDEST and one_way):
            flip = share < 0.5
            turned_across = flip if along == "x" else not flip
            grows = "which falls" if flip else "which grows"
            how = f"vehicles drive along {columns[along]}, {grows}, and {extent[across]:.0f} m wide"
            return {"x": (columns[along], flip), "y": (columns[across], turned_across)}, False, how
    return as_they_are, True, "vehicles drive in several directions, or along no axis"


def _speed(table: pl.DataFrame, columns: dict[str, str], motion: Motion, answers: Answers, proposal: Proposal) -> None:
    if "speed" not in columns:
        return
    name = columns["speed"]
    found = ratio(table[name].cast(pl.Float64, strict=False).to_numpy()[motion.at], motion.speed)
    unit = answers.units.get("speed") or nearest_factor(found, SPEEDS)
    if not unit:
        proposal.reasons.append(
            f"speed: '{name}' is left out, it is {found:.2f} times the speeds of the positions, which is no unit"
        )
        return
    why = f"the positions, whose speeds in m/s it is {found:.2f} times"
    proposal.say("speed", name if unit == "m/s" else {"column": name, "unit": unit}, f"'{name}' in {unit}, by {why}")


def _acceleration(columns: dict[str, str], answers: Answers, proposal: Proposal) -> None:
    if "acceleration" not in columns:
        return
    name = columns["acceleration"]
    speed = proposal.values["columns"].get("speed")
    in_feet = isinstance(speed, dict) and speed.get("unit") == "ft/s"
    unit = answers.units.get("acceleration") or unit_in(name) or ("ft/s2" if in_feet else "m/s2")
    if unit in ACCELERATIONS:
        value = name if unit == "m/s2" else {"column": name, "unit": unit}
        proposal.say("acceleration", value, f"'{name}' in {unit}")


def _heading(table: pl.DataFrame, columns: dict[str, str], motion: Motion, proposal: Proposal) -> None:
    if "heading" not in columns or not len(motion.dt):
        return
    name = columns["heading"]
    recorded = table[name].to_numpy()[motion.at].astype(np.float64)
    is_moving = (motion.speed > 0.3 * fast(motion.speed)) & np.isfinite(recorded)
    moved = np.arctan2(motion.dy, motion.dx)[is_moving]
    scale = np.pi / 180 if np.nanmax(np.abs(recorded)) > 7.0 else 1.0
    unit = "rad" if scale == 1.0 else "deg"
    ways = {unit: recorded[is_moving] * scale, f"{unit} from north": np.pi / 2 - recorded[is_moving] * scale}
    off = {one: float(np.median(np.abs(np.angle(np.exp(1j * (way - moved)))))) for one, way in ways.items()}
    best = min(off, key=lambda one: off[one])
    if off[best] > 0.25 or (
        "y" in columns
        and isinstance(proposal.values["columns"].get("x"), dict)
        and proposal.values["columns"]["x"].get("flip")
    ):
        proposal.reasons.append(f"heading: '{name}' is left out, it does not agree with how vehicles move")
        return
    proposal.say(
        "heading", name if best == "rad" else {"column": name, "unit": best}, f"'{name}' in {best}, as vehicles move"
    )


def _reference(columns: dict[str, str], answers: Answers, proposal: Proposal) -> None:
    """Proposes which point of a vehicle the positions are; nothing but a name tells it."""
    name = key_of(columns.get("x", columns.get("latitude", "")))
    told = next(
        (one for one in ("front", "rear") if one in name),
        "centre" if any(word in name for word in CENTRE_WORDS) else "",
    )
    told = told or ("front" if all(key_of(columns.get(role, "")) == key for role, key in NGSIM.items()) else "")
    reference = answers.reference or told or "centre"
    if reference not in REFERENCES:
        raise StartError(f"--reference: expected one of {', '.join(REFERENCES)}, got {reference}")
    proposal.values["reference"] = reference
    if not answers.reference and not told:
        proposal.assumed.append("reference")
    why = (
        "what was said"
        if answers.reference
        else "its name"
        if told
        else "what most sources do; nothing tells it (--reference front)"
    )
    proposal.reasons.append(f"reference: {reference} of the vehicle, by {why}")
