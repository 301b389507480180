"""highD and exiD."""
