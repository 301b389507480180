"""One file a format, a folder where it takes several."""
