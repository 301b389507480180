"""NGSIM's freeway recordings."""
