"""Changes of files that know something: numbers in headers, JSON, members of archives, rows of databases."""

from __future__ import annotations

import io
import json
import random
import re
import sqlite3
import struct
import warnings
import zipfile
from collections.abc import Callable, Sequence

Files = dict[str, bytes]
Change = Callable[[random.Random, bytes, bytes], bytes]
MOST_BYTES = 200_000

_HEAD = 600
_TOKEN = re.compile(rb"[^\s,;:=\[\]{}()\"'<>]+")
_NUMBERS = [
    *(b"-1 0 1 2 3 7 255 256 65535 65536 2147483647 2147483648 4294967295 4294967296 -2147483649").split(),
    *(b"9223372036854775807 9223372036854775808 18446744073709551615 18446744073709551616 1e10 1e30 -1e30").split(),
    *(
        b"1e308 1e309 5e-324 nan NaN -nan inf -inf Infinity -1.#IND 1.#QNAN 0x10 1_000 1,5 1d5 +5 -0 .5 5. 1e 1e400"
    ).split(),
    *(b"True False None null true 1j 0.1f 1/2 1.2.3 ** ~ ? - . e").split(),
    b"10000000000000000000000",
    b"9" * 400,
    b"9" * 5000,
    "١٢".encode(),
    "1\u00a02".encode(),
    "²".encode(),
    b"",
]
_WORDS = [
    b"#",
    b"//",
    b"%",
    b"\x00",
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b'"',
    b"'",
    b"\t",
    b"\r",
    b"\x1b[2J",
    b"\x0c",
    b" ",
    b",",
]
_WORDS += [
    b";",
    b"|",
    b"\n",
    b"\r\n",
    b"\x85",
    "\u2028".encode(),
    b"\x1a",
    b"../..",
    b"/",
    b"%s%n",
    b"A" * 3000,
    b"NULL",
]
_INTEGERS = [0, 1, 2, 3, 7, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 10**6, 10**8, 2**31 - 1, 2**31, 2**32 - 1, 2**32]
_INTEGERS += [2**40, 2**48, 2**61, 2**62, 2**63 - 1, 2**63, 2**64 - 1]
_FLOATS = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e30,
    1e300,
    -1e300,
    5e-324,
    float("nan"),
    float("inf"),
    float("-inf"),
    1e-300,
    2.0**53,
]


def mutated(rng: random.Random, files: Files, other: Files, aware: Sequence[Change] = ()) -> Files:
    """The files with one to five changes of one of them; `other` holds another input, to splice from."""
    files = dict(files)
    name = rng.choice(sorted(files))
    given = other.get(name) or next(iter(other.values()))
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 5))):
        change = rng.choice(aware) if aware and rng.random() < 0.6 else rng.choice(BYTES)
        files[name] = change(rng, files[name], given)[:MOST_BYTES]
    if len(files) > 1 and rng.random() < 0.05:
        del files[name]
    return files


# --- bytes -------------------------------------------------------------------------------------


def _place(rng: random.Random, content: bytes) -> int:
    """Somewhere in the content, as often as not in its head."""
    most = min(len(content), _HEAD) if rng.random() < 0.5 else len(content)
    return rng.randrange(most) if most else 0


def _put(content: bytes, place: int, new: bytes) -> bytes:
    return content[:place] + new + content[place + len(new) :]


def flip_bit(rng: random.Random, content: bytes, other: bytes) -> bytes:
    if not content:
        return content
    place = _place(rng, content)
    return _put(content, place, bytes([content[place] ^ (1 << rng.randrange(8))]))


def set_byte(rng: random.Random, content: bytes, other: bytes) -> bytes:
    return _put(
        content, _place(rng, content), bytes([rng.choice((0, 1, 9, 10, 32, 127, 128, 255, rng.randrange(256)))])
    )


