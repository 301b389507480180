"""Metrics as plain functions: arrays in, a tidy table out; used by the paper's protocol and the benchmark alike."""
