"""What `print` shows of a diagnosis and of a summary is readable."""

from rampcast.doctor import doctor, inspect
from tests.made_up_traffic import random_traffic


def test_a_diagnosis_prints_each_finding_with_its_advice_and_ends_with_the_verdict():
    found = doctor(random_traffic(7, vehicles=12, seconds=20.0, name="i80-1"))
    lines = str(found).splitlines()
    assert lines[0].endswith(" rows")
    assert len(lines) == len(found.findings) + 2
    assert all(one.check.title in line for one, line in zip(found.findings, lines[1:], strict=False))
    assert lines[-1] == ("this would spoil a forecast" if found.spoils else "nothing here would spoil a forecast")


def test_a_summary_prints_a_line_for_each_number():
    summary = inspect(random_traffic(7, vehicles=12, seconds=20.0, name="i80-1"))
    shown = str(summary)
    assert shown.startswith("Summary of i80: ")
    assert f"{summary.total['rows']:,}" in shown
    assert len(shown.splitlines()) > 5
