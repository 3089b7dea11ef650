"""What a study file may hold, and how it is read: TOML in, frozen dataclasses out, one message that tells what to correct.

A study carries out one command with every combination of its parameters' values, takes one observable from each result, and holds it
against a reference.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
import shlex
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cattrs
from postproc.observables import OBSERVABLES
from postproc.references import ANALYTIC

from coupling.case.files import nearest
from coupling.case.schema import SECTIONS
from coupling.case.strict import exactly, number, strict_converter
from coupling.errors import InputError

#: A setting has at most this many parameters; those that are spread over come on top.
MOST_PARAMETERS = 3
#: Fields of [observable] that belong to one of them alone.
FIELDS_OF = {"history": ("column", "at", "over"), "report": ("key",)}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@dataclass(frozen=True)
class Command:
    """What is carried out for a setting: a run of a case file, or poreflow."""

    # Case file, relative to the study file; and which of its runs, where it has several.
    case: str = ""
    only: str = ""
    # Inputs of the case that differ from the file: dotted keys. Those of a companion hold whatever the setting.
    set: dict[str, Any] = field(default_factory=dict)
    # Instead of a case: command line of poreflow, the pack's path relative to the study file, other files to the run's directory.
    poreflow: str = ""
    # Number of MPI ranks.
    ranks: int = 1
    # Of a companion: the study's parameters that it takes; all of them by default.
    parameters: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Parameter:
    """One thing that is varied: a key of the case (or an option of poreflow) with values, or a name with choices."""

    # "section.key" of a case; "--option" of poreflow, or "pack" for another pack; with `choices` any name.
    key: str
    # Values of the key. For an option: true gives it without a value, false leaves it out, a list of numbers gives them all.
    values: tuple[Any, ...] = ()
    # Instead of values: label = { key = value, ... }, for what has to change together.
    choices: dict[str, dict[str, Any]] = field(default_factory=dict)
    # Settings that differ in this alone, as in the seed of a pack, count as one: with the largest of their errors.
    spread: bool = False
    # Not a choice but given, as the porosity of a pack: a setting is recommended for each of its values.
    given: bool = False
    # How it is called in figures; the key by default.
    label: str = ""

    @property
    def options(self) -> tuple[Any, ...]:
        """What stands for its values in tables: the values, or the labels of the choices."""
        return tuple(self.choices) if self.choices else self.values

    def inputs(self, option: Any) -> dict[str, Any]:
        """Keys and values that an option stands for."""
        return self.choices[option] if self.choices else {self.key: option}


@dataclass(frozen=True)
class Observable:
    """What is taken from a result: one of postproc/observables.py, with its own arguments."""

    name: str
    # Of "history": the column of history.csv, read at the end, or where `at` = { column = value }, or as a curve over the column `over`.
    column: str = ""
    at: dict[str, float] = field(default_factory=dict)
    over: str = ""
    # Of "report": dotted key of report.json or of poreflow's report.
    key: str = ""
    # Further arguments of the observable by name.
    arguments: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Reference:
    """What the observable is held against: exactly one of a finer run, a value, an analytic solution, and a file."""

    # A setting: parameter = value. Keys that are not parameters are inputs of this run alone.
    settings: dict[str, Any] = field(default_factory=dict)
    value: float | None = None
    # Name of one of postproc/references.py, and its arguments.
    analytic: str = ""
    arguments: dict[str, Any] = field(default_factory=dict)
    # CSV beside the study file with the columns that the observable reads.
    file: str = ""


@dataclass(frozen=True)
class Study:
    """A study file."""

    stem: str
    directory: Path
    title: str
    about: str
    run: Command
    companions: dict[str, Command]
    parameters: tuple[Parameter, ...]
    observable: Observable
    reference: Reference
    tolerance: float
    # Whether errors are divided by the size of the reference.
    relative: bool
    # What the error is one of, for figures.
    error_label: str
    # A run that takes longer than this is ended, wall s.
    limit_s: float


_TOP = ("title", "about", "run", "companion", "parameter", "observable", "reference", "tolerance", "relative", "error_label", "limit_s")


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
    for trouble in _problems(study):
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
_ALLOWED = {
    "str": "text in quotes",
    "int": "a whole number",
    "float": "a finite number",
    "bool": "true or false",
    "dict[str, Any]": "a table, { key = value }",
    "dict[str, float]": "a table of numbers, { column = value }",
    "dict[str, dict[str, Any]]": "a table of tables, { label = { key = value } }",
    "tuple[Any, ...]": "a list, [value, value]",
    "tuple[str, ...] | None": "a list of names",
    "float | None": "a finite number",
}


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
        raise InputError(f"{path}: {note.name} = {table[note.name]!r} in {name}: allowed is {_ALLOWED[fields[note.name].type]}.") from None


def _value(table: dict[str, Any], key: str, kind: type, path: Path, default: Any) -> Any:
    try:
        return _CONVERTER.structure(table.get(key, default), kind)
    except ValueError:
        raise InputError(f"{path}: {key} = {table[key]!r}: allowed is {_ALLOWED[kind.__name__]}.") from None


def _problems(study: Study):
    """What is wrong with a study whose values have the right types."""
    for name, command in {"run": study.run, **{f"companion.{name}": one for name, one in study.companions.items()}}.items():
        if bool(command.case) == bool(command.poreflow):
            yield f"[{name}] names either a case file (case = ...) or a command line of poreflow (poreflow = ...)"
        if command.poreflow and (command.only or command.set):
            yield f"[{name}]: only and set belong to a case, and this is poreflow: put its options into the command line"
        if command.ranks < 1:
            yield f"ranks = {command.ranks} in [{name}]: allowed is 1 or more"
        try:
            file = command.case or shlex.split(command.poreflow)[0]
        except (ValueError, IndexError):
            yield f"poreflow = {command.poreflow!r} in [{name}]: allowed is the command line of poreflow, a pack and its options, with quotes in pairs"
            continue
        if not (study.directory / file).is_file():
            near = sorted(str(other.relative_to(study.directory)) for other in (study.directory / file).parent.glob("*"))
            yield f"[{name}]: there is no file {study.directory / file}{nearest(file, near)}"
        for key in command.parameters or ():
            if key not in {one.key for one in study.parameters}:
                yield f"[{name}]: {key} is no parameter of the study{nearest(key, [one.key for one in study.parameters])}"
    if sum(not one.spread for one in study.parameters) not in range(1, MOST_PARAMETERS + 1):
        yield f"there are {sum(not one.spread for one in study.parameters)} parameters; allowed are 1 to {MOST_PARAMETERS}, besides those with spread = true"
    if all(one.given or one.spread for one in study.parameters):
        yield "all parameters are given or spread over, so there is nothing to choose"
    keys = [one.key for one in study.parameters]
    if len(set(keys)) < len(keys):
        yield "two parameters have the same key"
    for one in study.parameters:
        if bool(one.values) == bool(one.choices):
            yield f"parameter {one.key} needs either values, a list that is not empty, or choices, a table"
        if one.given and one.spread:
            yield f"parameter {one.key} cannot be given and spread over at once"
        if len({str(option) for option in one.options}) < len(one.options):
            yield f"parameter {one.key} names a value twice"
    yield from _observed_problems(study)
    if not study.tolerance > 0.0:
        yield f"tolerance = {study.tolerance:g}: allowed is a number above 0, the error that is asked for"
    if not study.limit_s > 0.0:
        yield f"limit_s = {study.limit_s:g}: allowed is a number of seconds above 0"


def _argument_problems(kind: str, name: str, known: dict[str, Callable], arguments: dict[str, Any], own: tuple[str, ...]):
    """What is wrong with the arguments of an observable or a reference. own: parameters of its function that are not given as such."""
    if name not in known:
        return
    taken = {key: one for key, one in inspect.signature(known[name]).parameters.items() if key not in own}
    for key, value in arguments.items():
        if key not in taken:
            yield f"the {kind} {name} has no argument {key}{nearest(key, taken)}; its arguments: {', '.join(taken) or 'none'}"
        elif (wanted := taken[key].annotation.removesuffix(" | None")) in ("float", "str") and not _is(value, wanted):
            yield f"{key} = {value!r} in the arguments of {name}: allowed is {_ALLOWED[wanted]}"
        elif wanted.startswith("Mapping") and not (isinstance(value, dict) and len(value) == 1 and all(_is(one, "float") for one in value.values())):
            yield f"{key} = {value!r} in the arguments of {name}: allowed is one column and its value, {{ column = value }}"
    for key, one in taken.items():
        if one.default is inspect.Parameter.empty and key not in arguments:
            yield f"the {kind} {name} needs arguments = {{ {key} = ... }}"


def _is(value: Any, kind: str) -> bool:
    """Whether it is a text, or a finite number."""
    try:
        return (number(value) if kind == "float" else exactly(value, str)) is not None
    except ValueError:
        return False


def _observed_problems(study: Study):
    observable, reference = study.observable, study.reference
    if observable.name not in OBSERVABLES:
        yield f"observable {observable.name} is not known{nearest(observable.name, OBSERVABLES)}; known are {', '.join(OBSERVABLES)}"
    if observable.name == "history" and not observable.column:
        yield 'the observable "history" needs the name of a column of history.csv: column = "..."'
    if observable.at and (len(observable.at) != 1 or observable.over):
        yield "at holds one column and its value, { column = value }, and cannot be combined with over"
    if observable.name == "report" and not observable.key:
        yield 'the observable "report" needs a key of the report: key = "..."'
    yield from _argument_problems("observable", observable.name, OBSERVABLES, observable.arguments, ("files", *FIELDS_OF.get(observable.name, ())))
    for key in ("column", "at", "over", "key"):
        if getattr(observable, key) and key not in FIELDS_OF.get(observable.name, ()):
            yield f"the observable {observable.name} takes no {key}; write what it takes as arguments = {{ name = value }}"
    yield from _argument_problems("analytic reference", reference.analytic, ANALYTIC, reference.arguments, ("files", "observed"))
    if observable.over and reference.value is not None:
        yield "[reference] value is one number, and the observable is a curve over another column: read it at a place, at = { column = value }, or give a file"
    if reference.value == 0.0 and study.relative:
        yield "no error is relative to [reference] value = 0: set relative = false"
    given = [name for name in ("settings", "analytic", "file") if getattr(reference, name)] + ["value"] * (reference.value is not None)
    if len(given) != 1:
        yield f"[reference] needs one of settings, value, analytic and file; given {'are ' + ', '.join(given) if given else 'is none'}"
    if reference.analytic and reference.analytic not in ANALYTIC:
        yield f"the analytic reference {reference.analytic} is not known{nearest(reference.analytic, ANALYTIC)}; known are {', '.join(ANALYTIC)}"
    if reference.file and not (study.directory / reference.file).is_file():
        yield f"there is no reference file {study.directory / reference.file}"
    for one in study.parameters:
        if reference.settings and not one.spread and one.key not in reference.settings:
            yield f"the reference setting lacks the parameter {one.key}"
        if one.choices and one.key in reference.settings and reference.settings[one.key] not in one.choices:
            yield f"the reference's {one.key} = {reference.settings[one.key]!r} is none of its choices: {', '.join(one.choices)}"
