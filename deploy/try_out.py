"""Does what the Dockerfile does, in a fresh virtual environment, and tells how much the extra [live] adds to it.

Run: python deploy/try_out.py [FOLDER]      (a minute or two; FOLDER is made, and removed unless it is named)

The files that it copies, what it installs, the command that it starts and the one that looks whether the service is
well are read from the Dockerfile itself; only the port is another one. It fails where [live] adds over 12 MB.
"""

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PROJECT = Path(__file__).parents[1]
DOCKERFILE = Path(__file__).with_name("Dockerfile")
MOST = 12.0  # [MB] that [live] may add
PATIENCE = 300.0  # [s] until the service is well: it compiles
PORT = "8480"


def main(folder: Path) -> None:
    """Prints sizes, and when the service is ready; exits with 1 where something is not as it should be."""
    steps = instructions(DOCKERFILE.read_text(encoding="utf-8"))
    work, environment = folder / "app", folder / "venv"
    copied(steps, work)
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    install = shlex.split(steps["RUN"][0].partition("&&")[0])
    sizes = {}
    for extras in ("", "[live]", install[-3 if "--constraint" in install else -1].removeprefix(".")):
        wanted = [f".{extras}" if one.startswith(".") else one for one in install]
        subprocess.run([str(environment / "bin" / wanted[0]), *wanted[1:], "--quiet"], cwd=work, check=True)
        sizes[extras] = size(environment)
        print(f".{extras}: {sizes[extras]:.1f} MB", flush=True)
    added = sizes["[live]"] - sizes[""]
    print(f"[live] adds {added:.1f} MB")
    began = time.perf_counter()
    healthy(steps, environment, work)
    print(f"the service was well after {time.perf_counter() - began:.0f} s")
    if added > MOST:
        sys.exit(f"[live] adds {added:.1f} MB, at most {MOST:g} were meant")


def instructions(text: str) -> dict[str, list[str]]:
    """Returns the instructions of a Dockerfile: of each word what stands behind it, in their order."""
    found: dict[str, list[str]] = {}
    for line in text.replace("\\\n", " ").splitlines():
        word, _, rest = line.strip().partition(" ")
        if word and not word.startswith("#"):
            found.setdefault(word, []).append(rest.strip())
    return found


def copied(steps: dict[str, list[str]], work: Path) -> None:
    """Copies what the Dockerfile copies, and nothing else: what it forgets is missing here too."""
    work.mkdir(parents=True)
    for line in steps["COPY"]:
        *sources, target = line.split()
        for source in sources:
            there = PROJECT / source
            if there.is_dir():
                ignored = shutil.ignore_patterns("__pycache__")
                shutil.copytree(there, work / target, ignore=ignored, dirs_exist_ok=True)
            else:
                shutil.copy(there, work / target)


def size(environment: Path) -> float:
    """Returns how much is installed [MB], compiled Python files among it."""
    return sum(one.stat().st_size for one in environment.rglob("*") if one.is_file() and not one.is_symlink()) / 1e6


def healthy(steps: dict[str, list[str]], environment: Path, work: Path) -> None:
    """Starts the service as the Dockerfile does, and waits until its own look finds it well."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    look = json.loads(re.sub(r"^.*?CMD ", "", steps["HEALTHCHECK"][0]).replace(PORT, port))
    settings = dict(
        pair.split("=", 1) for line in steps["ENV"] for pair in line.replace("/home/rampcast", str(work)).split()
    )
    variables = {"PATH": f"{environment}/bin:{os.environ['PATH']}", "RAMPCAST_TOKEN": "0123456789abcdef", **settings}
    run = [*json.loads(steps["ENTRYPOINT"][0]), *json.loads(steps["CMD"][0]), "--port", port]
    with subprocess.Popen([str(environment / "bin" / run[0]), *run[1:]], cwd=work, env=variables) as served:
        try:
            deadline = time.monotonic() + PATIENCE
            while subprocess.run([str(environment / "bin" / look[0]), *look[1:]], stderr=subprocess.DEVNULL).returncode:
                if served.poll() is not None or time.monotonic() > deadline:
                    sys.exit("the service did not get well")
                time.sleep(1.0)
        finally:
            served.terminate()


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as made:
            main(Path(made, "container"))
