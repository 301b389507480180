"""Commands about data: reading, checking, sites, downloads, simulation."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.options import (
    Files,
    Gore,
    MergeZone,
    Mirrored,
    OutFile,
    OutFolder,
    RampEnd,
    Seed,
    SiteFile,
    TargetLane,
    writable_file,
    writable_folder,
)
from rampcast.cli.ramp import site_with_ramp
from rampcast.cli.reading import (
    Reading,
    doubtful_of,
    read_road,
    read_roads,
    reads_files,
    taken_for,
    user_command,
    warn_if_off_road,
)
from rampcast.errors import SiteError

if TYPE_CHECKING:
    from rampcast.recording import Recording

SHORTEST_RAMP = 30.0  # [m] beside the target lane: less than two seconds at the speed of those that merge


@app.command(
    epilog="Examples:\n\nrampcast inspect trajectories-0400-0415.txt\n\nrampcast inspect i80.parquet --json > i80.json"
)
@reads_files("accept_doubtful")
def inspect(
    files: Files,
    reading: Reading = Reading(),
    json: Annotated[
        bool, typer.Option("--json", help="Print json instead of tables; of several roads: qualities.")
    ] = False,
) -> None:
    """Prints what is in a recording and how good it is, road by road."""
    from rampcast.doctor import inspect as summary_of

    if reading.mapping is None and reading.format is None:
        terminal.note(taken_for(files))
    with terminal.progress("read and check"):
        recordings, report = read_roads(files, reading)
        found = [summary_of(recording) for recording in recordings]
    if json:
        values = [one.to_dict() for one in found]
        roads = {"quality": values[0]} if len(values) == 1 else {"qualities": values}
        terminal.print_json({"reading": report.to_dict(), **roads})
        return
    terminal.print_reading(report)
    for one in found:
        terminal.print_summary(one)


@app.command(
    epilog="Examples:\n\nrampcast convert trajectories-*.txt --site i80 --out i80.parquet\n\n"
    "rampcast convert table.csv --mapping table.toml --out table.parquet"
)
@reads_files()
def convert(
    files: Files,
    out: OutFile,
    reading: Reading = Reading(),
) -> None:
    """Reads recordings of one place and writes a parquet file of each road (several: x-ROAD.parquet for x.parquet)."""
    from rampcast.formats import convert_all

    with terminal.progress(f"convert to {out}"):
        written, report = convert_all(files, out, **reading.arguments, doubtful=doubtful_of(reading.accept_doubtful))
    terminal.print_reading(report)
    warn_if_off_road(report, reading.site)
    terminal.print_written(written)
    for breach in report.breaches:
        terminal.warn(str(breach))


@app.command(epilog="Example:\n\nrampcast formats --json")
def formats(json: Annotated[bool, typer.Option("--json", help="Print json instead of a table.")] = False) -> None:
    """Lists the formats that rampcast reads."""
    from rampcast.formats import all_formats

    if json:
        entries = all_formats()
        known = [{"name": one.name, "title": one.title, "reads": one.reads, "page": one.page} for one in entries]
        terminal.print_json({"formats": known})
    else:
        terminal.print_formats()


@app.command(
    epilog="Examples:\n\nrampcast site 26_tracks.csv --road lower --out my.toml\n\n"
    "rampcast site 26_tracks.csv --road lower --ramp-lane 4 --gore 120 --ramp-end 300 --out my.toml"
)
@reads_files("accept_doubtful")
def site(
    files: Files,
    out: SiteFile,
    road: Annotated[str | None, typer.Option("--road", help="Which road, if there are several.")] = None,
    name: Annotated[str | None, typer.Option("--name", help="Name of the site. Default: as drafted.")] = None,
    ramp_lane: Annotated[list[int] | None, typer.Option("--ramp-lane", help="Lane of the ramp; once for each.")] = None,
    target_lane: TargetLane = None,
    gore: Gore = None,
    ramp_end: RampEnd = None,
    merge_zone: MergeZone = None,
    speed_limit: Annotated[float | None, typer.Option("--speed-limit", min=1.0, help="Speed limit \\[m/s].")] = None,
    mirrored: Mirrored = False,
    no_ramp: Annotated[bool, typer.Option("--no-ramp", help="Write a site without a ramp.")] = False,
    picture: Annotated[
        Path | None, typer.Option("--picture", callback=writable_file, help="Picture. Default: OUT with .png.")
    ] = None,
    reading: Reading = Reading(),
) -> None:
    """Writes a site file from a recording, with a picture to check it by eye; asks for the ramp if it is not given."""
    from rampcast.roads.ramp import RampValues, without_ramp
    from rampcast.roads.ramp import mirrored as turned

    _check_site_name(out)
    values = RampValues(tuple(ramp_lane or ()), target_lane, gore, ramp_end, merge_zone)
    if no_ramp and values != RampValues():
        raise SiteError("--no-ramp writes a site without a ramp: leave it out, or --ramp-lane and what goes with it")
    picture = picture or _picture_of(out)
    recording = read_road(files, road, reading)
    recording = turned(recording) if mirrored else recording
    if not no_ramp and not values.or_of(recording.site).lanes:
        _write_draft(recording, picture)
    made = without_ramp(recording.site) if no_ramp else site_with_ramp(recording, values)
    made = replace(made, name=name or made.name, speed_limit=speed_limit or made.speed_limit)
    _write_site(replace(recording, site=made), out, picture)


@app.command(
    epilog="Examples:\n\nrampcast doctor trajectories-0400-0415.txt --out out/doctor\n\n"
    "rampcast doctor data.csv --mapping my.toml --json > doctor.json"
)
@reads_files("skip_bad_rows", "accept_doubtful")
def doctor(
    files: Files,
    reading: Reading = Reading(),
    out: Annotated[
        Path | None,
        typer.Option("--out", callback=writable_folder, help="Folder for a page with pictures and all places."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print json instead of tables.")] = False,
) -> None:
    """Says what is wrong with a recording, where, and what to do; exit code 1 if it would spoil a forecast."""
    from rampcast.doctor import doctor as examine

    with terminal.progress("read and examine"):
        diagnosis = examine(*read_roads(files, reading._replace(skip_bad_rows=True)))
    terminal.print_diagnosis(diagnosis, out=out, as_json=json, command=user_command())
    if diagnosis.spoils:
        raise typer.Exit(1)


@app.command(
    epilog="Examples:\n\nrampcast download --list\n\nrampcast download ngsim-i80 --out data   "
    "(call it again after an interruption)\n\nrampcast download tgsim-i395 --out data --limit-rows 100000"
)
def download(
    name: Annotated[str | None, typer.Argument(help="Name of a data set; --list shows them.")] = None,
    out: OutFolder = Path("."),
    limit_rows: Annotated[
        int | None, typer.Option("--limit-rows", min=1, help="Get so many rows only, to try.")
    ] = None,
    list: Annotated[bool, typer.Option("--list", help="Show the data sets, or NAME; get none.")] = False,
    portal: Annotated[
        str | None, typer.Option("--portal", envvar="RAMPCAST_PORTAL", help="Address of a copy of the portal.")
    ] = None,
) -> None:
    """Gets a public data set by name and checks it; goes on where it was interrupted."""
    from rampcast.download import PORTAL, kept
    from rampcast.download import download as run

    if list or name is None:
        terminal.print_data_sets(name)
        return
    try:
        with terminal.progress() as tell:
            found = run(name, out, limit=limit_rows, portal=portal or PORTAL, tell=tell, note=terminal.note)
    except KeyboardInterrupt:
        terminal.complain(kept(name, out, limit=limit_rows))
        raise typer.Exit(130) from None  # as a shell counts Ctrl-C
    terminal.print_download(found, out)


@app.command(epilog="Example:\n\nrampcast simulate --site i80 --minutes 15 --seed 1 --out recording.parquet")
def simulate(
    out: OutFile,
    site: Annotated[str, typer.Option("--site", help="A site's name, or a .toml file.")] = "i80",
    minutes: Annotated[float, typer.Option("--minutes", min=0.1, help="Length of the recording \\[min].")] = 15.0,
    seed: Seed = 1,
    window: Annotated[str, typer.Option("--window", help="Name of the window.")] = "1",
    noise: Annotated[float, typer.Option("--noise", min=0.0, help="Standard deviation of position noise \\[m].")] = 0.0,
    drivers: Annotated[str, typer.Option("--drivers", help="Set of drivers: default or queue_headway.")] = "default",
) -> None:
    """Simulates a recording of a site with SUMO (needs [bold]pip install "rampcast\\[sumo]"[/])."""
    from rampcast.recording import write_recording
    from rampcast.simulate import simulate as run

    with terminal.progress() as tell:
        recording = run(
            site,
            minutes=minutes,
            seed=seed,
            window=window,
            position_noise=noise,
            drivers=drivers,
            progress=lambda share: tell("simulate", round(100 * share), 100),
        )
        write_recording(recording, out)
    terminal.say(f"wrote {out}: {recording.tracks.height:,} rows of simulated traffic")


def _check_site_name(out: Path) -> None:
    if out.suffix != ".toml":
        raise SiteError(f"--out: a site file's name ends in .toml, got {out}")


def _picture_of(out: Path) -> Path:
    """Returns where the picture of a site file goes if the user names no place.

    Raises:
        SiteError: another picture is there.
    """
    from rampcast.plots.site_picture import is_site_picture

    picture = out.with_suffix(".png")
    if picture.is_file() and not is_site_picture(picture):
        raise SiteError(f"{picture}: this is no picture of a site and would be lost; name another with --picture")
    return picture


def _write_draft(recording: "Recording", picture: Path) -> None:
    """Writes the picture of the drafted lanes, to choose that of the ramp by eye."""
    from rampcast.plots.site_picture import write_site_picture

    write_site_picture(recording, picture)
    terminal.note(f"wrote {picture}: the drafted lanes")


def _write_site(recording: "Recording", out: Path, picture: Path) -> None:
    from rampcast.files import write_whole
    from rampcast.plots.site_picture import write_site_picture
    from rampcast.sites import write_site

    with write_whole(out) as new:  # takes its place when the picture has taken its own: on a full disk neither does
        write_site(recording.site, new)
        write_site_picture(recording, picture)
    length = recording.site.ramp_end - recording.site.gore
    if length < SHORTEST_RAMP:  # never true of a site without a ramp: its length is not known
        terminal.warn(
            f"gore and ramp_end of {out} are {length:.0f} m apart, which is short "
            "for a ramp: look where the ramp lane ends, and give --gore and --ramp-end"
        )
    terminal.say(f"wrote {out} and {picture}: look at the picture before you use the site")
