"""What files are made of: bytes, archives, heads, xml and json."""
