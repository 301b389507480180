"""The open benchmark: fixed cases of real and simulated traffic, baselines, the floor, and metrics."""

from rampcast.benchmark.cases import Cases
from rampcast.benchmark.data_sets import DATA_SETS, DataSet
from rampcast.benchmark.forecasting import forecast_cases, forecast_merges
from rampcast.benchmark.merge_tables import merge_case_table, merge_score_table
from rampcast.benchmark.merges import MergeForecasts
from rampcast.benchmark.models import Forecasts, Training
from rampcast.benchmark.place_tables import case_table, score_table
from rampcast.benchmark.run import (
    Benchmark,
    benchmark,
    default_folder,
    run_benchmark,
    write_benchmark,
)
from rampcast.benchmark.splits import Split, folds, split

__all__ = [
    "DATA_SETS",
    "Benchmark",
    "Cases",
    "DataSet",
    "Forecasts",
    "MergeForecasts",
    "Split",
    "Training",
    "benchmark",
    "case_table",
    "default_folder",
    "folds",
    "forecast_cases",
    "forecast_merges",
    "merge_case_table",
    "merge_score_table",
    "run_benchmark",
    "score_table",
    "split",
    "write_benchmark",
]
