"""Portals on this machine that have made-up I-80 traffic."""

import csv
import io
import zipfile

import pytest

from rampcast.download import Patience
from tests.download.local_portal import LocalPortal, serving
from tests.made_up_traffic import random_traffic
from tests.ngsim_writer import write_ngsim_txt, write_portal_csv

SHORT = Patience(connect=1.0, silence=0.3, attempts=3, pause=0.01, longest_pause=0.05)


@pytest.fixture(scope="session")
def traffic():
    return random_traffic(1, vehicles=4, seconds=12.0)


@pytest.fixture(scope="session")
def table(traffic, tmp_path_factory):
    """Returns header and rows as the portal sends them: lower-case names, and every cell in quotes."""
    path = write_portal_csv(traffic, tmp_path_factory.mktemp("portal") / "all.csv")
    text = io.StringIO()
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
        csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="\n").writerows([[n.lower() for n in header], *rows])
    lines = text.getvalue().splitlines()
    return lines[0], lines[1:]


@pytest.fixture(scope="session")
def archive(traffic, tmp_path_factory):
    """Returns an archive as the portal's: the texts lie in an archive in the archive, beside other files."""
    (text,) = write_ngsim_txt(traffic, tmp_path_factory.mktemp("archive"))
    inner, outer = io.BytesIO(), io.BytesIO()
    with zipfile.ZipFile(inner, "w", zipfile.ZIP_DEFLATED) as target:
        target.write(text, f"vehicle-trajectory-data/0400pm-0415pm/{text.name}")
        target.writestr("vehicle-trajectory-data/readme.txt", "about")
    with zipfile.ZipFile(outer, "w") as target:
        target.writestr("I-80/i-80-vehicle-trajectory-data.zip", inner.getvalue())
        target.writestr("I-80/aerial.zip", _empty_archive())
    return outer.getvalue(), text.name, text.read_bytes()


def _empty_archive() -> bytes:
    data = io.BytesIO()
    zipfile.ZipFile(data, "w").close()
    return data.getvalue()


@pytest.fixture
def portal(table, archive, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    with serving(LocalPortal(header=table[0], rows=list(table[1]), file=archive[0])) as found:
        yield found
