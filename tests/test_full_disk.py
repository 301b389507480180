"""Every command on a disk that is full: one sentence that says what to do, no half file, and old results as whole."""

import json
import shutil
import subprocess
import sys

import pytest

UNSHARE = ["unshare", "--map-root-user", "--mount"]  # what is mounted in it is seen by nobody else, and goes with it
COMMANDS = (
    "convert", "site", "doctor", "forecast", "evaluate", "train", "train_paper", "benchmark", "simulate",
    "train_in_stages", "plot", "start",
)  # fmt: skip


def may_mount() -> bool:
    """Returns whether memory may be mounted as a disk here."""
    if shutil.which("unshare") is None:
        return False
    tried = [*UNSHARE, "mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", "/mnt"]
    return subprocess.run(tried, capture_output=True).returncode == 0


pytestmark = [pytest.mark.slow, pytest.mark.skipif(not may_mount(), reason="needs to be allowed to mount a tmpfs")]


@pytest.fixture(scope="module")
def ask(tmp_path_factory):
    """Gives a function that returns what became of a command on a disk that is full."""
    server = [*UNSHARE, sys.executable, "-m", "tests.full_disk", str(tmp_path_factory.mktemp("disks"))]
    with subprocess.Popen(server, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:

        def asked(command: str) -> list[dict]:
            process.stdin.write(f"{command}\n")
            process.stdin.flush()
            return json.loads(process.stdout.readline())

        yield asked
        process.stdin.close()


@pytest.mark.parametrize("command", COMMANDS)
def test_a_full_disk_is_one_sentence_that_says_what_to_do_and_costs_no_file(command, ask):
    before, *full, after = ask(command)
    assert (before["told"], after["told"]) == ("", "")
    assert full[0]["told"]
    for found in full:
        for told, folder in ((found["told"], "/old"), (found["first"], "/new")):
            assert not told or ("No space left on device" in told and folder in told), told
            assert not told or "make room" in told.lower(), told
            assert "rights" not in told
        assert found["is_whole"]
        assert found["is_same"] or not found["told"]
        assert not found["first"] or not found["left"], found
