"""Figures, tables and the html report of the protocol."""
