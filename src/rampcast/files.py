"""Output files that are written whole or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import polars as pl


@contextmanager
def write_whole(path: Path) -> Iterator[Path]:
    """Gives a path beside `path` to write a file to, and renames it to `path` when all went well."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def write_whole_folder(path: Path) -> Iterator[Path]:
    """Gives a folder beside `path` to fill, and puts it in the place of `path` when all went well."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir()
    try:
        yield partial
        old = path.with_name(f".{path.name}.{os.getpid()}.old")
        if path.exists():
            os.replace(path, old)
        os.replace(partial, path)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_table(table: pl.DataFrame, stem: Path, *, csv: bool = False) -> list[Path]:
    """Writes a table as parquet, and as csv if asked, to the path without its suffix; returns what it wrote."""
    paths = [stem.with_name(f"{stem.name}.parquet")]
    with write_whole(paths[0]) as partial:
        table.write_parquet(partial)
    if csv:
        paths.append(stem.with_name(f"{stem.name}.csv"))
        with write_whole(paths[1]) as partial:
            table.write_csv(partial)
    return paths
