"""Sites: the geometry of a road, its lanes and its ramp, kept as toml."""

from rampcast.sites.site import Lane, Note, Site, Window, load_site, site_names, site_of, write_site

__all__ = ["Lane", "Note", "Site", "Window", "load_site", "site_names", "site_of", "write_site"]
