"""The rows of the report's tables."""

import polars as pl
import pytest

from rampcast.paper.report.claims import claims_table
from rampcast.paper.report.tables import error_table, lane_change_table, number_text, outcome_table, parameter_table
from tests.plots import tidy_tables


def _cells(table: object, name: str) -> tuple[str, ...]:
    return next(row for row in table.rows if name in row)  # type: ignore[attr-defined]


def test_a_number_is_text_with_a_true_minus_and_a_dash_for_nothing() -> None:
    assert [number_text(value) for value in (-1.234, 1234.5, None, float("nan"), 3e9)] == [
        "−1.23",
        "1,234.50",
        "–",
        "–",
        "3.00e+09",
    ]


def test_a_parameter_row_has_name_unit_range_and_the_values_of_each_mode() -> None:
    table = parameter_table(tidy_tables.parameters(), law="idm", number="2")
    assert table.rows[0] == ("s 0 [m]", "−5.0 to 5.0", *("1.50", "1.00", "0.70") * 2)
    assert table.rows[-2][:2] == ("mean squared error [m²/s⁴]", "–")
    assert table.rows[-1][0].startswith("the same, without drivers with a leader abreast")
    assert "Paper mode: n = 258; of 7 the actual leader was abreast in the history." in table.caption


def test_the_error_table_marks_the_best_of_each_column() -> None:
    table = error_table(tidy_tables.longitudinal(), number="A4")
    rows = [i for i, row in enumerate(table.rows) if row[:2] == ("central", "mean error [m]")]
    last = len(table.rows[0]) - 1
    best = [table.rows[i][2] for i in rows if (i, last) in table.strong]
    assert best == ["rampcast"]
    paper = [table.rows[i][2] for i in rows if (i, last - 6) in table.strong]
    assert paper == ["Gipps (1981)"]


def test_the_outcomes_are_counts_with_shares() -> None:
    assert _cells(outcome_table(tidy_tables.outcomes(), number="A3"), "GHR")[1] == "180 (70 %)"


def test_the_lane_change_table_begins_with_paper_mode_and_within() -> None:
    table = lane_change_table(tidy_tables.lane_change(), number="A5")
    assert table.rows[0][:7] == ("paper mode", "label", "balanced", "within 1", "forests", "240", "120")
    assert table.rows[6][3] == "at 1"


def test_the_models_stand_one_below_the_other_in_the_lane_change_table() -> None:
    table = lane_change_table(tidy_tables.lane_change(), number="A5")
    corrected = [row for row in table.rows if row[0] == "corrected mode"]
    assert [row[3:5] for row in corrected[:3]] == [
        ("within 1", "rampcast"),
        ("within 1", "forests"),
        ("within 3", "rampcast"),
    ]
    assert table.head[0][-1] == ("Brier skill [%]", 1)


@pytest.mark.parametrize("table", [error_table, outcome_table, lane_change_table])
def test_a_table_without_its_source_says_so(table: object) -> None:
    assert "there is no table" in table(None, number="A9").missing  # type: ignore[operator]


def test_a_statement_of_the_paper_is_measured_on_the_tables() -> None:
    table = claims_table(tidy_tables.tables(), number="A1")
    within_5 = _cells(table, "GHR lies within 5 m in more than 90 % of the cases until")
    ghr = tidy_tables.longitudinal().filter(
        pl.col("model") == "ghr", pl.col("mode") == "paper", pl.col("within_5") > 0.9
    )
    assert within_5[1:3] == ("5 s", f"{ghr['horizon'].max():.0f} s")
    assert _cells(table, "Highest mean error after 9 s")[2] == "GHR"
    assert _cells(table, "Importance by vehicle")[2] == "target > central > ramp"
    assert _cells(table, "Smaller mean error than the LSTM alone")[2].startswith("IDM 15 of 15 s")
    on_the_ramp = _cells(table, "More within 5 m than the LSTM has of its ramp neighbours")[2]
    assert on_the_ramp == "IDM 15 of 15 s, Gipps (paper) 15 of 15 s, GHR 0 of 15 s"
    assert _cells(table, "Ramp neighbours predicted a little better than target-lane neighbours")[2] == "at 15 of 15 s"
    assert _cells(table, "Cumulative accuracy falls with t, then rises")[2] == "lowest at 8 s"


def test_an_accuracy_that_only_falls_is_told() -> None:
    lane_change = tidy_tables.lane_change().with_columns(accuracy=1.0 - 0.01 * pl.col("t"))
    table = claims_table({"lane_change": lane_change}, number="A1")
    assert _cells(table, "Cumulative accuracy falls with t, then rises")[2] == "lowest at 15 s: it only falls"


def test_statements_without_tables_are_dashes() -> None:
    few = {"outcomes": tidy_tables.outcomes()}
    assert {cell for row in claims_table(few, number="A1").rows for cell in row[2:]} == {"–"}
