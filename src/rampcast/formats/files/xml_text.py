"""Text of xml: the element that a file begins with, found before any parser sees the file.

What stands before it may be a declaration and comments. A document type, which could define entities that grow without
bound or name files to fetch, is not accepted: with none of its own, a file has only the five entities of xml.
"""

import re
from dataclasses import dataclass
from typing import Any

from rampcast.errors import FormatError

BEFORE = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s|<\?.*?\?>|<!--.*?-->)*", re.DOTALL)
# Possessive (*+): where no > ends it, no shorter name is tried, which would take the square of its length.
START_TAG = re.compile(rb"""<([A-Za-z_][\w.:-]*+)(?:[^<>"']|"[^"<]*"|'[^'<]*')*+>""")
ENCODING = re.compile(rb"""<\?xml[^>]*encoding\s*=\s*["']([^"']*)""")
LONGEST = 200  # letters of a parser's reason: it names elements, however long their names are
SHOWN = 40  # letters of an element's name that a message shows
PLAIN_ENCODINGS = ("utf-8", "utf8", "us-ascii", "ascii")


@dataclass(frozen=True)
class Root:
    """The start tag of a file's outermost element: its name, where it ends, and whether the text is UTF-8."""

    name: str
    end: int
    is_utf8: bool

    @property
    def shown(self) -> str:
        """Returns its name as messages show it, however long it is."""
        return f"<{self.name[:SHOWN]}>"


def find_root(text: bytes) -> Root | None:
    """Returns the outermost element of an xml file that begins with the text; None if it does not begin so."""
    before = BEFORE.match(text)
    tag = START_TAG.match(text, before.end()) if before else None
    if tag is None:
        return None
    encoding = ENCODING.match(text.removeprefix(b"\xef\xbb\xbf"))
    is_utf8 = encoding is None or encoding[1].decode("latin-1").lower() in PLAIN_ENCODINGS
    return Root(tag[1].decode("latin-1"), tag.end(), is_utf8)


def expect_root(name: str, text: bytes, wanted: str) -> Root:
    """Returns the outermost element of an xml file.

    Args:
        name: of the file, for messages.
        text: its beginning.
        wanted: name of the element.

    Raises:
        FormatError: the file does not begin with it.
    """
    before, _, _ = text.partition(b"<" + wanted.encode())
    if b"<!DOCTYPE" in before:
        raise FormatError(f"{name}: it has a document type (<!DOCTYPE ...>), which these files have not; remove it")
    root = find_root(text)
    if root is None or root.name != wanted:
        found = f"found {root.shown}" if root else "found no start of an element"
        raise FormatError(f"{name}: expected xml whose outermost element is <{wanted}>, {found}")
    return root


def first_error(parser: Any, error: Any) -> tuple[int, str]:
    """Returns line and reason of the first thing that a feed parser of lxml did not like; it raised `error`."""
    entry = next(iter(parser.feed_error_log), None)
    line, reason = (error.lineno or 0, error.msg) if entry is None else (entry.line, entry.message)
    return line, " ".join(reason.split())[:LONGEST]
