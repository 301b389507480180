"""What came of a batch, as tables: a row for each part, file, site, finding, kind of conflict and second ahead."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl

from rampcast.batch.task import Record
from rampcast.files import write_whole

ALL: Final = "all"  # in the place of a site's name
SHOWN: Final = (5.0, 15.0)  # [s] ahead, of scores and conflicts in the table of sites
PART: Final = {
    "file": pl.String(),
    "site": pl.String(),
    "day": pl.String(),
    "part": pl.Int64(),
    "begin": pl.Float64(),
    "end": pl.Float64(),
    "error": pl.String(),
    "vehicles": pl.Int64(),
    "rows": pl.Int64(),
    "spoils": pl.Boolean(),
    "findings": pl.Int64(),
    "simulated": pl.Boolean(),
    "seconds": pl.Float64(),
    "cpu_seconds": pl.Float64(),
    "process": pl.Int64(),
    "peak_mb": pl.Float64(),
}
FINDING: Final = {
    **dict.fromkeys(("file", "site", "day"), pl.String()),
    "part": pl.Int64(),
    **dict.fromkeys(("severity", "name", "title"), pl.String()),
    **dict.fromkeys(("count", "of"), pl.Int64()),
}
MEANS: Final = ("within_5", "within_10", "mean_error", "bias", "crps", "inside_50", "inside_90", "width_90")


@dataclass(frozen=True)
class Done:
    """What came of a batch.

    Attributes:
        tables: by name; see docs/batch.md.
        files: that were written last.
    """

    tables: Mapping[str, pl.DataFrame]
    files: tuple[Path, ...]

    @property
    def summary(self) -> pl.DataFrame:
        """Returns a row for each road of each file, and for each file that failed, with the reason."""
        return self.tables["summary"]

    @property
    def scores(self) -> pl.DataFrame:
        """Returns errors by file and horizon; empty if nothing was evaluated."""
        return self.tables["scores"]

    @property
    def failed(self) -> pl.DataFrame:
        """Returns the rows of files that failed, or parts of which did."""
        return self.summary.filter(pl.col("error").is_not_null())


def written_tables(files: Sequence[Record], parts: Sequence[Record], out: Path) -> Done:
    """Returns all tables of a batch, and writes them into its folder as parquet and csv.

    Args:
        files: records of the files.
        parts: records of their parts.
        out: the folder.
    """
    tables = tables_of(files, parts, out)
    written = []
    for name, table in tables.items():
        for suffix, write in ((".parquet", table.write_parquet), (".csv", table.write_csv)):
            with write_whole(out / f"{name}{suffix}") as path:
                write(path)
            written.append(out / f"{name}{suffix}")
    return Done(tables, tuple(written))


def tables_of(files: Sequence[Record], parts: Sequence[Record], out: Path) -> dict[str, pl.DataFrame]:
    """Returns all tables of a batch by name; see `written_tables`."""
    each = parts_table([*files, *parts])
    scores = pooled(_kept("scores", [*files, *parts], out), ["file", "site", "day", "model", "horizon"], MEANS)
    conflicts = _kept("conflicts", [*files, *parts], out)
    found = findings_table([*files, *parts])
    of_sites = _with_all(scores, "site")
    counts = _with_all(conflicts, "site").group_by("site", "measure", "t").agg(pl.col("n", "expected", "likely").sum())
    tables = {
        "summary": summary_table(files, each),
        "parts": each,
        "findings": found,
        "scores": scores,
        "site_scores": pooled(of_sites, ["site", "model", "horizon"], MEANS),
        "site_conflicts": counts.sort("site", "measure", "t"),
    }
    return tables | {"sites": sites_table(tables)}


def parts_table(records: Sequence[Record]) -> pl.DataFrame:
    """Returns a row for each part, or road of a file that is one task, and for each task that failed."""
    rows = []
    for record in records:
        about = {name: record[name] for name in PART if name in record}
        rows += [about | {name: road[name] for name in PART if name in road} for road in record["roads"]]
        rows += [about] if record["error"] else []
    return pl.DataFrame(rows, schema=PART).sort("file", "part", maintain_order=True)


def findings_table(records: Sequence[Record]) -> pl.DataFrame:
    """Returns a row for each finding of the doctor; of a file as a whole the site is null."""
    rows = []
    for record in records:
        about = {"file": record["file"]}
        rows += [one | about for one in record.get("found", ())]
        for road in record["roads"]:
            more = about | {"site": road["site"], "day": road["day"], "part": record.get("part")}
            rows += [one | more for one in road["found"]]
    return pl.DataFrame(rows, schema=FINDING)


def summary_table(files: Sequence[Record], parts: pl.DataFrame) -> pl.DataFrame:
    """Returns a row for each road of each file, and for each file that failed, with the reason of the first failure.

    Vehicles and rows are those of the file: one that is in two parts is one.
    """
    seen = [
        {"file": record["file"], "site": source["site"]}
        | {name: sum(one[name] for one in source["windows"]) for name in ("vehicles", "rows")}
        for record in files
        for source in record["sources"]
    ]
    kinds = {name: PART[name] for name in ("file", "site", "vehicles", "rows")}
    whole = pl.DataFrame(seen, schema=kinds).unique(["file", "site"], keep="first", maintain_order=True)
    named = pl.format("part {}: {}", pl.col("part"), pl.col("error"))
    error = pl.when(pl.col("part").is_null()).then("error").otherwise(named)
    order = {record["file"]: number for number, record in enumerate(files)}
    found = parts.with_columns(error=error).join(whole, on=["file", "site"], how="left", suffix="_whole")
    return (
        found.group_by("file", "site", maintain_order=True)
        .agg(
            pl.col("error").drop_nulls().first(),
            pl.col("day").min(),
            pl.coalesce(pl.col("vehicles_whole").first(), pl.col("vehicles").sum()).alias("vehicles"),
            pl.coalesce(pl.col("rows_whole").first(), pl.col("rows").sum()).alias("rows"),
            pl.col("spoils").any(),
            pl.col("findings").sum(),
            pl.len().alias("parts"),
            pl.col("error").count().alias("failed"),
            pl.col("peak_mb").max(),
        )
        .sort(pl.col("file").replace_strict(order, return_dtype=pl.Int64), maintain_order=True)
    )  # fmt: skip


def sites_table(tables: Mapping[str, pl.DataFrame]) -> pl.DataFrame:
    """Returns a row for each site: how much there is of it, how good it is, how well and what was forecast."""
    each = tables["parts"].filter(pl.col("site").is_not_null())
    found = each.group_by("site").agg(
        pl.col("simulated").any(),
        pl.col("file").n_unique().alias("files"),
        pl.col("day").drop_nulls().n_unique().alias("days"),
        pl.len().alias("parts"),
        pl.col("error").count().alias("parts_failed"),
        pl.col("spoils").sum().alias("parts_spoilt"),
        ((pl.col("end") - pl.col("begin")).sum() / 3600).alias("hours"),
        pl.col("rows").sum(),
        pl.col("peak_mb").max(),
    )
    of_files = tables["summary"].group_by("site").agg(pl.col("vehicles").sum())
    found = found.join(of_files, on="site", how="left")
    for horizon in SHOWN:
        for more in (_scores_at(tables["site_scores"], horizon), _conflicts_by(tables["site_conflicts"], horizon)):
            found = found.join(more, on="site", how="left")
    return found.sort("site")


def _scores_at(scores: pl.DataFrame, horizon: float) -> pl.DataFrame:
    """Returns n, the mean error and the share in the 90 % band of each site's first model so far ahead."""
    at = scores.filter((pl.col("horizon") - horizon).abs() < 0.01).unique("site", keep="first", maintain_order=True)
    return at.select("site", *(pl.col(name).alias(f"{name}_{horizon:g}") for name in ("n", "mean_error", "inside_90")))