def set_integer(rng: random.Random, content: bytes, other: bytes) -> bytes:
    size, place = rng.choice((1, 2, 4, 4, 8, 8)), _place(rng, content)
    if rng.random() < 0.5:
        place -= place % size
    value = rng.choice(_INTEGERS) if rng.random() < 0.8 else rng.getrandbits(64)
    return _put(content, place, (value % 2 ** (8 * size)).to_bytes(size, rng.choice(("little", "little", "big"))))


def set_number_beside(rng: random.Random, content: bytes, other: bytes) -> bytes:
    """An integer that is there, off by a little or a factor."""
    size, place = rng.choice((1, 2, 4, 8)), _place(rng, content)
    order = rng.choice(("little", "little", "big"))
    value = int.from_bytes(content[place : place + size].ljust(size, b"\0"), order)
    value = rng.choice((value + 1, value - 1, value * 2, value * 1000, -value, value << 8, value >> 1))
    return _put(content, place, (value % 2 ** (8 * size)).to_bytes(size, order))


def set_float(rng: random.Random, content: bytes, other: bytes) -> bytes:
    kind, place, value = rng.choice(("<f", ">f", "<d", ">d")), _place(rng, content), rng.choice(_FLOATS)
    if kind.endswith("f") and 3e38 < abs(value) < float("inf"):
        value = 3e38
    return _put(content, place, struct.pack(kind, value))


def truncate(rng: random.Random, content: bytes, other: bytes) -> bytes:
    return content[: rng.randrange(len(content) + 1)] if rng.random() < 0.5 else content[: -rng.randrange(1, 20)]


def insert(rng: random.Random, content: bytes, other: bytes) -> bytes:
    place = _place(rng, content)
    new = rng.choice((rng.randbytes(rng.randrange(1, 9)), bytes(rng.randrange(1, 64)), rng.choice(_WORDS)))
    return content[:place] + new + content[place:]


def _block(rng: random.Random, content: bytes) -> tuple[int, int]:
    start = _place(rng, content)
    return start, start + rng.choice((1, 2, 4, 8, 16, 60, 300))


def delete_block(rng: random.Random, content: bytes, other: bytes) -> bytes:
    start, end = _block(rng, content)
    return content[:start] + content[end:]


def repeat_block(rng: random.Random, content: bytes, other: bytes) -> bytes:
    start, end = _block(rng, content)
    return content[:end] + content[start:end] * rng.choice((1, 1, 1, 2, 50)) + content[end:]


def copy_block(rng: random.Random, content: bytes, other: bytes) -> bytes:
    start, end = _block(rng, content)
    return _put(content, _place(rng, content), content[start:end])


def clear_block(rng: random.Random, content: bytes, other: bytes) -> bytes:
    start, end = _block(rng, content)
    return _put(content, start, rng.choice((b"\0", b"\xff", b" ")) * len(content[start:end]))


def splice(rng: random.Random, content: bytes, other: bytes) -> bytes:
    if rng.random() < 0.5:
        cut = rng.random()
        return content[: int(cut * len(content))] + other[int(cut * len(other)) :]
    start, end = _block(rng, other)
    return _put(content, _place(rng, content), other[start:end])


def append(rng: random.Random, content: bytes, other: bytes) -> bytes:
    return content + rng.choice((other, content, b"\0" * 100, b"\n", rng.randbytes(30)))


BYTES: Sequence[Change] = (
    flip_bit,
    set_byte,
    set_integer,
    set_integer,
    set_number_beside,
    set_float,
    truncate,
    insert,
    delete_block,
    repeat_block,
    copy_block,
    clear_block,
    splice,
    append,
)


# --- text --------------------------------------------------------------------------------------


def set_token(rng: random.Random, content: bytes, other: bytes) -> bytes:
    """A word or number of the head, or of the whole text, replaced by an odd number or by another word."""
    head = content[:_HEAD] if b"\0" in content[:2000] or rng.random() < 0.7 else content[:20_000]
    tokens = list(_TOKEN.finditer(head))
    if not tokens:
        return content
    numbers = [token for token in tokens if token[0][-1:].isdigit()]
    token = rng.choice(numbers if numbers and rng.random() < 0.7 else tokens)
    new = rng.choice(_NUMBERS) if rng.random() < 0.8 else rng.choice(tokens)[0]
    return content[: token.start()] + new + content[token.end() :]


