"""docs/doctor.md lists every check as the code has it."""

import importlib.util
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def test_the_table_of_checks_is_what_its_script_makes():
    spec = importlib.util.spec_from_file_location("doctor_page", DOCS / "scripts" / "doctor_page.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    page = (DOCS / "doctor.md").read_text(encoding="utf-8")
    assert page == script.with_table(page), "run: python docs/scripts/doctor_page.py"
