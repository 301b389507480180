"""What the data doctor finds in every real recording of the data folder; docs/doctor.md quotes it.

Run: python benchmarks/doctor_real.py [--out FOLDER] [NAME ...]
The files stay where they are; with --out a page of each is written there. Files that are no NGSIM csv are read with the
mapping of their name in docs/mappings.
"""

import argparse
import os
import time
from pathlib import Path

from rampcast.doctor import Finding, RoadDiagnosis, doctor
from rampcast.doctor.page import write_diagnosis
from rampcast.errors import RampcastError
from rampcast.formats import BadRows, read_all

MAPPINGS = Path(__file__).parents[1] / "docs" / "mappings"


def main() -> None:
    """Examines each file and prints a table of the findings of all."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("names", nargs="*", help="files, by the beginning of their names; default: all")
    options.add_argument("--data", type=Path, default=Path(os.environ.get("RAMPCAST_DATA", "../shared/data")))
    options.add_argument("--out", type=Path, help="folder for the pages")
    chosen = options.parse_args()
    found = {}
    for path in sorted((chosen.data / "real").iterdir()):
        if not chosen.names or path.name.startswith(tuple(chosen.names)):
            diagnosis = examined(path, chosen.out)
            if diagnosis is not None:
                found[path.stem] = diagnosis
    show_table(found)


def examined(path: Path, out: Path | None) -> RoadDiagnosis | None:
    """Returns the diagnosis of a file after printing it; None where it is no recording."""
    mapping = MAPPINGS / f"{path.stem}.toml"
    start = time.perf_counter()
    try:
        recordings, report = read_all([path], mapping=mapping if mapping.is_file() else None, bad_rows=BadRows.SKIP)
    except RampcastError as error:
        print(f"\n{path.name}: {error}")
        return None
    read = time.perf_counter() - start
    whole = doctor(recordings, report)
    (diagnosis,) = whole.roads
    seconds = time.perf_counter() - start - read
    verdict = "would spoil a forecast" if diagnosis.spoils else "would not spoil a forecast"
    print(f"\n{path.name}: {diagnosis.rows:,} rows, {diagnosis.vehicles:,} vehicles: {verdict}")
    print(f"  read in {read:.2f} s, examined in {seconds:.2f} s")
    for finding in diagnosis.findings:
        detail = f" ({finding.detail})" if finding.detail else ""
        print(f"  {finding.severity.value}: {finding.check.name} {cell(finding)}{detail}")
        print(f"    e.g. {finding.example()}")
    for one in diagnosis.distributions:
        shares = ", ".join(f"beyond {limit:g}: {share:.2%}" for limit, share in one.beyond.items())
        print(f"  {one.quantity} {one.stage}: {shares}")
    if out is not None:
        write_diagnosis(whole, out / path.stem)
    return diagnosis


def show_table(found: dict[str, RoadDiagnosis]) -> None:
    """Prints one row a finding and one column a file, as Markdown."""
    names = list(dict.fromkeys(finding.check.name for one in found.values() for finding in one.findings))
    print("\n| finding | " + " | ".join(found) + " |")
    print("|---|" + "---:|" * len(found))
    for name in names:
        cells = (cell_of(one, name) for one in found.values())
        print(f"| {name} | " + " | ".join(cells) + " |")


def cell_of(diagnosis: RoadDiagnosis, name: str) -> str:
    """Returns what a diagnosis says of a check: a count, nothing found, or not assessed."""
    finding = diagnosis.finding(name)
    if finding is not None:
        return cell(finding)
    return "n/a" if any(check.name == name for check in diagnosis.unassessed) else "–"


def cell(finding: Finding) -> str:
    """Returns count, what is counted, and share."""
    return f"{finding.count:,} of {finding.of:,} {finding.check.counted} ({finding.share:.2%})"


if __name__ == "__main__":
    main()
