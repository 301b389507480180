"""The application that commands are added to."""

from typing import Annotated

import typer

app = typer.Typer(
    name="rampcast",
    help="Forecasts where every vehicle on a highway on-ramp will be, and when it will change lane, up to 15 s ahead.",
    epilog="Exit codes: 0 done; 1 a check found what would spoil a forecast; 2 a mistake to mend; 130 stopped. "
    "More: [bold]rampcast docs manners[/].",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _say_version(asked: bool) -> bool:
    if asked:
        from rampcast import __version__

        typer.echo(f"rampcast {__version__}")
        raise typer.Exit()
    return asked


@app.callback()
def before(
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version.")
    ] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="No progress, no notes; results and errors only.")
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Log what libraries say, with times.")] = False,
) -> None:
    from rampcast.cli import show

    if quiet:
        show.hush()
    if verbose:
        import logging

        logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s: %(message)s")
