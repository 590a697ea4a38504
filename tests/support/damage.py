"""Damage: random changes of files, the same ones for the same seed.

Files in a container (gzip, ZIP, XZ in ZIP) are changed as they lie on the disk, or within: the
content is changed and packed again, with the right check sums, so that readers see what is behind
them. Entries of ZIP are packed in other ways than before, too.
"""

from __future__ import annotations

import gzip
import io
import lzma
import re
import struct
import zipfile
from collections.abc import Callable, Sequence
from random import Random

EXTREMES = tuple(
    struct.pack(form, value)
    for form, values in (
        ("<B", (0, 1, 127, 128, 255)),
        ("<H", (0, 1, 0x7FFF, 0xFFFF)),
        ("<I", (0, 1, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)),
        ("<Q", (0, 1, 0xFFFFFFFF, 1 << 62, (1 << 63) - 1, (1 << 64) - 1)),
        ("<f", (0.0, -1.0, 1e30, -1e30, float("inf"), float("nan"))),
    )
    for value in values
)
"""Numbers that lengths, counts and ranges may be set to."""
TEXTS = (
    *(b"0", b"-1", b"1", b"7", b"100000000", b"4294967296", b"1000000000000"),
    *(b"999999999999999999", b"99999999999999999999", b"1e30", b"1e400", b"nan", b"x"),
)
"""Words that numbers of a text may be set to."""
HEADER = 160
"""Bytes at the beginning that are changed as often as all the rest."""
LONGEST = 4096
"""Bytes that are inserted, removed or overwritten at once, at most."""
PACKED = 0.6
"""Share of the changes of a container that are made to its content."""
METHODS = (*[zipfile.ZIP_STORED] * 4, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA)
"""How an entry of a ZIP is packed again."""
GZIP, ZIP, XZ = b"\x1f\x8b", b"PK\x03\x04", b"\xfd7zXZ\0"
WHOLE = re.compile(rb"(?<![\w.-])[1-9]\d{0,17}(?![\w.])")
"""Whole numbers of a text that may be lengths."""
VALUE = re.compile(rb'(?<=":)\s*(\[[^\[\]{}]*\]|"[^"]*"|[\w.+-]+)')
VALUES = (b"5", b"-0.5", b"null", b"true", b'"x"', b"[]", b"[[1]]", b"{}", b"1e999", b"[null]")
"""Values of a JSON of every type."""
STRETCHED = 40_000
"""Length of a run of one character: a parser that is quadratic in it takes longer than it may."""
COUNTED = 1 << 20
"""Numbers of four bytes from 1 to this are taken for lengths and counts."""
NAME = re.compile(rb"[A-Za-z_][\w./-]{2,}")
"""Words of a text that may be names of files, cameras or settings."""
FOREIGN_NAMES = (
    b"../outside.png", b"../../../../etc/passwd", b"/etc/passwd", b"/dev/zero", b"/dev/full", b"~",
    b"CON", b"nul.png", b"C:/a.png", b"\\\\host\\a", b"", b".", b"..", b"a/../a", b"x" * 5000,
    b"a\\u0000b", b"a\0b", "\u00e4\u4e2d.png".encode(), b"\\ud800", b"\xff\xfe", b"%n%s", b" ",
    b"-", b"*",
)  # fmt: skip
"""Names that leave the folder, that no system has, or that only some have."""

Change = Callable[[Random, bytes, Sequence[bytes]], bytes]


def damaged(whole: bytes, others: Sequence[bytes], seed: int) -> bytes:
    """A file with one to three changes.

    Args:
        whole: the sound file.
        others: further sound files, of which parts may be taken.
        seed: names the changes.
    """
    random = Random(seed)
    if random.random() < PACKED:
        try:
            packed = _damaged_within(random, whole, others)
        except Exception:  # It was damaged before, so that it is no container any more.
            packed = None
        if packed is not None:
            return packed if random.random() < PACKED else _changed(random, packed, others)
    return _changed(random, whole, others)


def renamed(random: Random, whole: bytes) -> bytes:
    """A file with another name in place of one that it holds, once or everywhere."""
    names = list(NAME.finditer(whole[: 4 * LONGEST]))
    if not names:
        return _changed(random, whole, [])
    found, other = random.choice(names), random.choice(FOREIGN_NAMES)
    if random.random() < 0.3:
        return whole.replace(found[0], other)
    return whole[: found.start()] + other + whole[found.end() :]


def _damaged_within(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes | None:
    """A container with a changed content; ``None`` if the file is none."""
    if whole.startswith(GZIP):
        return gzip.compress(_changed(random, gzip.decompress(whole), others), 1, mtime=0)
    if not whole.startswith(ZIP):
        return None
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    chosen = random.choice(sorted(members))
    if random.random() < 0.05:
        del members[chosen]
    else:
        changed = _changed_member(random, members[chosen], [*others, *members.values()])
        members[chosen] = changed
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content, random.choice(METHODS) if name == chosen else None)
    return made.getvalue()


