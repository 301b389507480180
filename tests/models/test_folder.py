"""Model folders: written whole, read with care, and clear where they cannot be read."""

import contextlib
import io
import json
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

from rampcast import __version__
from rampcast.errors import ModelError
from rampcast.files import sha256_of
from rampcast.models.folder import (
    DESCRIPTION,
    DIGEST,
    FORM,
    UNNAMED,
    _digest,
    arrays_name,
    kind_of,
    load_model,
    save_model,
)


@dataclass(frozen=True)
class Line:
    slopes: Float[np.ndarray, "column"]
    start: float = 0.5


@dataclass(frozen=True)
class LaterLine:
    slopes: Float[np.ndarray, "column"]
    start: float = 0.5
    note: str = "none"
    steps: tuple[int, ...] = field(default=(1, 2))


TAGS = {"line": Line}
LINE = Line(np.array([1.0, 2.0]))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_model(LINE, tmp_path / "model", TAGS)
    return tmp_path / "model"


def rewrite(folder: Path, **values: object) -> None:
    """Changes what model.json says, as somebody would who means harm: its digest fits."""
    path = folder / DESCRIPTION
    found = json.loads(path.read_text()) | values
    del found[DIGEST]
    path.write_text(json.dumps({DIGEST: _digest(found)} | found))


def arrays_of(folder: Path) -> Path:
    (path,) = folder.glob("arrays*.npz")
    return path


def sign(folder: Path) -> None:
    """Lets model.json name the arrays' file as it is now."""
    digest = sha256_of(arrays_of(folder))
    arrays_of(folder).rename(folder / arrays_name(digest))
    rewrite(folder, arrays=digest)


def write_arrays(folder: Path, **arrays: np.ndarray) -> None:
    with arrays_of(folder).open("wb") as file:
        np.savez(file, allow_pickle=True, **arrays)
    sign(folder)


def load(folder: Path) -> Line:
    return load_model(folder, TAGS, kind="line")


def test_a_model_comes_back_as_it_was(folder):
    back = load(folder)
    np.testing.assert_array_equal(back.slopes, LINE.slopes)
    assert (back.start, kind_of(folder)) == (0.5, "line")


def test_the_folder_says_form_kind_and_release_and_holds_two_files(folder):
    description = json.loads((folder / DESCRIPTION).read_text())
    assert (description["form"], description["kind"], description["rampcast"]) == (FORM, "line", __version__)
    assert set(description["libraries"]) >= {"python", "numpy", "jax", "scikit-learn"}
    assert sorted(path.name for path in folder.iterdir()) == [arrays_of(folder).name, DESCRIPTION]


def test_a_release_with_more_fields_reads_what_an_older_one_wrote(folder):
    later = load_model(folder, {"line": LaterLine}, kind="line")
    assert (later.start, later.note, later.steps) == (0.5, "none", (1, 2))


def test_another_release_of_the_same_form_is_read(folder):
    rewrite(folder, rampcast="9.9.9")
    assert load(folder).start == 0.5


def test_a_field_of_a_later_release_is_named_with_the_release_that_wrote_it(tmp_path):
    save_model(LaterLine(LINE.slopes), tmp_path / "later", {"line": LaterLine})
    rewrite(tmp_path / "later", rampcast="9.9.9")
    with pytest.raises(ModelError, match=r"model\.json.*'note'.*does not know.*again, or install rampcast 9\.9\.9"):
        load(tmp_path / "later")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"form": 2, "rampcast": "0.1.0"}, rf"form 2, written by rampcast 0\.1\.0; .* reads form {FORM}: train"),
        ({"form": 99, "rampcast": "7.0.0"}, r"form 99, written by rampcast 7\.0\.0.*install rampcast 7\.0\.0 or later"),
        ({"form": None}, "form None"),
        ({"form": [3]}, "form .3.,"),
        ({"kind": "circle"}, "a model of the kind 'circle', expected one of the kind 'line'"),
    ],
)
def test_a_folder_of_another_form_or_kind_says_who_wrote_it_and_what_to_do(folder, values, message):
    rewrite(folder, **values)
    with pytest.raises(ModelError, match=message):
        load(folder)


def test_a_folder_of_the_first_releases_is_told_by_its_old_name_of_the_form(folder):
    (folder / DESCRIPTION).write_text(json.dumps({"folder_version": 2, "rampcast": "0.1.0", "mode": "corrected"}))
    with pytest.raises(ModelError, match=r"form 2, written by rampcast 0\.1\.0"):
        load(folder)


