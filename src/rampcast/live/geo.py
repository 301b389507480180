"""A site as GeoJSON: its lanes as lines, its ramp's places as points, on the earth or in the site's plane."""

import math
from typing import Any, Final

import numpy as np

from rampcast.live.earth import Earth, plane_of_road
from rampcast.sites import Site
from rampcast.sites.site import LANE_WIDTH, NO_LANE

SPACING: Final = 10.0  # [m] between the points of a line on a road that bends


def site_geojson(name: str, site: Site, earth: Earth | None) -> dict[str, Any]:
    """Returns a site as a FeatureCollection, with all that a page needs to draw it along the road as well.

    Args:
        name: id of the site.
        site: its geometry.
        earth: where it lies; None gives coordinates in the site's plane [m], and `rampcast.coordinates` says so.
    """
    end = min(site.ramp_end, site.length) if site.has_ramp else site.length
    features = [_lane(site, earth, lane.number, end) for lane in site.lanes]
    if site.has_ramp:
        y = site.lane_centre(site.ramp_lanes[0])
        features += [_point(site, earth, "gore", site.gore, y)]
        features += [_point(site, earth, "ramp_end", site.ramp_end, y)] if not site.ramp_goes_on else []
        line = [(float(x), float(y)) for x, y in site.lane_line]
        features += [_feature(site, earth, "LineString", line, {"what": "lane_line"})]
    return {
        "type": "FeatureCollection",
        "rampcast": {
            "id": name,
            "name": site.name,
            "title": site.title,
            "simulated": site.simulated,
            "coordinates": "wgs84" if earth else "plane",
            "length": site.length,
            "speed_limit": site.speed_limit,
            "gore": finite(site.gore),
            "ramp_end": finite(site.ramp_end),
            "merge_zone": [finite(one) for one in site.merge_zone],
            "target_lane": site.target_lane if site.target_lane != NO_LANE else None,
            "ramp_lanes": list(site.ramp_lanes),
            "lane_line": [list(point) for point in site.lane_line],
            "lanes": [
                {"number": lane.number, "role": lane.role, "centre": lane.centre, "width": _width(site, lane.centre)}
                for lane in site.lanes
            ],
        },
        "features": features,
    }


def finite(value: float) -> float | None:
    """Returns a number, or None for one that JSON cannot hold."""
    return value if math.isfinite(value) else None


def _width(site: Site, centre: float) -> float:
    """Returns how far apart the lanes are there [m]."""
    apart = [abs(centre - lane.centre) for lane in site.lanes if lane.centre != centre]
    return round(min([one for one in apart if one > 1.0], default=LANE_WIDTH), 2)


def _lane(site: Site, earth: Earth | None, number: int, end: float) -> dict[str, Any]:
    lane = next(one for one in site.lanes if one.number == number)
    last = end if lane.role == "ramp" else site.length
    count = max(math.ceil(last / SPACING), 1) if site.reference else 1
    line = [(float(x), lane.centre) for x in np.linspace(0.0, last, count + 1)]
    properties = {"what": "lane", "number": number, "role": lane.role, "width": _width(site, lane.centre)}
    return _feature(site, earth, "LineString", line, properties)


def _point(site: Site, earth: Earth | None, what: str, x: float, y: float) -> dict[str, Any]:
    made = _feature(site, earth, "LineString", [(x, y)], {"what": what, "x": x})
    return made | {"geometry": {"type": "Point", "coordinates": made["geometry"]["coordinates"][0]}}


def _feature(
    site: Site, earth: Earth | None, kind: str, road: list[tuple[float, float]], properties: dict[str, Any]
) -> dict[str, Any]:
    x, y = np.array(road, dtype=np.float64).T
    if earth is not None:
        lat, lon = earth.of_road(x, y)
        places = np.round(np.stack([lon, lat], axis=1), 8)
    else:
        places = np.round(np.stack(plane_of_road(site, x, y), axis=1), 3)
    geometry = {"type": kind, "coordinates": places.tolist()}
    return {"type": "Feature", "geometry": geometry, "properties": properties | {"road": [list(one) for one in road]}}
