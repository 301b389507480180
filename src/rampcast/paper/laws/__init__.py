"""Car-following laws, and the two readings of the paper."""
