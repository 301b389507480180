"""Output files, written whole or not at all; what rampcast cannot prove to be its own is not replaced or removed.

A file is made in a work folder beside its place, `.rampcast-<16 hex digits>.partial`, flushed to the disk, and renamed.
The work folder is locked for as long as its process lives, so whoever writes there next can tell what a killed process
left, and removes it. docs/decisions/whole_or_nothing.md says why.

Where the user names a file, that file is replaced (`write_whole`). Where the user names a folder, the names in it are
ours: there a list, `.rampcast.json`, holds the SHA-256 of each file that was written (`write_outputs`), and a file that
is not as the list says is the user's.
"""

import contextlib
import errno
import hashlib
import json
import os
import re
import secrets
import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final

from rampcast.errors import OutputError

# Windows has none: two writers do not wait for each other there, and what a killed one left stays.
fcntl: ModuleType | None = import_module("fcntl") if os.name == "posix" else None
WORK: Final = re.compile(r"\.rampcast-[0-9a-f]{16}\.partial")
LIST: Final = ".rampcast.json"
READY: Final = "ready.json"  # in a work folder whose files are all whole: which they are, and which others shall go
NEW: Final = "new"
MOST_SETTINGS: Final = 1 << 26  # [bytes] 67 MB; a site of a hundred thousand points has 3
LOCK_TRIES: Final = 5
FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
PROBE: Final = bytes(4096)  # on a full disk an empty file can still be made


@contextmanager
def write_whole(path: Path) -> Iterator[Path]:
    """Gives a path to write a file to, and puts that in the place of `path` when all went well; links are followed.

    Raises:
        OutputError: what is there is no ordinary file.
        OSError: the disk is full, or the folder is not to be written to; names `path`.
    """
    target = _followed(path)
    check_ordinary(target)
    with naming_faults(target), work_folder(target.parent) as work:
        yield work / NEW
        if target.exists():
            shutil.copymode(target, work / NEW)
        put(work / NEW, target)


def read_settings(path: Path) -> str:
    """Returns the text of a file of settings, which nobody writes large.

    Raises:
        ValueError: it is larger, or no text.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        text = file.read(MOST_SETTINGS + 1)
    if len(text) > MOST_SETTINGS:
        raise ValueError(f"it has more than {MOST_SETTINGS / 1e6:.0f} MB, which no such file has")
    return text.decode("utf-8")


@contextmanager
def write_outputs(folder: Path, *, gone: Collection[str] = ()) -> Iterator[Path]:
    """Gives an empty folder to fill, and puts each file in it in its place in `folder` when all are whole.

    Whoever is killed while they are put in place has them put there by the next one who writes to the folder.

    Args:
        folder: where all else stays as it is.
        gone: names of files of an earlier run that are removed if they are still as that run wrote them.

    Raises:
        OutputError: a file would be replaced that was not written here, or was changed since.
        OSError: as `write_whole`.
    """
    folder = _followed(folder)
    with naming_faults(folder), work_folder(folder) as work:
        new = work / NEW
        new.mkdir()
        yield new
        made = {str(path.relative_to(new).as_posix()): path for path in sorted(new.rglob("*")) if path.is_file()}
        for path in made.values():
            _flush(path)
        todo = {"files": {name: sha256_of(path) for name, path in made.items()}, "gone": sorted({*gone} - made.keys())}
        _write_text(work / f"{READY}.new", work / READY, json.dumps(todo))
        with locked(folder):
            _put_in_place(work, folder)


def check_outputs(folder: Path, names: Collection[str]) -> None:
    """Checks that files can be written to a folder without a loss, before the work for them is done.

    Raises:
        OutputError: one is there that was not written by `write_outputs`, or was changed since.
    """
    known = _list_of(folder)
    for name in sorted(names):
        if not _may_be_replaced(folder / name, known.get(name, ())):
            raise OutputError(
                f"{folder / name}: this file is not as rampcast wrote it, if it did at all, and would be lost; move it "
                "away, or choose another folder with --out"
            )


@contextmanager
def work_folder(folder: Path) -> Iterator[Path]:
    """Gives an empty folder in a folder, which goes in the end; what killed processes left there goes first."""
    folder.mkdir(parents=True, exist_ok=True)
    clean_up(folder)
    for _ in range(LOCK_TRIES):
        work = folder / f".rampcast-{secrets.token_hex(8)}.partial"
        work.mkdir()
        if (lock := _lock(work)) is not None:
            break  # else one who cleans up was quicker; or this disk has no locks, and nobody cleans up on it
    try:
        yield work
    finally:
        shutil.rmtree(work, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def clean_up(folder: Path) -> None:
    """Removes the work folders of processes that are no more; what was whole in them is put in its place first."""
    with os.scandir(folder) as entries:
        left = [Path(one.path) for one in entries if WORK.fullmatch(one.name) and one.is_dir(follow_symlinks=False)]
    for work in left:
        if (lock := _lock(work)) is None:
            continue
        try:
            if (work / READY).is_file():
                with locked(folder), contextlib.suppress(OutputError):  # its place was taken meanwhile
                    _put_in_place(work, folder)
            shutil.rmtree(work, ignore_errors=True)
        finally:
            os.close(lock)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lets one at a time into a folder; where there are no locks, as on some network disks, everybody."""
    if fcntl is None:
        yield
        return
    place = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(place, fcntl.LOCK_EX)
        yield
    finally:
        os.close(place)


def put(new: Path, target: Path) -> None:
    """Flushes a file to the disk and puts it, whole, in the place of another; links are followed."""
    _flush(new)
    target = _followed(target)
    try:
        os.replace(new, target)
    except OSError as error:
        if error.errno != errno.EXDEV:  # a link led to another disk
            raise
        with write_whole(target) as there:
            shutil.copyfile(new, there)
    _flush_folder(target.parent)


