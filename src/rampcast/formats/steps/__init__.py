"""Steps that several readers share: units, clock, motion, vehicles."""
