"""The engine for tables, csv or parquet: read in chunks, bad rows named."""
