"""One huge json array is read element by element, wherever the text is cut into chunks, and every fault has a place."""

import gzip
import json
import re
import tracemalloc

import pytest

from rampcast.errors import FormatError
from rampcast.formats.files import json_array
from rampcast.formats.files.json_array import read_array

ELEMENTS = [{"a": [1.5, 2, None], "b": {"c": 'é, ] } " \\ ['}}, [], "text", {}, [[[-3.25e-7]]]]


def elements(content: bytes, tmp_path) -> list:
    path = tmp_path / "vehicles.json"
    path.write_bytes(content)
    return [value for _, value in read_array(path, element="vehicle")]


@pytest.mark.parametrize("indent", [None, 1, "\t\r\n  "])
@pytest.mark.parametrize("chunk", [1, 2, 7, 1 << 20])
def test_elements_are_the_same_however_the_text_is_cut(indent, chunk, tmp_path, monkeypatch):
    monkeypatch.setattr(json_array, "CHUNK", chunk)
    content = json.dumps(ELEMENTS, indent=indent, ensure_ascii=False).encode()
    assert elements(content, tmp_path) == ELEMENTS


def test_an_empty_array_a_byte_order_mark_and_spaces_are_no_obstacle(tmp_path):
    assert elements(b"\xef\xbb\xbf \n[ ]\n ", tmp_path) == []
    assert elements(gzip.compress(b'[{"a": 1}]'), tmp_path) == [{"a": 1}]


FAULTS = {
    "empty": (b"", "expected one json array ('[' ... ']') of vehicles, but it is empty"),
    "spaces": (b" \n ", "but it is empty"),
    "an object": (b'{"a": 1}', "but it begins with '{'"),
    "lines of objects": (b'{"a": 1}\n{"a": 2}\n', "but it begins with '{'"),
    "prose": (b"Dear reader", "but it begins with 'D'"),
    "cut off behind the bracket": (b"[", "the file is cut off in or behind vehicle 1"),
    "cut off in an element": (b'[{"a": 1}, {"b": [1, 2', "the file is cut off in or behind vehicle 2"),
    "cut off behind an element": (b'[{"a": 1}', "the file is cut off in or behind vehicle 2"),
    "cut off behind a comma": (b'[{"a": 1},', "the file is cut off in or behind vehicle 2"),
    "no comma": (b'[{"a": 1} {"b": 2}]', "vehicle 2: malformed json: expected ',' or ']' behind vehicle 1, found '{"),
    "a comma too many": (b'[{"a": 1},]', "vehicle 2: malformed json: Expecting value, found ']'"),
    "a key without quotes": (b"[{a: 1}]", "vehicle 1: malformed json: Expecting property name"),
    "a value missing": (b'[{"a": }]', "vehicle 1: malformed json: Expecting value, found '}]'"),
    "a control character": (b'[{"a": "\x01"}]', "vehicle 1: malformed json: Invalid control character"),
    "two arrays": (b"[1] [2]", "expected the file to end behind the array of 1 vehicles, found '[2]'"),
    "bytes that are no text": (b'[{"a": "\xff\xfe"}]', "bytes that are no text behind vehicle 0"),
    "brackets in brackets": (b"[" * 200_000, "vehicle 1: malformed json: maximum recursion depth"),
    "a number of 5000 digits": (b"[" + b"1" * 5000 + b"]", "vehicle 1: malformed json: Exceeds the limit"),
    "a damaged archive": (gzip.compress(b"[1, 2, 3]")[:-9], "the archive is damaged or cut off"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_of_the_text_names_the_file_and_the_element(fault, tmp_path):
    content, message = FAULTS[fault]
    with pytest.raises(FormatError, match=rf"vehicles\.json.*{re.escape(message)}"):
        elements(content, tmp_path)


def test_an_element_without_an_end_is_not_gathered_for_ever(tmp_path, monkeypatch):
    monkeypatch.setattr(json_array, "LARGEST", 100_000)
    monkeypatch.setattr(json_array, "CHUNK", 10_000)
    with pytest.raises(FormatError, match="vehicle 1: malformed json: more than 100,000 letters without an end"):
        elements(b"[[" + b"1," * 1_000_000, tmp_path)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(json_array, "CHUNK", 1 << 16)
    path = tmp_path / "vehicles.json"
    peaks = []
    for count in (200, 2000):
        path.write_text(json.dumps([{"a": list(range(500))}] * count))
        tracemalloc.start()
        assert sum(1 for _ in read_array(path, element="vehicle")) == count
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]
