"""What columns are called: the words and the unit in a name, and which value they may be."""

import re
from collections.abc import Mapping, Sequence
from typing import Final

UNIT_NAMES: Final[Mapping[str, str]] = {
    "km/h": "km/h", "kmh": "km/h", "kph": "km/h", "kmph": "km/h", "m/s": "m/s", "mps": "m/s", "mph": "mph",
    "ft/s": "ft/s", "fps": "ft/s", "m/s2": "m/s2", "m/s²": "m/s2", "m/s^2": "m/s2", "mps2": "m/s2", "ft/s2": "ft/s2",
    "g": "g", "m": "m", "meter": "m", "meters": "m", "metres": "m", "cm": "cm", "mm": "mm", "km": "km", "ft": "ft",
    "feet": "ft", "deg": "deg", "degrees": "deg", "degree": "deg", "rad": "rad", "s": "s", "sec": "s", "seconds": "s",
    "ms": "ms", "msec": "ms", "millis": "ms", "us": "us", "ns": "ns", "px": "px", "pixel": "px", "pixels": "px",
}  # fmt: skip
# The names of each value without their units, the likeliest first; words of one name are written together.
NAMES: Final[Mapping[str, str]] = {
    "vehicle": "vehicleid trackid objectid objid actorid agentid vehid carid targetid deviceid tripid id vehicle track"
    " object veh obj oid vid tid car target fahrzeugid fahrzeug device trip nr",
    "frame": "frameid framenumber framenr frameno framenum frameindex frame timestep fr bild",
    "time": "timestamp datetime globaltime gpstime utctime unixtime time epoch utc ts t zeitstempel zeit clock date"
    " simtime simsec elapsed elapsedtime sec seconds timestep",
    "latitude": "latitude gpslat lat positionlat",
    "longitude": "longitude gpslon lon lng long positionlon",
    "x": "x xcenter centerx xcentre centrex posx positionx xpos xposition utmx xutm utme utmeasting easting east"
    " rechtswert cx xc frontx xfront rearx xrear worldx xworld localx xlocal station chainage along alongroad"
    " longitudinal s distance dist position pos",
    "y": "y ycenter centery ycentre centrey posy positiony ypos yposition utmy yutm utmn utmnorthing northing north"
    " hochwert cy yc fronty yfront reary yrear worldy yworld localy ylocal lateral lateraloffset"
    " lateralposition across offset d",
    "speed": "speed v velocity vel vvel geschwindigkeit sog vehiclespeed spd gpsspeed speedoverground totalspeed",
    "acceleration": "acceleration accel acc vacc a longacc lonacc lonacceleration longitudinalacceleration"
    " beschleunigung",
    "heading": "heading hdg yaw psi course cog bearing azimuth orientation angle direction theta kurs",
    "lane": "laneid lanenumber laneno lanenr laneindex lane spur fahrstreifen",
    "length": "length len vehiclelength vehlength vlength l laenge",
    "width": "width vehiclewidth vehwidth vwidth w breite",
    "kind": "class type kind category vehicleclass vehicletype vehclass vehtype objectclass objecttype classname label"
    " klasse",
}
ALONG: Final = {"station", "chainage", "along", "alongroad", "longitudinal", "s", "distance", "dist", "position", "pos"}
KINDS: Final[Mapping[str, str]] = {
    **dict.fromkeys(("car", "auto", "pkw", "passenger", "suv", "sedan", "van", "taxi", "passengercar", "lightvehicle",
                     "vehicle", "pickup", "transporter"), "car"),
    **dict.fromkeys(("truck", "lkw", "lorry", "bus", "hgv", "heavy", "heavyvehicle", "trailer", "semi"), "truck"),
    **dict.fromkeys(("motorcycle", "motorbike", "moto", "motorrad", "kraftrad"), "motorcycle"),
    **dict.fromkeys(("person", "pedestrian", "bicycle", "cyclist", "bike", "animal", "dog", "unknown_object"), "none"),
}  # fmt: skip


def words_of(name: str) -> list[str]:
    """Returns the words of a column's name in small letters: trackId, track_id and "Track ID" are the same two."""
    parted = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return [word for word in re.split(r"[^0-9a-zA-Z/²^äöüÄÖÜß]+", parted.lower()) if word.strip("/^")]


def unit_in(name: str) -> str:
    """Returns the unit that a column's name ends in, as `speed_kmh` and "x [m]"; "" where it ends in none."""
    words = words_of(name)
    return UNIT_NAMES.get(words[-1], "") if len(words) > 1 else ""


def key_of(name: str) -> str:
    """Returns a column's name without its unit and with nothing between its words."""
    words = words_of(name)
    return "".join(words[:-1] if unit_in(name) else words)


def columns_named(role: str, names: Sequence[str]) -> list[str]:
    """Returns the columns whose names say that they are this value, the likeliest first."""
    known = NAMES[role].split()
    found = [(known.index(key), place, name) for place, name in enumerate(names) if (key := key_of(name)) in known]
    return [name for _, _, name in sorted(found)]
