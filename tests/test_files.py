"""Files are written whole or not at all, by one or by two at once, killed at any moment, and nobody's file is lost."""

import errno
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import polars as pl
import pytest

from rampcast import files
from rampcast.errors import OutputError
from rampcast.files import LIST, check_file, check_folder, check_outputs, work_folder, write_outputs, write_whole

pytestmark = pytest.mark.skipif(files.fcntl is None, reason="needs the locks of a unix")
PROJECT = Path(__file__).parents[1]
CONTENT = {"a.txt": "a", "tables/b.txt": "b"}


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != LIST)


def put_all(folder: Path, content: dict[str, str], *, gone: tuple[str, ...] = ()) -> None:
    with write_outputs(folder, gone=gone) as new:
        for name, text in content.items():
            (new / name).parent.mkdir(exist_ok=True)
            (new / name).write_text(text)


def read_all(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and path.name != LIST and ".partial" not in str(path)
    }


def fail(path: Path) -> None:
    path.write_text("half")
    raise ValueError("an error")


def test_a_file_is_there_when_it_is_whole_and_not_before(tmp_path):
    out = tmp_path / "deep" / "x.txt"
    with write_whole(out) as partial:
        partial.write_text("half")
        assert not out.exists()
        partial.write_text("whole")
    assert out.read_text() == "whole"
    with pytest.raises(ValueError, match="an error"), write_whole(out) as partial:
        fail(partial)
    assert (out.read_text(), names(out.parent)) == ("whole", ["x.txt"])


