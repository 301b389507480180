"""The road network of a site for SUMO: the recorded section, and enough road before and after it.

    approach -> before -> merge -> after -> onward -> slow -> away        main road, every lane
    ramp_approach -> ramp -^                                              one lane, joins `merge` as its rightmost lane

`merge` starts at the gore and ends where the ramp lane stops being full width; `slow` is where the speed sign stands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

from rampcast.errors import SiteError
from rampcast.simulate.programs import program, run_quietly
from rampcast.sites import Site

# The last quarter of the ramp lane is a taper too narrow to drive beside the target lane. On I-80 the lane runs from
# the gore at 118 m to 230 m (the paper) and loses its own number at 202 m (erratum 7): after 75 % of the way.
FULL_WIDTH_SHARE = 0.75
MARGIN = 100.0  # [m] road before and after the section that is simulated with it, so that manoeuvres are whole
APPROACH = 500.0  # [m] from the source to the section: room for the queue
RAMP_APPROACH = 300.0  # [m]
SIGN_FROM, SIGN_TO, SINK = 250.0, 400.0, 600.0  # [m] after the section; the sign is about 750 m from its start on I-80
RAMP_SPEED = 16.0  # [m/s] 35 mph, a usual advisory speed on a ramp


@dataclass(frozen=True)
class Road:
    """A stretch of road between two longitudinal positions [m]."""

    name: str
    start: float
    end: float
    lanes: int


def full_width_end(site: Site) -> float:
    """Returns where the ramp lane becomes a taper: the last place where a vehicle can stand in it [m]."""
    return site.gore + FULL_WIDTH_SHARE * (site.ramp_end - site.gore)


def main_lanes(site: Site) -> list[int]:
    """Returns the numbers of the main lanes from left to right.

    Raises:
        SiteError: the target lane is not the rightmost of them, so that no lane can join from the right, or the ramp
            lane goes on.
    """
    if site.ramp_goes_on:
        raise SiteError(
            f"site '{site.name}': a simulation needs a ramp lane that ends in the section; length is "
            f"{site.length:g} m, ramp_end {site.ramp_end:g} m"
        )
    numbers = sorted(lane.number for lane in site.lanes if lane.role == "main")
    if numbers[-1] != site.target_lane:
        raise SiteError(
            f"site '{site.name}': a simulation needs the target lane to be the rightmost main lane; target_lane is "
            f"{site.target_lane}, the main lanes are {numbers}"
        )
    return numbers


def roads(site: Site) -> list[Road]:
    """Returns the stretches of the main road, in driving order."""
    n = len(main_lanes(site))
    end = full_width_end(site)
    return [
        Road("approach", -MARGIN - APPROACH, -MARGIN, n),
        Road("before", -MARGIN, site.gore, n),
        Road("merge", site.gore, end, n + 1),
        Road("after", end, site.length + MARGIN, n),
        Road("onward", site.length + MARGIN, site.length + SIGN_FROM, n),
        Road("slow", site.length + SIGN_FROM, site.length + SIGN_TO, n),
        Road("away", site.length + SIGN_TO, site.length + SINK, n),
    ]


def ramp_roads(site: Site) -> list[Road]:
    """Returns the stretches of the ramp before the gore, in driving order."""
    return [
        Road("ramp_approach", -MARGIN - RAMP_APPROACH, -MARGIN, 1),
        Road("ramp", -MARGIN, site.gore, 1),
    ]


def write_network(site: Site, folder: Path) -> Path:
    """Writes the site's network into a folder with SUMO's netconvert and returns its path."""
    return write_files({"nodes": _nodes(site), "edges": _edges(site), "connections": _connections(site)}, folder)


def write_files(files: Mapping[str, Sequence[str]], folder: Path) -> Path:
    """Writes nodes, edges and connections into a folder, and the network that SUMO's netconvert makes of them.

    Args:
        files: elements of "nodes", "edges" and "connections".
        folder: for all files.
    """
    for name, items in files.items():
        (folder / f"{name}.xml").write_text(f"<{name}>\n" + "\n".join(items) + f"\n</{name}>\n", encoding="utf-8")
    network = folder / "network.xml"
    command = [program("netconvert"), "--no-internal-links", "--no-turnarounds", "--output-file", network]
    command += ["-n", folder / "nodes.xml", "-e", folder / "edges.xml", "-x", folder / "connections.xml"]
    run_quietly(command)
    return network


def element(tag: str, **attributes: object) -> str:
    """Returns an empty element of XML."""
    return f"<{tag} " + " ".join(f"{name}={quoteattr(str(value))}" for name, value in attributes.items()) + "/>"


def _nodes(site: Site) -> list[str]:
    main, ramp = roads(site), ramp_roads(site)
    nodes = [element("node", id=f"start_{road.name}", x=road.start, y=0) for road in main]
    nodes.append(element("node", id="sink", x=main[-1].end, y=0))
    # SUMO only needs the ramp to come from the right; positions along it are set by the length of its edges.
    nodes += [element("node", id=f"start_{road.name}", x=road.start, y=0.3 * (road.start - site.gore)) for road in ramp]
    return nodes


def _edges(site: Site) -> list[str]:
    main, ramp = roads(site), ramp_roads(site)
    ends = [f"start_{road.name}" for road in main[1:]] + ["sink"]
    ramp_ends = [f"start_{ramp[1].name}", "start_merge"]
    stretches = [(road, end, site.speed_limit) for road, end in zip(main, ends, strict=True)]
    stretches += [(road, end, RAMP_SPEED) for road, end in zip(ramp, ramp_ends, strict=True)]
    edges = []
    for road, end, speed in stretches:
        values = {"from": f"start_{road.name}", "to": end, "numLanes": road.lanes, "length": road.end - road.start}
        edges.append(element("edge", id=road.name, speed=speed, priority=2 if road in main else 1, **values))
    return edges


def _connections(site: Site) -> list[str]:
    n = len(main_lanes(site))
    joints = [("before", "merge", k, k + 1) for k in range(n)] + [("merge", "after", k + 1, k) for k in range(n)]
    joints.append(("ramp", "merge", 0, 0))
    return [element("connection", **{"from": a, "to": b, "fromLane": i, "toLane": k}) for a, b, i, k in joints]
