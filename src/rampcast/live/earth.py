"""From degrees on the earth to a road and back: the plane of a site touches the earth at its origin."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from rampcast.roads.reference import ReferenceLine, along_road, in_plane, reference_line
from rampcast.sites import Site

EQUATOR: Final = 6_378_137.0  # [m] WGS 84, semi-major axis
SQUARED_ECCENTRICITY: Final = 6.69437999014e-3  # WGS 84


@dataclass(frozen=True)
class Earth:
    """Where a site lies: its plane's x points east and its y north, from an origin.

    At 5 km from the origin such a plane is wrong by some metres in the corners, at 1 km by centimetres.

    Attributes:
        site: its geometry.
        lat, lon: of the origin of its plane [degrees].
    """

    site: Site
    lat: float
    lon: float

    def plane(self, lat: float, lon: float) -> tuple[float, float]:
        """Returns the place in the plane [m] of one on the earth [degrees]."""
        east, north = self._radii
        return east * float(np.radians(lon - self.lon)), north * float(np.radians(lat - self.lat))

    def of_plane(self, px: float, py: float) -> tuple[float, float]:
        """Returns x along the road and y to its left of a place in the plane [m]."""
        x, y = self._on_road(np.array([px]), np.array([py]))
        return float(x[0]), float(y[0])

    def on_road(self, lat: np.ndarray, lon: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns x along the road and y to its left [m] of places on the earth [degrees]."""
        east, north = self._radii
        return self._on_road(east * np.radians(lon - self.lon), north * np.radians(lat - self.lat))

    def of_road(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns latitude and longitude [degrees] of places on the road [m]."""
        px, py = plane_of_road(self.site, x, y)
        east, north = self._radii
        return self.lat + np.degrees(py / north), self.lon + np.degrees(px / east)

    @cached_property
    def _line(self) -> ReferenceLine | None:
        return reference_line(np.asarray(self.site.reference)) if self.site.reference else None

    @cached_property
    def _radii(self) -> tuple[float, float]:
        """Returns metres to a radian of longitude, and of latitude, at the origin."""
        sine = np.sin(np.radians(self.lat))
        bent = 1.0 - SQUARED_ECCENTRICITY * sine**2
        east = EQUATOR / np.sqrt(bent) * np.cos(np.radians(self.lat))
        return float(east), float(EQUATOR * (1.0 - SQUARED_ECCENTRICITY) / bent**1.5)

    def _on_road(self, px: np.ndarray, py: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y = along_road(self._line, px, py) if self._line is not None else (px, py)
        return x, -y if self.site.mirrored else y


def plane_of_road(site: Site, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the places in the site's plane [m] of places on the road [m]."""
    y = -y if site.mirrored else y
    return in_plane(reference_line(np.asarray(site.reference)), x, y) if site.reference else (x, y)
