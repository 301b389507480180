"""Elements of one huge json array, one after the other: the text is never in memory as a whole.

Elements are objects, arrays or texts; a bare number could be cut in two where a part of the text ends.
"""

import codecs
import json
import re
from collections.abc import Iterator
from io import BufferedIOBase
from pathlib import Path
from typing import Any

from rampcast.errors import FormatError
from rampcast.formats.files.sources import DAMAGED, open_source

CHUNK = 1 << 20  # [letters] of the text that are read together
LARGEST = 64 << 20  # [letters] of one element; a vehicle of I-24 MOTION has some 100,000
FAR_BEHIND = 64 << 10  # [letters] that follow a fault: with fewer it may be where the text read so far ends
SPACES = re.compile(r"[ \t\r\n]*")
DECODER = json.JSONDecoder()


def read_array(path: Path, *, element: str) -> Iterator[tuple[str, Any]]:
    """Yields (name of the file for messages, element) for each element of the array that the file is.

    Args:
        path: of the json file, plain or in a .gz or .zip.
        element: what one is, for messages: "vehicle".

    Raises:
        FormatError: the file is not there, is no array, or is malformed or cut off; elements before that are yielded.
    """
    with open_source(path) as (name, stream):
        text = _Text(name, stream, element)
        text.expect_start()
        while text.has_more():
            yield name, text.element()
        text.expect_end()


class _Text:
    """The part of a text that is in memory, and a place in it."""

    def __init__(self, name: str, stream: BufferedIOBase, element: str) -> None:
        self.name = name
        self.word = element
        self.count = 0  # elements so far
        self.buffer = ""
        self.place = 0
        self.is_whole = False  # whether all of the file has been read
        self._stream = stream
        self._decoder = codecs.getincrementaldecoder("utf-8-sig")()

    def expect_start(self) -> None:
        """Goes past the bracket with which an array begins."""
        if self._next() != "[":
            what = f"it begins with '{self._next()}'" if self._next() else "it is empty"
            raise FormatError(f"{self.name}: expected one json array ('[' ... ']') of {self.word}s, but {what}")
        self.place += 1

    def has_more(self) -> bool:
        """Returns whether an element follows, and goes to its beginning."""
        if self._next() == "]":
            return False
        if self.count:
            self._expect(",", f"',' or ']' behind {self.word} {self.count}")
            self.place += 1
        self._expect_any(f"{self.word} {self.count + 1}")
        return True

    def element(self) -> Any:
        """Returns the element that begins here, and goes past it."""
        while True:
            try:
                value, place = DECODER.raw_decode(self.buffer, self.place)
            except json.JSONDecodeError as error:
                if self.is_whole or error.pos < len(self.buffer) - FAR_BEHIND:
                    raise self._malformed(error.msg, error.pos) from error
                self._read(max(CHUNK, len(self.buffer) - self.place))
            except (ValueError, RecursionError) as error:  # a number of thousands of digits, brackets in brackets
                raise self._malformed(str(error), self.place) from error
            else:
                self.place = place
                self.count += 1
                return value
            if len(self.buffer) - self.place > LARGEST:
                raise self._malformed(f"more than {LARGEST:,} letters without an end", self.place)

    def expect_end(self) -> None:
        """Checks that nothing follows the array."""
        self.place += 1
        if self._next():
            raise FormatError(
                f"{self.name}: expected the file to end behind the array of {self.count:,} {self.word}s, found "
                f"'{self.buffer[self.place : self.place + 20]}'. Give each array as a file of its own"
            )

    def _next(self) -> str:
        """Returns the next letter that is no space, and goes to it; "" at the end of the file."""
        while True:
            spaces = SPACES.match(self.buffer, self.place)
            self.place = spaces.end() if spaces else self.place
            if self.place < len(self.buffer):
                return self.buffer[self.place]
            if self.is_whole:
                return ""
            self._read(CHUNK)

    def _expect(self, letter: str, what: str) -> None:
        self._expect_any(what)
        if self._next() != letter:
            raise self._malformed(f"expected {what}", self.place)

    def _expect_any(self, what: str) -> None:
        if not self._next():
            raise self._malformed(f"expected {what}", self.place)

    def _read(self, letters: int) -> None:
        """Reads so many more letters, or to the end of the file; forgets what lies before the place."""
        try:
            read = self._stream.read(letters)
            more = self._decoder.decode(read, final=not read)
        except UnicodeDecodeError as error:
            raise FormatError(
                f"{self.name}: bytes that are no text behind {self.word} {self.count}: {error.reason}; get it again"
            ) from error
        except DAMAGED as error:
            reason = f"the archive is damaged or cut off ({error})"
            raise FormatError(f"{self.name}: {reason}; get the file again") from error
        self.is_whole = not read
        self.buffer = self.buffer[self.place :] + more
        self.place = 0

    def _malformed(self, reason: str, place: int) -> FormatError:
        if self.is_whole and (place >= len(self.buffer.rstrip()) or reason.startswith("Unterminated string")):
            return FormatError(
                f"{self.name}: the file is cut off in or behind {self.word} {self.count + 1}; get it again"
            )
        found = self.buffer[place : place + 20]
        return FormatError(
            f"{self.name}, {self.word} {self.count + 1}: malformed json: {reason}, found '{found}'; get the file again"
        )