def change_line(rng: random.Random, content: bytes, other: bytes) -> bytes:
    """A line that is repeated, missing, moved, of the other file, or odd."""
    lines, lines_of_other = content.split(b"\n"), other.split(b"\n")
    place = rng.randrange(min(len(lines), 40) if rng.random() < 0.7 else len(lines))
    what = rng.randrange(6)
    if what == 0:
        lines[place : place + 1] = [lines[place]] * rng.choice((2, 2, 3, 200))
    elif what == 1:
        del lines[place]
    elif what == 2:
        other_place = rng.randrange(len(lines))
        lines[place], lines[other_place] = lines[other_place], lines[place]
    elif what == 3:
        lines.insert(place, rng.choice(lines_of_other))
    elif what == 4:
        lines.insert(place, rng.choice(_WORDS) + rng.choice(_NUMBERS))
    else:
        lines[place] = lines[place].replace(rng.choice((b" ", b",", b"\n", b";")), rng.choice(_WORDS))
    return b"\n".join(lines)


def insert_word(rng: random.Random, content: bytes, other: bytes) -> bytes:
    place = _place(rng, content)
    return content[:place] + rng.choice((rng.choice(_WORDS), b" " + rng.choice(_NUMBERS) + b" ")) + content[place:]


def change_line_ends(rng: random.Random, content: bytes, other: bytes) -> bytes:
    return content.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b" ")))


TEXT: Sequence[Change] = (set_token, set_token, set_token, change_line, insert_word, change_line_ends)


# --- JSON --------------------------------------------------------------------------------------

_VALUES = [
    None,
    True,
    False,
    0,
    1,
    -1,
    2**31,
    2**63,
    10**30,
    1e300,
    0.5,
    float("nan"),
    float("inf"),
    "",
    "x",
    "1",
    "NaN",
]
_VALUES += [
    [],
    {},
    [0],
    [[]],
    [-1, 4],
    [10**18, 4],
    [0, 4],
    [4, 0],
    [1e3, 4],
    ["4", 4],
    [None],
    [True, 4],
    {"name": "x"},
]
_VALUES += [
    "<f8",
    "<i2",
    "|O",
    "|V8",
    "<M8[s]",
    "float64",
    "complex128",
    "\x1b[2J",
    "a\nb",
    "../../x",
    "\x00",
    "A" * 3000,
]


def change_json(rng: random.Random, content: bytes, other: bytes) -> bytes:
    """A value somewhere in JSON, or in a line of JSON, replaced, removed, wrapped or nested deeply."""
    lines = content.split(b"\n")
    whole = _parsed(content)
    place = 0 if whole is not None else rng.randrange(len(lines))
    value = whole if whole is not None else _parsed(lines[place])
    if value is None:
        return set_token(rng, content, other)
    if rng.random() < 0.03:
        text = rng.choice((b"[", b'{"a":')) * rng.choice((100, 2000, 60_000))
    else:
        text = json.dumps(_changed(rng, value)).encode()
    if whole is not None:
        return text
    lines[place] = text
    return b"\n".join(lines)


def _parsed(text: bytes) -> object:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _changed(rng: random.Random, value: object) -> object:
    keys: list = list(value) if isinstance(value, dict) else list(range(len(value))) if isinstance(value, list) else []
    if not keys or rng.random() < 0.15:
        return rng.choice(_VALUES) if not isinstance(value, dict) or rng.random() < 0.3 else value | {"x": 1}
    key = rng.choice(keys)
    if rng.random() < 0.15:
        del value[key]
    else:
        value[key] = _changed(rng, value[key]) if rng.random() < 0.6 else rng.choice(_VALUES)
    return value


JSON: Sequence[Change] = (change_json, change_json, change_json, set_token)


# --- archives and databases --------------------------------------------------------------------


