"""One list of formats, to which packages of others add theirs by an entry point."""

import sys
from pathlib import Path

import pytest

from rampcast.errors import FormatError
from rampcast.formats import FORMATS, all_formats, read_any

MODULE = """
from dataclasses import replace
from rampcast.formats import Format, Needs
from rampcast.formats.files.head import Head
from rampcast.formats.registry import FORMATS

def misses(head):
    return None if head.text.startswith(b"# ours") else "no line '# ours'"

def read(heads, site, bad_rows):
    tables = [head.path.with_suffix(".csv") for head in heads]
    for head, table in zip(heads, tables, strict=True):
        table.write_bytes(head.text.partition(b"\\n")[2])
    from rampcast.formats import read_all
    return read_all(tables, site=site, bad_rows=bad_rows)

OURS = Format("ours", "A format of ours", ".our", read, Needs(misses), url="https://example.org/ours")
NOT_A_FORMAT = "ours"
"""
TABLE = "vehicle,time,x,y,lane\n" + "".join(f"{v},{t / 10},{30 * v + t},-2,1\n" for v in (1, 2) for t in range(20))


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Returns a function that puts a package with entry points, as pip would leave it, on the path."""

    def installed(*points: str) -> None:
        folder = tmp_path / "site"
        about = folder / "our_traffic-1.2.dist-info"
        about.mkdir(parents=True)
        (folder / "our_traffic.py").write_text(MODULE)
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: our-traffic\nVersion: 1.2\n")
        (about / "entry_points.txt").write_text("[rampcast.formats]\n" + "\n".join(points) + "\n")
        monkeypatch.syspath_prepend(str(folder))
        monkeypatch.delitem(sys.modules, "our_traffic", raising=False)

    return installed


def ours(folder: Path) -> Path:
    path = folder / "t.our"
    path.write_text("# ours\n" + TABLE)
    return path


def test_a_package_of_others_adds_a_format_that_is_told_by_content_and_by_name(install, tmp_path):
    with pytest.raises(FormatError, match="in none of the formats"):
        read_any(ours(tmp_path))
    install("ours = our_traffic:OURS")
    by_content, _ = read_any(ours(tmp_path))
    by_name, _ = read_any(ours(tmp_path), format="ours")
    assert by_content.tracks.equals(by_name.tracks)
    assert by_name.tracks.height == 40
    added = list(all_formats())[len(FORMATS) :]
    assert [(one.name, one.page) for one in added] == [("ours", "https://example.org/ours")]


BROKEN = {
    "no such module": ("broken = our_trafic:OURS", r"cannot be loaded: ModuleNotFoundError.*our_trafic"),
    "no such object": ("broken = our_traffic:OUR", r"cannot be loaded: AttributeError"),
    "no format": ("broken = our_traffic:NOT_A_FORMAT", r"is no Format of that name, but 'ours'"),
    "another's name": ("broken = our_traffic:OURS", r"is no Format of that name, but Format\(name='ours'"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_package_is_named_and_left_out_where_its_format_is_not_asked_for(what, install, tmp_path):
    point, message = BROKEN[what]
    install(point, "ours = our_traffic:OURS")
    named = rf"the format 'broken' of the package our-traffic 1.2 \(our_traf.*{message}.*Mend or update the package"
    with pytest.raises(FormatError, match=named):
        read_any(ours(tmp_path), format="broken")
    with pytest.warns(UserWarning, match=named):
        recording, _ = read_any(ours(tmp_path))
    assert recording.tracks.height == 40
    table = tmp_path / "plain.csv"
    table.write_text(TABLE)
    assert read_any(table)[0].tracks.height == 40  # a file of rampcast's own formats asks no package


def test_no_package_can_replace_a_format_of_rampcast(install, tmp_path):
    install("plain = our_traffic:OURS")
    assert [one.name for one in all_formats()] == list(FORMATS)


def test_a_format_that_is_not_known_gets_a_hint_of_what_is_meant(install, tmp_path):
    install("ours = our_traffic:OURS")
    with pytest.raises(FormatError, match=r"no format 'our'; is 'ours' meant\? Known formats: rampcast, .*ours"):
        read_any(ours(tmp_path), format="our")