def test_links_are_followed_and_rights_are_kept(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    link = tmp_path / "link.txt"
    link.symlink_to(tmp_path / "elsewhere" / "x.txt")  # leads to nothing yet
    for text in ("first", "second"):
        with write_whole(link) as partial:
            partial.write_text(text)
        assert link.is_symlink()
        assert (tmp_path / "elsewhere" / "x.txt").read_text() == text
        (tmp_path / "elsewhere" / "x.txt").chmod(0o640)
    assert (tmp_path / "elsewhere" / "x.txt").stat().st_mode & 0o777 == 0o640


def test_a_name_as_long_as_the_disk_takes_can_be_written(tmp_path):
    with write_whole(tmp_path / ("x" * 255)) as partial:
        partial.write_text("whole")
    assert names(tmp_path) == ["x" * 255]


def test_no_folder_device_or_pipe_is_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for place, message in ((tmp_path, "this is a folder"), (tmp_path / "pipe", "no ordinary file")):
        for attempt in (check_file, lambda path: write_whole(path).__enter__()):
            with pytest.raises(OutputError, match=message):
                attempt(place)


def test_two_threads_that_write_one_file_never_tear_it(tmp_path):
    out, wrong = tmp_path / "x", []
    with write_whole(out) as partial:
        partial.write_bytes(b"a" * 100_000)

    def save(letter: bytes) -> None:
        for _ in range(60):
            with write_whole(out) as partial:
                partial.write_bytes(letter * 100_000)

    threads = [threading.Thread(target=save, args=(letter,)) for letter in (b"a", b"b")]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        if out.read_bytes() not in (b"a" * 100_000, b"b" * 100_000):
            wrong.append(1)
    assert (wrong, names(tmp_path)) == ([], ["x"])


def test_two_processes_that_write_one_folder_leave_the_files_of_one(tmp_path):
    code = (
        "import sys\nfrom pathlib import Path\nfrom tests.test_files import put_all\n"
        "for _ in range(15): put_all(Path(sys.argv[1]), {f'f{i}': sys.argv[2] for i in range(5)})"
    )
    writers = [subprocess.Popen([sys.executable, "-c", code, tmp_path, text]) for text in ("one", "two")]
    assert [writer.wait() for writer in writers] == [0, 0]
    found = read_all(tmp_path)
    assert len(found) == 5
    assert len({*found.values()}) == 1
    assert names(tmp_path) == [f"f{i}" for i in range(5)]


def test_files_that_were_not_written_here_or_were_changed_since_are_not_replaced(tmp_path):
    (tmp_path / "mine.txt").write_text("precious")
    put_all(tmp_path, CONTENT)
    put_all(tmp_path, CONTENT | {"a.txt": "newer"})
    (tmp_path / "a.txt").write_text("annotated by hand")
    before = read_all(tmp_path)
    check_outputs(tmp_path, ["tables/b.txt", "not there.txt"])
    for name in ("a.txt", "mine.txt"):
        with pytest.raises(OutputError, match=f"{name}: .*would be lost"):
            check_outputs(tmp_path, [name])
        with pytest.raises(OutputError, match=f"{name}: .*would be lost"):
            put_all(tmp_path, {name: "ours", "tables/b.txt": "newer"})
    assert read_all(tmp_path) == before


def test_of_an_earlier_run_goes_only_what_is_as_it_was_written(tmp_path):
    (tmp_path / "mine.txt").write_text("precious")
    put_all(tmp_path, {"a.txt": "a", "b.txt": "b", "c.txt": "c"})
    (tmp_path / "b.txt").write_text("annotated by hand")
    put_all(tmp_path, {"a.txt": "newer"}, gone=("a.txt", "b.txt", "c.txt", "mine.txt"))
    assert read_all(tmp_path) == {"a.txt": "newer", "b.txt": "annotated by hand", "mine.txt": "precious"}


def test_what_fails_leaves_all_as_it_was(tmp_path):
    put_all(tmp_path, CONTENT)
    with pytest.raises(ValueError, match="an error"), write_outputs(tmp_path, gone=("a.txt",)) as new:
        fail(new / "a.txt")
    assert read_all(tmp_path) == CONTENT


def test_a_damaged_list_proves_nothing(tmp_path):
    put_all(tmp_path, CONTENT)
    for damage in (b"", b"\xff", b"[1]", b'{"a.txt": 5}', b"[" * 100_000):
        (tmp_path / LIST).write_bytes(damage)
        with pytest.raises(OutputError):
            check_outputs(tmp_path, CONTENT)


def killed_at(moment: int, folder: Path) -> bool:
    """Writes files anew in a process that kills itself at its so-many-th call of the system; returns whether it did."""
    child = os.fork()
    if child == 0:
        counted = [0]

        def kill(event: str, _: object) -> None:
            counted[0] += event.startswith(("os.", "open", "shutil."))
            if counted[0] == moment:
                os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(kill)
        put_all(folder, {name: f"{text} anew" for name, text in CONTENT.items()}, gone=("c.txt",))
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


def survives(root: Path) -> None:
    """Kills a writer at every other moment, and prints how often; in a process without threads, which may fork."""
    old, new = CONTENT | {"c.txt": "c"}, {name: f"{text} anew" for name, text in CONTENT.items()}
    moments, kills = range(1, 400, 2), 0
    for moment in moments:
        folder = root / str(moment)
        put_all(folder, old)
        if not killed_at(moment, folder):
            break
        kills += 1
        for name, text in read_all(folder).items():
            assert text in (old[name], new.get(name))
        assert {*new} <= {*read_all(folder)}
        with work_folder(folder):  # whoever writes next
            pass
        assert read_all(folder) in (old, new)
        assert names(folder) in (["a.txt", "c.txt", "tables"], ["a.txt", "tables"])
        put_all(folder, new, gone=("c.txt",))
        assert read_all(folder) == new
    print(kills)


@pytest.mark.slow
def test_killed_at_any_moment_the_old_or_the_new_is_there_and_nothing_else_after_the_next_write(tmp_path):
    code = f"from pathlib import Path; from tests.test_files import survives; survives(Path({str(tmp_path)!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=PROJECT)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 20


def test_a_living_writer_is_not_cleaned_away(tmp_path):
    with work_folder(tmp_path) as first, work_folder(tmp_path) as second:
        files.clean_up(tmp_path)
        assert first.is_dir()
        assert second.is_dir()
    assert names(tmp_path) == []


def test_without_locks_files_are_written_all_the_same(tmp_path, monkeypatch):
    def no_locks(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(files.fcntl, "flock", no_locks)
    put_all(tmp_path, CONTENT)
    assert read_all(tmp_path) == CONTENT


def test_the_check_before_the_work_leaves_nothing_and_finds_what_would_fail_after_it(tmp_path):
    check_folder(tmp_path / "a" / "b")
    check_file(tmp_path / "a" / "x.txt")
    assert names(tmp_path) == []
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to(tmp_path / "file" / "below")
    for place in (tmp_path / "file", tmp_path / "file" / "below", tmp_path / "link"):
        with pytest.raises(OutputError, match="is a file and no folder"):
            check_folder(place)
    for check in (check_folder, check_file):
        with pytest.raises(OutputError, match=r"nothing can be written in .*name too long"):
            check(tmp_path / ("x" * 256))
    check_folder(tmp_path / ("x" * 255))
    assert names(tmp_path) == ["file", "link"]


def test_a_full_disk_is_an_error_that_names_the_file_and_the_old_one_stays(tmp_path):
    resource = pytest.importorskip("resource")
    out = tmp_path / "x.parquet"
    pl.DataFrame({"x": [1]}).write_parquet(out)
    whole, limits = out.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    big = pl.DataFrame({"x": os.urandom(1_000_000).hex()})
    writers = (lambda path: big.write_parquet(path), lambda path: path.write_bytes(bytes(1_000_000)))
    for write in writers:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
        try:
            with pytest.raises(OSError, match="File too large") as failed, write_whole(out) as partial:
                write(partial)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert failed.value.filename == str(out)
    assert (out.read_bytes(), names(tmp_path)) == (whole, ["x.parquet"])
