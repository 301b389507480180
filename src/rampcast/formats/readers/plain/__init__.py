"""Plain tables: our own form, or any other with a mapping."""