def sha256_of(path: Path) -> str:
    """Returns the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_ordinary(path: Path) -> None:
    """Refuses to put a file in the place of a folder, a device or a pipe.

    Raises:
        OutputError: there is one.
    """
    if os.path.isdir(path):  # unlike Path.is_dir it takes a name that is too long
        raise OutputError(f"{path}: this is a folder; name the file to write, as {path / 'NAME'}")
    if os.path.exists(path) and not os.path.isfile(path):
        raise OutputError(f"{path}: this is no ordinary file, and is not replaced; choose another --out")


def check_file(path: Path) -> None:
    """Checks that a file can be written, before long work is done for it, by writing one of that name in a work folder.

    Raises:
        OutputError: it is a folder, or nothing can be written there.
    """
    target = _followed(path)
    check_ordinary(target)
    with _refusing(path, target.parent), _made_for_now(target.parent):
        if os.path.exists(target):
            _probe(target.parent)
            if not os.access(target, os.W_OK):
                raise PermissionError(errno.EACCES, "the file is not to be written to")
        else:
            _probe(target.parent, target.name)


def check_folder(path: Path) -> None:
    """Checks that files can be written to a folder, before long work is done for them, by writing one.

    Raises:
        OutputError: it is a file, or nothing can be written there.
    """
    folder = _followed(path)
    with _refusing(path, folder), _made_for_now(folder):
        _probe(folder)


@contextmanager
def naming_faults(path: Path) -> Iterator[None]:
    """Turns the faults of a disk into an OSError that names the file that the user asked for."""
    try:
        yield
    except OSError as error:
        inside = error.filename is None or WORK.search(str(error.filename))
        if error.errno is None or not inside:
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
    except BaseException as error:  # polars wraps them in errors of its own, some of which are no Exception
        if not (code := re.search(r"\(os error (\d+)\)", str(error))):
            raise
        raise OSError(int(code[1]), os.strerror(int(code[1])), str(path)) from error


def _put_in_place(work: Path, folder: Path) -> None:
    todo = json.loads((work / READY).read_bytes())
    new: dict[str, str] = todo["files"]
    known = _list_of(folder)
    for name, digest in new.items():
        if not _may_be_replaced(folder / name, {*known.get(name, ()), digest}):
            raise OutputError(
                f"{folder / name}: this file is not as rampcast wrote it, and would be lost; move it away"
            )
    going = [name for name in todo["gone"] if name in known and _may_be_replaced(folder / name, known[name])]
    # both digests while either may be there
    _write_list(work, folder, {**known, **{name: [*known.get(name, ()), digest] for name, digest in new.items()}})
    for name in new:
        if (made := work / NEW / name).exists():  # else a process put it in place that was killed then
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            put(made, folder / name)
    for name in going:
        (folder / name).unlink(missing_ok=True)
    rest = {name: digests for name, digests in known.items() if name not in going}
    _write_list(work, folder, {**rest, **{name: [digest] for name, digest in new.items()}})
    (work / READY).unlink()


def _may_be_replaced(path: Path, digests: Collection[str]) -> bool:
    """Returns whether nothing is at a path, or a file of which one of the digests is known."""
    return not os.path.lexists(path) or (path.is_file() and sha256_of(path) in digests)


def _list_of(folder: Path) -> Mapping[str, list[str]]:
    try:
        found = json.loads(read_settings(folder / LIST))
        return {str(name): [str(one) for one in digests] for name, digests in dict(found).items()}
    except (OSError, ValueError, TypeError, RecursionError):  # none, or a damaged one, which proves nothing
        return {}


def _write_list(work: Path, folder: Path, known: Mapping[str, list[str]]) -> None:
    _write_text(work / LIST, folder / LIST, json.dumps(known, indent=1))


def _write_text(new: Path, target: Path, text: str) -> None:
    new.write_text(text, encoding="utf-8")
    put(new, target)


def _lock(work: Path) -> int | None:
    """Returns the lock of a work folder; None if another holds it, it is gone, or there are no locks."""
    if fcntl is None:
        return None
    try:
        lock = os.open(work, os.O_RDONLY)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(lock).st_ino == work.stat().st_ino:
            return lock
    except OSError:
        pass
    os.close(lock)
    return None


def _followed(path: Path) -> Path:
    """Returns the path that links lead to, whether or not something is there."""
    return Path(os.path.realpath(path))


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    if fcntl is None:
        return
    place = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # not every disk can
            os.fsync(place)
    finally:
        os.close(place)


@contextmanager
def _made_for_now(folder: Path) -> Iterator[None]:
    """Makes a folder and those that it lies in, and removes again those that were not there."""
    missing = [one for one in (folder, *folder.parents) if not os.path.lexists(one)]
    made: list[Path] = []
    try:
        for one in reversed(missing):
            one.mkdir(exist_ok=True)
            made.append(one)
        yield
    finally:
        for one in reversed(made):
            with contextlib.suppress(OSError):  # somebody else uses it by now
                one.rmdir()


def _probe(folder: Path, name: str = "probe") -> None:
    with work_folder(folder) as work:
        (work / name).write_bytes(PROBE)


@contextmanager
def _refusing(path: Path, folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        there = next(one for one in (folder, *folder.parents) if os.path.exists(one))
        if not there.is_dir():
            raise OutputError(
                f"{path}: cannot be written, because {there} is a file and no folder; choose another --out"
            ) from error
        mend = "make room there" if error.errno in FULL else "change its rights"
        raise OutputError(
            f"{path}: nothing can be written in {there} ({error.strerror}); {mend}, or choose another --out"
        ) from error