def change_member(rng: random.Random, content: bytes, other: bytes) -> bytes:
    """A member of a zip file changed, renamed, doubled or missing; lengths and checksums fit again."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = [(name, archive.read(name)) for name in archive.namelist()]
    except Exception:
        return flip_bit(rng, content, other)
    if not members:
        return content
    place = rng.randrange(len(members))
    name, body = members[place]
    what = rng.randrange(8)
    if what < 5:
        change = rng.choice((*TEXT, *BYTES) if what < 3 else (set_token,))
        members[place] = name, change(rng, body, members[0][1])[:MOST_BYTES]
    elif what == 5:
        members[place] = (
            rng.choice(("x.npy", "points", "", "../a.npy", name.upper(), "points.npy.npy", "weights.npy")),
            body,
        )
    elif what == 6:
        members.insert(place, (name, members[0][1]))
    else:
        del members[place]
    buffer = io.BytesIO()
    with (
        warnings.catch_warnings(action="ignore"),  # of names that come twice
        zipfile.ZipFile(buffer, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive,
    ):
        for name, body in members:
            archive.writestr(zipfile.ZipInfo(name or "a"), body)
    return buffer.getvalue()


_SQL_VALUES = [
    "NULL",
    "-1",
    "0",
    "1",
    "2147483648",
    "9223372036854775807",
    "1e300",
    "'x'",
    "x''",
    "x'00'",
    "x'ffffffff'",
]
_SQL_VALUES += ["zeroblob(16)", "zeroblob(60000)", "randomblob(32)", "'1'", "0.5", "'\x1b[2J'"]


def change_rows(rng: random.Random, content: bytes, other: bytes) -> bytes:
    """A value, table or index of an SQLite database that stays whole."""
    database = sqlite3.connect(":memory:")
    try:
        database.deserialize(content)
        database.text_factory = lambda text: text.decode("utf-8", "replace")
        tables = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = rng.choice([name for name in tables if not name.startswith("sqlite_")])
        columns = [row[1] for row in database.execute(f"PRAGMA table_info({table})")]
        column, value = rng.choice(columns), rng.choice(_SQL_VALUES)
        count = rng.choice((1000, 10**9))
        endless = f"WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT {count})"
        listed = ", ".join(columns)
        large = ", ".join(f"zeroblob(900000000) AS {name}" if name == column else name for name in columns)
        statements = rng.choice(
            (
                [f"UPDATE {table} SET {column} = {value}"],
                [f"UPDATE {table} SET {column} = {value}"],
                [f"UPDATE {table} SET {column} = {column} + {rng.choice((1, -1, 10**9))}"],
                [f"DELETE FROM {table}"],
                [f"DROP TABLE {table}"],
                [f"ALTER TABLE {table} DROP COLUMN {column}"],
                [f"ALTER TABLE {table} RENAME COLUMN {column} TO other"],
                [f"ALTER TABLE {table} RENAME TO t0", f"CREATE VIEW {table} AS SELECT * FROM t0"],
                [
                    f"ALTER TABLE {table} RENAME TO t0",
                    f"CREATE VIEW {table} AS {endless} SELECT {listed} FROM n, t0",
                ],
                [f"ALTER TABLE {table} RENAME TO t0", f"CREATE VIEW {table} AS SELECT {large} FROM t0"],
                [
                    f"CREATE TABLE t1 AS SELECT * FROM {table}",
                    f"DROP TABLE {table}",
                    f"ALTER TABLE t1 RENAME TO {table}",
                ],
                [f"INSERT INTO {table} SELECT * FROM {table}"],
            )
        )
        for statement in statements:
            database.execute(statement)
        database.commit()
        return database.serialize()
    except (sqlite3.Error, IndexError, UnicodeDecodeError):
        return flip_bit(rng, content, other)
    finally:
        database.close()


ARCHIVE: Sequence[Change] = (change_member, change_member, set_integer)
DATABASE: Sequence[Change] = (change_rows,)