@pytest.mark.parametrize("name", [DESCRIPTION, "arrays"])
@pytest.mark.parametrize("damage", ["emptied", "cut", "missing", "noise"])
def test_a_damaged_file_is_an_error_that_names_it(folder, name, damage):
    path = folder / name if name == DESCRIPTION else arrays_of(folder)
    content = path.read_bytes()
    path.write_bytes({"emptied": b"", "cut": content[: len(content) // 2], "noise": b"\x00\xff" * 99}.get(damage, b""))
    if damage == "missing":
        path.unlink()
    with pytest.raises(ModelError, match=rf"{name}.*(train the model again|no model folder)|no model folder"):
        load(folder)


@pytest.mark.parametrize(
    "model",
    [
        None,
        [1, 2],
        "text",
        {},
        {"slopes": None},
        {"slopes": {"array": ["slopes"]}},
        {"slopes": {"tag": ["line"]}},
        {"slopes": {}},
    ],
)
def test_a_description_of_nothing_sensible_is_an_error_that_names_the_file(folder, model):
    rewrite(folder, model=model)
    with pytest.raises(ModelError, match=DESCRIPTION):
        load(folder)


def test_a_description_nested_without_end_is_refused(folder):
    text = (folder / DESCRIPTION).read_text()
    (folder / DESCRIPTION).write_text(text.replace("0.5", "[" * 100_000 + "]" * 100_000))  # before any digest
    with pytest.raises(ModelError, match=DESCRIPTION):
        load(folder)


@pytest.mark.parametrize(
    ("slopes", "message"),
    [
        (np.array([1, 2]), "got int64"),
        (np.ones((2, 2)), "of shape"),
        (np.array(1.0), "of shape"),
        (np.array(["1.0"]), "got <U3"),
        (np.array([object()]), "allow_pickle=False"),
    ],
)
def test_arrays_of_another_kind_or_shape_are_refused(folder, slopes, message):
    write_arrays(folder, slopes=slopes)
    with pytest.raises(ModelError, match=message):
        load(folder)


def test_an_array_that_is_not_there_is_named(folder):
    write_arrays(folder, other=np.ones(2))
    with pytest.raises(ModelError, match="the array 'slopes' is missing"):
        load(folder)


def test_an_array_larger_than_its_data_is_refused(folder):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)})
    with zipfile.ZipFile(arrays_of(folder), "w") as file:
        file.writestr("slopes.npy", header.getvalue() + bytes(80))
    sign(folder)
    with pytest.raises(ModelError, match=r"arrays-.*npz"):
        load(folder)


def test_a_file_that_would_fill_the_memory_is_not_unpacked(folder, monkeypatch):
    monkeypatch.setattr("rampcast.models.folder.LARGEST", 100)
    with pytest.raises(ModelError, match=r"arrays take .* GB, and at most"):
        load(folder)


def test_an_interrupted_save_leaves_the_old_folder_whole(folder, monkeypatch):
    def broken(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", broken)
    with pytest.raises(KeyboardInterrupt):
        save_model(Line(np.zeros(9)), folder, TAGS)
    assert len(load(folder).slopes) == 2
    assert [path.name for path in folder.parent.iterdir()] == ["model"]


def test_a_flipped_bit_anywhere_is_refused(folder):
    for path in (folder / DESCRIPTION, arrays_of(folder)):
        whole = path.read_bytes()
        for place in range(0, 8 * len(whole), 8 * len(whole) // 150):
            content = bytearray(whole)
            content[place // 8] ^= 1 << place % 8
            path.write_bytes(content)
            with contextlib.suppress(ModelError):  # else a blank became another blank
                assert_equal(load(folder))
        path.write_bytes(whole)


def assert_equal(found: Line) -> None:
    np.testing.assert_array_equal(found.slopes, LINE.slopes)
    assert found.start == LINE.start


def test_arrays_of_another_model_are_refused(folder, tmp_path):
    other = tmp_path / "other"
    save_model(Line(np.array([5.0, 6.0])), other, TAGS)
    arrays_of(folder).write_bytes(arrays_of(other).read_bytes())
    with pytest.raises(ModelError, match=r"not the file that model\.json was written with"):
        load(folder)


def test_a_folder_of_before_there_were_digests_is_read_and_a_digest_cannot_be_taken_out(folder):
    found = json.loads((folder / DESCRIPTION).read_text())
    (folder / DESCRIPTION).write_text(json.dumps({name: found[name] for name in found if name != DIGEST}))
    with pytest.raises(ModelError, match="SHA-256"):
        load(folder)
    old = {name: found[name] for name in found if name not in (DIGEST, "arrays")}
    (folder / DESCRIPTION).write_text(json.dumps(old))
    with pytest.raises(ModelError, match=UNNAMED):
        load(folder)
    arrays_of(folder).rename(folder / UNNAMED)
    assert_equal(load(folder))


def test_a_users_files_in_a_model_folder_stay_and_the_old_arrays_go(folder):
    (folder / "notes.txt").write_text("precious")
    (folder / "arrays-0123456789abcdef.npz").write_text("named as ours, but none of ours")
    old = arrays_name(json.loads((folder / DESCRIPTION).read_text())["arrays"])
    save_model(Line(np.zeros(9)), folder, TAGS)
    assert len(load(folder).slopes) == 9
    assert (folder / "notes.txt").read_text() == "precious"
    assert (folder / "arrays-0123456789abcdef.npz").exists()
    assert not (folder / old).exists()


def test_a_model_json_of_somebody_else_is_not_replaced(tmp_path):
    (tmp_path / "results.csv").write_text("precious")
    (tmp_path / DESCRIPTION).write_text('{"layers": 3}')
    with pytest.raises(ModelError, match="not written by rampcast"):
        save_model(LINE, tmp_path, TAGS)
    assert (tmp_path / DESCRIPTION).read_text() == '{"layers": 3}'
    assert sorted(path.name for path in tmp_path.iterdir()) == [DESCRIPTION, "results.csv"]


def test_a_link_to_a_folder_is_followed(folder, tmp_path):
    (tmp_path / "link").symlink_to(folder)
    save_model(Line(np.zeros(9)), tmp_path / "link", TAGS)
    assert (tmp_path / "link").is_symlink()
    assert len(load(folder).slopes) == 9


def test_a_folder_of_other_things_is_not_replaced(tmp_path):
    (tmp_path / "results.csv").write_text("precious")
    with pytest.raises(ModelError, match="not a model folder"):
        save_model(LINE, tmp_path, TAGS)
    assert (tmp_path / "results.csv").read_text() == "precious"


def test_a_folder_that_is_no_model_says_how_to_make_one(tmp_path):
    with pytest.raises(ModelError, match="rampcast train"):
        load(tmp_path)
