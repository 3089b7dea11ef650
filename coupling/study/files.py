"""Study files: TOML in, frozen dataclasses out, and one message that tells what to correct."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path
from typing import Any

import cattrs

from coupling.case.files import nearest
from coupling.case.schema import SECTIONS
from coupling.case.strict import exactly, number, strict_converter
from coupling.errors import InputError
from coupling.study.checks import ALLOWED, problems
from coupling.study.schema import Command, Observable, Parameter, Reference, Study

_TOP = ("title", "about", "run", "companion", "parameter", "observable", "reference", "tolerance", "relative", "error_label", "limit_s")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def load_study(path: str | Path) -> Study:
    """Read and check a study file. Keys of cases and options of poreflow are checked when its runs are planned."""
    path = Path(path)
    table = _table(path)
    if "scene" in table:
        raise InputError(f"{path} is a case file; carry it out with `poreslip run {path}`, or name it in a study: [run] with case = \"...\".")
    _refuse_unknown(table, _TOP, "", path)
    for key in ("run", "parameter", "observable", "reference", "tolerance"):
        if key not in table:
            raise InputError(f"{path}: {key} is missing; a study needs run, parameter, observable, reference and tolerance, as cases/studies show.")
    entries = table["parameter"]
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{path}: parameters are written as tables in double brackets, [[parameter]], each with key and values.")
    companions = table.get("companion", {})
    if not isinstance(companions, dict) or not all(_NAME.fullmatch(name) for name in companions):
        raise InputError(f"{path}: companions are written as tables, [companion.NAME], each with a case of its own.")
    study = Study(
        stem=path.stem,
        directory=path.parent.resolve(),
        title=_value(table, "title", str, path, path.stem),
        about=_value(table, "about", str, path, ""),
        run=_section(Command, table["run"], "run", path),
        companions={name: _section(Command, entry, f"companion.{name}", path) for name, entry in companions.items()},
        parameters=tuple(_section(Parameter, entry, f"parameter {number}", path) for number, entry in enumerate(entries, start=1)),
        observable=_section(Observable, table["observable"], "observable", path),
        reference=_section(Reference, table["reference"], "reference", path),
        tolerance=_value(table, "tolerance", float, path, 0.0),
        relative=_value(table, "relative", bool, path, True),
        error_label=_value(table, "error_label", str, path, ""),
        limit_s=_value(table, "limit_s", float, path, 3600.0),
    )
    for trouble in problems(study):
        raise InputError(f"{path}: {trouble}.")
    return study


def _table(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        near = sorted(str(other) for other in path.parent.glob("*.toml")) if path.parent.is_dir() else []
        raise InputError(f"there is no study file {path}{nearest(str(path), near)}. Give the path of a TOML file, such as cases/studies/coupling_interval.toml.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read as a study file ({error}); give a TOML file, such as cases/studies/coupling_interval.toml.") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is not valid TOML: {error}. Correct that line; the files in cases/studies show how one is written.") from None


def _refuse_unknown(table: dict[str, Any], known: tuple[str, ...], section: str, path: Path) -> None:
    for key in table:
        if key not in known:
            holder = f"[{section}]" if section else "a study"
            raise InputError(f"{path}: unknown key {key} in {holder}{nearest(key, known)}. Keys of {holder}: {', '.join(known)}.")


def _converter() -> cattrs.Converter:
    """With lists, and tables of inputs."""
    converter = strict_converter()

    def table(value: Any, _: type) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise ValueError
        return {key: one for name, item in value.items() for key, one in _dotted(name, item)}

    def tables(value: Any, _: type) -> dict[str, dict[str, Any]]:
        if not isinstance(value, dict):
            raise ValueError
        return {name: table(one, dict) for name, one in value.items()}

    def listed(value: Any, _: type) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise ValueError
        return tuple(value)

    for kind, hook in ((dict[str, Any], table), (dict[str, dict[str, Any]], tables), (tuple[Any, ...], listed)):
        converter.register_structure_hook_func(lambda given, kind=kind: given == kind, hook)
    converter.register_structure_hook_func(
        lambda given: given == tuple[str, ...] | None, lambda value, _: tuple(exactly(one, str) for one in listed(value, tuple)))
    converter.register_structure_hook_func(lambda given: given == float | None, lambda value, _: number(value))
    return converter


def _dotted(name: str, value: Any) -> list[tuple[str, Any]]:
    """pack.seed = 2 in a table, which TOML reads as { pack = { seed = 2 } }, as the key that was written."""
    if isinstance(value, dict) and name in SECTIONS:
        return [(f"{name}.{key}", one) for key, one in value.items()]
    return [(name, value)]


_CONVERTER = _converter()


def _section(kind: type, table: Any, name: str, path: Path) -> Any:
    if not isinstance(table, dict):
        raise InputError(f"{path}: {name} is a section of its own: write its keys in a table.")
    fields = {one.name: one for one in dataclasses.fields(kind)}
    _refuse_unknown(table, tuple(fields), name, path)
    for required in (one.name for one in fields.values() if one.default is one.default_factory is dataclasses.MISSING):
        if required not in table:
            raise InputError(f"{path}: {required} is missing in {name}.")
    try:
        return _CONVERTER.structure(table, kind)
    except cattrs.ClassValidationError as errors:
        note = next(note for error in errors.exceptions for note in error.__notes__ if isinstance(note, cattrs.AttributeValidationNote))
        raise InputError(f"{path}: {note.name} = {table[note.name]!r} in {name}: allowed is {ALLOWED[fields[note.name].type]}.") from None


def _value(table: dict[str, Any], key: str, kind: type, path: Path, default: Any) -> Any:
    try:
        return _CONVERTER.structure(table.get(key, default), kind)
    except ValueError:
        raise InputError(f"{path}: {key} = {table[key]!r}: allowed is {ALLOWED[kind.__name__]}.") from None
