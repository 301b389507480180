"""Fuzzes the readers, guided by the lines of them that each input reaches; needs atheris (pip install atheris).

What is not given a message of rampcast's own, or not accounted for, ends the run, and the input is kept beside it.

    python benchmarks/fuzz_atheris.py --format sumo -max_total_time=60
    python benchmarks/fuzz_atheris.py --format sumo crash-4d7a...             reads one input again

All options but --format are libFuzzer's; without --format the input chooses the form of the file.
"""

import importlib.util
import os
import sys
import tempfile
import zlib
from pathlib import Path
from random import Random

PROJECT = Path(__file__).parents[1]
LONGEST = 100_000  # [bytes] of an input
DAMAGED = 0.5  # share of mutations that are those of the other fuzz tests; the rest are libFuzzer's own


def forms_of(name: str) -> list[str]:
    """Returns the forms of a format that are fuzzed; all forms where no format is named."""
    from tests.formats.samples import samples

    found = [form for form, sample in samples().items() if name in ("", sample.format)]
    if not found:
        sys.exit(f"there is no format '{name}'; known: {', '.join(sorted({s.format for s in samples().values()}))}")
    return found


def main(arguments: list[str]) -> None:
    """Fuzzes until libFuzzer ends it."""
    import atheris

    name = ""
    if "--format" in arguments:
        place = arguments.index("--format")
        name = arguments[place + 1]
        arguments = arguments[:place] + arguments[place + 2 :]
    sys.path.insert(0, str(PROJECT))
    with atheris.instrument_imports(include=["rampcast.formats", "rampcast.recording"]):
        from tests.formats.damage import damaged
        from tests.formats.reading import read_or_refuse
        from tests.formats.samples import samples
    forms = forms_of(name)
    folder = tempfile.TemporaryDirectory(prefix="rampcast-fuzz-")

    def test(data: bytes) -> None:
        if len(data) < 1:
            return
        sample = samples()[forms[data[0] % len(forms)]]
        random = Random(zlib.crc32(data))
        target = random.choice(sorted(sample.files))
        read_or_refuse(sample, Path(folder.name), {target: data[1:]}, random)

    def mutated(data: bytes, most: int, seed: int) -> bytes:
        random = Random(seed)
        number = random.randrange(len(forms))
        sample = samples()[forms[number]]
        if not data:
            return (bytes([number]) + sample.files[random.choice(sample.given)])[:most]
        if random.random() < DAMAGED:
            return (data[:1] + damaged(data[1:], random))[:most]
        return atheris.Mutate(data, most)

    corpus = tempfile.TemporaryDirectory(prefix="rampcast-corpus-")
    for number, form in enumerate(forms):
        for place, content in enumerate(samples()[form].files.values()):
            (Path(corpus.name) / f"{number}-{place}").write_bytes(bytes([number]) + content)
    given = [one for one in arguments[1:] if not one.startswith("-")]
    options = [f"-max_len={LONGEST}", "-timeout=60", "-rss_limit_mb=4000", "-use_value_profile=1"]
    atheris.Setup(
        [arguments[0], *options, *arguments[1:], *([] if given else [corpus.name])], test, custom_mutator=mutated
    )
    atheris.Fuzz()


if __name__ == "__main__":
    if importlib.util.find_spec("atheris") is None:
        print("skipped: needs atheris, which is no part of rampcast: pip install atheris")
    else:
        os.environ.setdefault("RUST_BACKTRACE", "0")
        main(sys.argv)
