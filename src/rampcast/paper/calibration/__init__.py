"""Car-following laws fitted to the history of a driver."""
