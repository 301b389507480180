"""I-24 MOTION, version 1 and the derivative with lanes."""
