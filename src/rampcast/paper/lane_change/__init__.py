"""The paper's 32 lane-change forests."""
