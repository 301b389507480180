"""Damage to files, at random: what happens to files on their way, and what programs and people write by mistake."""

import gzip
import io
import re
import zipfile
from collections.abc import Callable
from random import Random

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
STRANGE_NUMBERS = (
    *(b"nan", b"NaN", b"inf", b"-inf", b"Infinity", b"1e400", b"-1e400", b"1e308", b"1e-320", b"-0", b"-0.0", b"0"),
    *(
        b"",
        b" ",
        b"0x1F",
        b"1_000",
        b"1,5",
        b"1.5.5",
        b"--1",
        b"+7",
        b"1e",
        b".",
        b"-",
        b"null",
        b"true",
        b"None",
        b"#N/A",
    ),
    *(b"9" * 40, b"-" + b"9" * 25, b"1" + b"0" * 400, b"0." + b"0" * 400 + b"1", b"2147483648", b"-2147483649", b"128"),
    *(b"9223372036854775808", b"1.0000000000000000000001", b"1e5", b"12:30:00", b"2005-04-13", b"65536", b"32768"),
    *(
        "٣".encode(),
        "１２".encode(),
        "½".encode(),
        "−5".encode(),
        "1\u00a0000".encode(),
        b"\xff",
        b"1;2",
        b"1e15",
        b"0.5",
    ),
)
STRANGE_TEXTS = (
    *(
        b'"',
        b'""',
        b'"""',
        b'"\n"',
        b"'",
        b",",
        b";",
        b"\t",
        b"\0",
        b"\0" * 50,
        b"\r",
        b"\n\n",
        b"\r\n",
        b"\xef\xbb\xbf",
    ),
    *(
        b"\xff\xfe",
        b"\xc3",
        b"<",
        b">",
        b"&",
        b"&amp;",
        b"&#0;",
        b"&#x41;",
        b"&lol;",
        b"<!--",
        b"-->",
        b"<![CDATA[",
        b"]]>",
    ),
    *(
        b"<a>" * 300,
        b"[" * 300,
        b"{" * 300,
        b"]",
        b"}",
        b":",
        b"{}",
        b"[]",
        b"x" * 5000,
        b"\\",
        b"\\u0000",
        b"\\ud800",
        b"/>",
    ),
    *(
        b"</vehicle>",
        b"</timestep>",
        b"<timestep/>",
        b"<person/>",
        "ü".encode(),
        b"\x1b[31m",
        b"\x0b",
        b"\x85",
        b"\x1a",
    ),
)
ENTITIES = b'<!DOCTYPE a [<!ENTITY lol "lol"><!ENTITY lol2 "&lol;&lol;&lol;&lol;&lol;&lol;">]>'


def damaged(content: bytes, random: Random) -> bytes:
    """Returns the content with one to four things wrong with it."""
    for _ in range(random.choice((1, 1, 1, 2, 2, 4))):
        content = random.choice(DAMAGES)(content, random)
    if random.random() < 0.1:
        content = random.choice(ARCHIVES)(content, random)
    return content


def _place(content: bytes, random: Random) -> int:
    return random.randrange(len(content) + 1)


def _inserted(content: bytes, random: Random) -> bytes:
    place = _place(content, random)
    return content[:place] + random.choice(STRANGE_TEXTS) + content[place:]


def _deleted(content: bytes, random: Random) -> bytes:
    place = _place(content, random)
    return content[:place] + content[place + random.choice((1, 1, 2, 10, 100, 1000)) :]


def _replaced(content: bytes, random: Random) -> bytes:
    place, more = _place(content, random), bytes(random.randrange(256) for _ in range(random.choice((1, 1, 4, 20))))
    return content[:place] + more + content[place + len(more) :]


def _bit_flipped(content: bytes, random: Random) -> bytes:
    if not content:
        return b"\x80"
    place = random.randrange(len(content))
    return content[:place] + bytes([content[place] ^ 1 << random.randrange(8)]) + content[place + 1 :]


def _end_flipped(content: bytes, random: Random) -> bytes:
    """Returns the content with a bit of its last kilobyte flipped: there parquet and zip say what is where."""
    return content[:-1000] + _bit_flipped(content[-1000:], random)


def _repeated(content: bytes, random: Random) -> bytes:
    start = _place(content, random)
    piece = content[start : start + random.choice((1, 10, 100, 1000))]
    return content[:start] + piece * random.choice((2, 2, 3, 50)) + content[start + len(piece) :]