def _changed_member(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    if not whole.startswith(XZ) or random.random() > PACKED:
        return _changed(random, whole, others)
    return lzma.compress(_changed(random, lzma.decompress(whole), others), preset=0)


def _changed(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    for _ in range(random.choice((1, 1, 2, 3))):
        whole = random.choice(CHANGES)(random, whole, others)
    return whole


def _place(random: Random, whole: bytes) -> int:
    """A place in a file, half of the time in its header."""
    end = min(HEADER, len(whole)) if random.random() < 0.5 else len(whole)
    return random.randrange(end) if end else 0


def _cut(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    return whole[: _place(random, whole)]


def _flip_bits(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    content = bytearray(whole)
    for _ in range(random.randint(1, 8) if content else 0):
        content[_place(random, whole)] ^= 1 << random.randrange(8)
    return bytes(content)


def _overwrite(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    place, length = _place(random, whole), random.randint(1, min(LONGEST, len(whole) + 1))
    run = random.choice((b"\x00" * length, b"\xff" * length, random.randbytes(length)))
    return whole[:place] + run[: len(whole) - place] + whole[place + length :]


def _other_mark(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    length = random.choice((2, 4, 8))
    mark = random.choice([random.randbytes(length), *(other[:length] for other in others)])
    return mark + whole[length:]


def _extreme(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    number, place = random.choice(EXTREMES), _place(random, whole)
    place -= place % random.choice((1, 2, 4))
    return whole[:place] + number + whole[place + len(number) :]


def _extreme_text(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    numbers = list(re.finditer(rb"-?\d+(\.\d+)?", whole[:LONGEST]))
    if not numbers:
        return _extreme(random, whole, others)
    found = random.choice(numbers)
    return whole[: found.start()] + random.choice(TEXTS) + whole[found.end() :]


def _agreeing(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    """Every occurrence of a number set to the same other one: lengths that agree, and lie."""
    numbers = sorted(set(WHOLE.findall(whole[:LONGEST])))
    if numbers and random.random() < 0.7:
        number = re.compile(rb"(?<![\w.])" + random.choice(numbers) + rb"(?![\w.])")
        text = random.choice(TEXTS)
        return number.sub(text, whole[:LONGEST]) + whole[LONGEST:]
    counts = {whole[place : place + 4] for place in range(0, min(HEADER, len(whole)) - 3, 4)}
    found = sorted(held for held in counts if 0 < int.from_bytes(held, "little") <= COUNTED)
    if not found:
        return _extreme(random, whole, others)
    other = random.choice((2, 1000, 10**6, 10**8, 2**31 - 1, 2**32 - 1))
    return whole.replace(random.choice(found), struct.pack("<I", other))


def _scaled(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    """All whole numbers of a text times the same factor: lengths of different sizes that agree."""
    factor = random.choice((2, 1000, 10**6, 4 * 10**9))
    begin = whole[:LONGEST]
    scaled = WHOLE.sub(lambda found: b"%d" % (int(found[0]) * factor), begin)
    return scaled + whole[LONGEST:] if scaled != begin else _agreeing(random, whole, others)


def _other_value(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    """A value of a JSON replaced by one of another type, of the same length if that is possible."""
    found = list(VALUE.finditer(whole[: 4 * LONGEST]))
    if not found:
        return _lines(random, whole, others)
    value = random.choice(found)
    other = random.choice(VALUES).ljust(value.end() - value.start())
    return whole[: value.start()] + other + whole[value.end() :]


def _stretch(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    """A long run of one character, over which a parser may go again and again."""
    place, character = _place(random, whole), random.choice((b" ", b"\n", b"[", b"9", b"\0"))
    return whole[:place] + character * STRETCHED + whole[place:]


def _lines(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    lines = whole[:LONGEST].split(b"\n")
    first, second = random.randrange(len(lines)), random.randrange(len(lines))
    match random.randrange(3):
        case 0:
            lines[first], lines[second] = lines[second], lines[first]
        case 1:
            del lines[first]
        case 2:
            lines.insert(first, lines[second])
    return b"\n".join(lines) + whole[LONGEST:]


def _splice(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    source = random.choice([whole, *others])
    start = _place(random, source)
    part = source[start : start + random.randint(1, LONGEST)]
    place = _place(random, whole)
    removed = random.choice((0, len(part), random.randint(0, LONGEST)))
    return whole[:place] + part + whole[place + removed :]


def _append(random: Random, whole: bytes, others: Sequence[bytes]) -> bytes:
    return whole + random.randbytes(random.choice((1, 3, 16, 1000)))


CHANGES: tuple[Change, ...] = (
    _cut, _flip_bits, _overwrite, _other_mark, _extreme, _extreme, _extreme_text, _agreeing,
    _agreeing, _scaled, _stretch, _other_value, _other_value, _lines, _splice, _append,
)  # fmt: skip
