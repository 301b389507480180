"""Roads: positions in a plane become positions along a road; lanes and ramps of a site are drafted."""
