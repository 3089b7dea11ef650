"""Lines of numbers in a text file, read by all ranks together: each reads its own range of bytes."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from flowsolver.network import InputError

#: Bytes that are held as text at a time.
BLOCK = 1 << 22
_MARK = b"\xef\xbb\xbf"
_SHOWN = 60


@dataclass(frozen=True)
class Table:
    """What lines should hold: `columns` (of `fields` on each line, or of any number) of numbers, described in `expected` for messages."""

    columns: tuple[int, ...]
    fields: int | None
    expected: str


class _Fault(Exception):
    """At a byte of the file; or of the whole file, without one."""

    def __init__(self, text: str, at: int | None = None) -> None:
        super().__init__(text)
        self.text, self.at = text, at


def size_and_start(comm: MPI.Comm, path: Path, length: int = 4096) -> tuple[int, bytes]:
    """Size of a file and its first bytes, without the mark of UTF-8; InputError on all ranks if any of them cannot read it."""
    fault, start, size = "", b"", 0
    try:
        with open(path, "rb") as file:
            start = file.read(length)
            size = file.seek(0, 2)
    except OSError as error:
        fault = f"cannot read {path}: {error.strerror or error}"
    if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
        fault = f"cannot read {path}: it is in UTF-16; save it as plain text (UTF-8)"
    elif b"\0" in start or start[:2] == b"\x1f\x8b":
        fault = f"cannot read {path}: it is no text" + ("; unpack it first (gunzip)" if start[:2] == b"\x1f\x8b" else "")
    _agree(comm, path, _Fault(fault) if fault else None)
    return size, start.removeprefix(_MARK)


def read_rows(comm: MPI.Comm, path: Path, begin: int, end: int, table: Table) -> NDArray[np.float64]:
    """This rank's lines of a file's bytes `begin` to `end`, (n, columns) float64; the ranks' parts follow each other in the file's order.

    A line belongs to the rank in whose range its first byte lies. Empty lines, and what follows a #, count for nothing. Collective; the
    first line of the file that is faulty is an InputError on all ranks.
    """
    bounds = [begin + (end - begin) * k // comm.size for k in (comm.rank, comm.rank + 1)]
    parts, fault = [np.empty((0, len(table.columns)))], None
    try:
        with open(path, "rb") as file:
            for at, text in _blocks(file, begin, *bounds, end):
                parts.append(_parsed(text, at, table))
    except _Fault as found:
        fault = found
    except OSError as error:
        fault = _Fault(f"cannot read {path}: {error.strerror or error}")
    _agree(comm, path, fault)
    return np.concatenate(parts)


def places_of(comm: MPI.Comm, path: Path, size: int, words: bytes) -> list[int]:
    """Bytes at which lines of a file, but its first, begin with `words`, in order. Collective."""
    words = b"\n" + words
    first, last = (size * k // comm.size for k in (comm.rank, comm.rank + 1))
    found, held = [], b""
    with open(path, "rb") as file:
        file.seek(first)
        at = first
        # Words that begin before `last` may end after it, and words may lie across two blocks.
        while at < last + len(words) and (read := file.read(BLOCK)):
            text, begins = held + read, at - len(held)
            k = text.find(words)
            while 0 <= k and begins + k < last:
                found.append(begins + k + 1)
                k = text.find(words, k + 1)
            held = text[1 - len(words) :]
            at += len(read)
    return [place for part in comm.allgather(found) for place in part]


def _blocks(file: BinaryIO, begin: int, first: int, last: int, end: int) -> Iterator[tuple[int, bytes]]:
    """Whole lines, and the byte at which they begin: those whose first byte lies from `first` to before `last`."""
    at = first
    if first > begin:
        file.seek(first - 1)
        if file.read(1) != b"\n":
            at += len(_rest_of_line(file, end - first))
    file.seek(at)
    while at < last:
        text = file.read(min(BLOCK, last - at))
        if not text:
            return
        if not text.endswith(b"\n"):
            text += _rest_of_line(file, end - at - len(text))
        yield at, text
        at += len(text)


def _rest_of_line(file: BinaryIO, most: int) -> bytes:
    return file.readline(most) if most > 0 else b""


def _parsed(text: bytes, at: int, table: Table) -> NDArray[np.float64]:
    if at == 0 and text.startswith(_MARK):
        text, at = text[len(_MARK) :], len(_MARK)
    # What is not ASCII is in comments, or a fault.
    lines = text.decode("latin-1").split("\n")
    try:
        with warnings.catch_warnings():
            # That there is nothing to read.
            warnings.simplefilter("ignore", UserWarning)
            usecols = table.columns if table.fields is None else None
            rows = np.loadtxt(lines, ndmin=2, usecols=usecols)
        if not rows.size:
            return np.empty((0, len(table.columns)))
        if table.fields is None or rows.shape[1] == table.fields:
            return rows[:, list(table.columns)] if table.fields is not None else rows
        reason = ""
    except ValueError as error:
        reason = str(error)
    for line in lines:
        fields = line.partition("#")[0].split()
        if fields and not _fits(fields, table):
            shown = line.strip() if len(line.strip()) <= _SHOWN else line.strip()[:_SHOWN] + "..."
            raise _Fault(f"{shown!r} ({len(fields)} {'word' if len(fields) == 1 else 'words'}): expected {table.expected}", at)
        at += len(line) + 1
    raise _Fault(f"{reason}; expected {table.expected}", at)


def _fits(fields: list[str], table: Table) -> bool:
    if len(fields) != table.fields if table.fields is not None else len(fields) <= max(table.columns):
        return False
    try:
        return all(np.isreal(float(fields[k])) and "_" not in fields[k] for k in table.columns)
    except ValueError:
        return False


def _agree(comm: MPI.Comm, path: Path, fault: _Fault | None) -> None:
    """Raise the fault of the lowest rank that has one on all ranks; its line is counted by that rank."""
    said = None
    if fault is not None:
        said = fault.text if fault.at is None else f"{path}, line {_line_of(path, fault.at)}: {fault.text}"
    for text in comm.allgather(said):
        if text is not None:
            raise InputError(text)


def _line_of(path: Path, at: int) -> int:
    line, read = 1, 0
    with open(path, "rb") as file:
        while read < at and (text := file.read(min(BLOCK, at - read))):
            line += text.count(b"\n")
            read += len(text)
    return line
