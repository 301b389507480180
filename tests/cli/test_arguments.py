"""Odd arguments are answered before any work, and what is printed moves no cursor."""

import pytest
from typer.testing import CliRunner

from rampcast.cli import app, show, told
from rampcast.cli.options import time_between
from rampcast.errors import RampcastError


@pytest.mark.parametrize("every", [float("nan"), float("inf"), -1.0, 0.0])
def test_a_time_between_moments_is_above_zero_and_finite(every):
    with pytest.raises(RampcastError, match="--every: expected a time above 0 s"):
        time_between(every)
    assert time_between(0.5) == 0.5


@pytest.mark.parametrize("seed", ["-1", "9" * 30, "nan"])
@pytest.mark.parametrize("command", ["train x --out", "simulate --out", "reproduce --data x --out"])
def test_a_seed_that_not_all_can_take_is_refused(command, seed, tmp_path):
    done = CliRunner().invoke(app, [*command.split(), str(tmp_path / "out"), "--seed", seed])
    assert done.exit_code == 2
    assert "--seed" in done.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a\x1b[2Jb", r"a\x1b[2Jb"),
        ("\x9b31m\x07\r", r"\x9b31m\x07\r"),
        ("txt.\u202eexe", r"txt.\u202eexe"),
        ("[bold]line\tend\n", "[bold]line\tend\n"),
    ],
)
def test_what_a_terminal_would_obey_is_shown_as_it_is_written(text, shown, capsys):
    show.say(text)
    assert capsys.readouterr().out.expandtabs() == f"{shown}\n".expandtabs()
    show.complain(text)
    show.warn(text)
    with show.progress(text) as tell:
        tell(text, 1, 2)
    table = show.titled(text, (text,))
    table.add_row(show.escape(text))
    show.messages.print(table)
    assert not show.OBEYED.search(capsys.readouterr().err)


def test_a_fault_of_the_disk_names_the_file_and_what_to_do():
    assert told(OSError(28, "No space left on device", "/x/y")) == (
        "/x/y: No space left on device. Make room or choose another --out, and call the same command again"
    )
    assert told(OSError("odd")) == "odd"
    assert told(FileNotFoundError(2, "No such file or directory", "/x")) == "/x: No such file or directory."
