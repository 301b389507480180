"""The application that commands are added to."""

import typer

app = typer.Typer(
    name="rampcast",
    help="Forecasts where every vehicle on a highway on-ramp will be, and when it will change lane, up to 15 s ahead.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    add_completion=False,
)