def _conflicts_by(conflicts: pl.DataFrame, t: float) -> pl.DataFrame:
    """Returns, for each site, the share of forecasts in which each measure falls short by then."""
    at = conflicts.filter((pl.col("t") - t).abs() < 0.01)
    shares = []
    for name in ("ttc", "drac"):
        expected, n = (pl.col(column).filter(pl.col("measure") == name).sum() for column in ("expected", "n"))
        shares.append(pl.when(n > 0).then(expected / n).alias(f"{name}_{t:g}"))
    return at.group_by("site").agg(shares)


def pooled(table: pl.DataFrame, by: list[str], means: Sequence[str]) -> pl.DataFrame:
    """Returns the means of groups of parts, each part with the weight of its n; null where a part has none."""
    n = pl.col("n")
    named = [
        pl.when(pl.col(name).null_count() < pl.len())
        .then((pl.col(name) * n).sum() / n.filter(pl.col(name).is_not_null()).sum())
        .alias(name)
        for name in means
    ]
    return table.group_by(by).agg(n.sum(), *named).sort(by)


def _with_all(table: pl.DataFrame, key: str) -> pl.DataFrame:
    return pl.concat([table, table.with_columns(pl.lit(ALL).alias(key))])


def _kept(name: str, records: Sequence[Record], out: Path) -> pl.DataFrame:
    """Returns the small tables of a name that tasks have written, with where each is from."""
    found: list[pl.DataFrame] = []
    for record in records:
        for road in record["roads"]:
            for path in (one for one in road["files"] if one.startswith(f"{name}/")):
                about: dict[str, Any] = {"file": record["file"], "site": road["site"], "day": road["day"]}
                table = pl.read_parquet(out / path, hive_partitioning=False)
                found.append(table.select(*(pl.lit(value).alias(key) for key, value in about.items()), pl.all()))
    return pl.concat(found) if found else pl.DataFrame(schema=EMPTY[name])


KEYS: Final = dict.fromkeys(("file", "site", "day"), pl.String())
SCORED: Final = {"model": pl.String(), "horizon": pl.Float64(), "n": pl.UInt32()}
COUNTED: Final = {"measure": pl.String(), "t": pl.Float64(), "n": pl.UInt32()}
EMPTY: Final = {
    "scores": KEYS | SCORED | dict.fromkeys(MEANS, pl.Float64()),
    "conflicts": KEYS | COUNTED | {"expected": pl.Float64(), "likely": pl.UInt32()},
}