def _cut(content: bytes, random: Random) -> bytes:
    return content[: _place(content, random)]


def _begun_late(content: bytes, random: Random) -> bytes:
    return content[_place(content, random) :]


def _lines_moved(content: bytes, random: Random) -> bytes:
    lines = content.split(b"\n")
    one, other = random.randrange(len(lines)), random.randrange(len(lines))
    kind = random.randrange(4)
    if kind == 0:
        lines[one], lines[other] = lines[other], lines[one]
    elif kind == 1:
        lines.insert(other, lines[one])
    elif kind == 2:
        del lines[one]
    else:
        random.shuffle(lines)
    return b"\n".join(lines)


def _number_replaced(content: bytes, random: Random) -> bytes:
    found = list(NUMBER.finditer(content))
    if not found:
        return content
    one, strange = random.choice(found), random.choice(STRANGE_NUMBERS)
    if random.random() < 0.2:  # everywhere
        return content.replace(one[0], strange)
    return content[: one.start()] + strange + content[one.end() :]


def _number_moved(content: bytes, random: Random) -> bytes:
    """Returns the content with a number replaced by another of its numbers: still well-formed, and no longer true."""
    found = list(NUMBER.finditer(content))
    if not found:
        return content
    one, other = random.choice(found), random.choice(found)
    return content[: one.start()] + other[0] + content[one.end() :]


def _word_replaced(content: bytes, random: Random) -> bytes:
    found = list(re.finditer(rb"[A-Za-z_]{2,}", content))
    if not found:
        return content
    one, other = random.choice(found), random.choice(found)
    return content[: one.start()] + random.choice((other[0], b"", b"x", one[0].swapcase())) + content[one.end() :]


def _other_ends(content: bytes, random: Random) -> bytes:
    return content.replace(b"\n", random.choice((b"\r\n", b"\r", b"", b"\n\n", b" ", b"\n ", b"\0\n")))


def _other_separators(content: bytes, random: Random) -> bytes:
    return content.replace(
        random.choice((b",", b";", b" ", b'"')), random.choice((b",", b";", b"\t", b" ", b'"', b"'", b""))
    )


def _other_encoding(content: bytes, random: Random) -> bytes:
    return content.decode("latin-1").encode(
        random.choice(("utf-16", "utf-8-sig", "utf-32-le", "utf-16-be", "cp500")), "replace"
    )


def _with_entities(content: bytes, random: Random) -> bytes:
    place = content.find(b"<", content.find(b"?>"))
    return content[:place] + ENTITIES + _number_replaced(content[place:], random).replace(b"1", b"&lol2;", 1)


def _long_line(content: bytes, random: Random) -> bytes:
    place = _place(content, random)
    return content[:place] + random.choice((b"1", b" ", b"a", b"1,", b'"', b"\0")) * 70_000 + content[place:]


def _nested(content: bytes, random: Random) -> bytes:
    deep, (opening, closing) = (
        random.choice((10, 2_000)),
        random.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"<a>", b"</a>"))),
    )
    start = _place(content, random)
    end = random.randrange(start, len(content) + 1)
    return content[:start] + opening * deep + content[start:end] + closing * deep + content[end:]


def _gzipped(content: bytes, random: Random) -> bytes:
    packed = gzip.compress(content, mtime=0)
    return random.choice(
        (packed, _cut(packed, random), _bit_flipped(packed, random), packed + packed, packed + b"more")
    )


def _zipped(content: bytes, random: Random) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", random.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for number in range(random.choice((1, 1, 1, 2))):
            archive.writestr(
                zipfile.ZipInfo(f"data{number}{random.choice(('.csv', '.txt', '.json', '.xml', '.doc'))}"), content
            )
    packed = buffer.getvalue()
    return random.choice((packed, _cut(packed, random), _bit_flipped(packed, random), _end_flipped(packed, random)))


Damage = Callable[[bytes, Random], bytes]
DAMAGES: tuple[Damage, ...] = (
    *(
        _inserted,
        _inserted,
        _deleted,
        _replaced,
        _bit_flipped,
        _end_flipped,
        _repeated,
        _cut,
        _begun_late,
        _lines_moved,
    ),
    *(
        _number_replaced,
        _number_replaced,
        _number_replaced,
        _number_moved,
        _number_moved,
        _word_replaced,
        _word_replaced,
    ),
    *(_other_ends, _other_separators, _other_encoding, _with_entities, _long_line, _nested),
)
ARCHIVES: tuple[Damage, ...] = (_gzipped, _zipped)
