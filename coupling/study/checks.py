"""Whether a study makes sense: its commands, parameters, observable and reference, and those that have to fit one another."""

from __future__ import annotations

import inspect
import shlex
from collections.abc import Callable, Iterator
from typing import Any

from postproc.observables import COLUMNS_READ, COMPANIONS_OF_OBSERVABLE, OBSERVABLES
from postproc.references import ANALYTIC, COMPANIONS_OF_ANALYTIC

from coupling.case.files import nearest
from coupling.case.strict import exactly, number
from coupling.study.schema import Observable, Study

#: A setting has at most this many parameters; those that are spread over come on top.
MOST_PARAMETERS = 3
#: Fields of [observable] that belong to one of them alone.
FIELDS_OF = {"history": ("column", "at", "over"), "report": ("key",)}
#: Observables that are no single number, nor columns of history.csv.
CURVES = ("consolidation", "pressures")
#: What a key of each type may hold, for messages.
ALLOWED = {
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


def problems(study: Study) -> Iterator[str]:
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
            yield f"{key} = {value!r} in the arguments of {name}: allowed is {ALLOWED[wanted]}"
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
    needed = {f"observable {observable.name}": COMPANIONS_OF_OBSERVABLE.get(observable.name, ()), f"analytic reference {reference.analytic}": COMPANIONS_OF_ANALYTIC.get(reference.analytic, ())}
    for what, names in needed.items():
        if lacking := [f"[companion.{name}]" for name in names if name not in study.companions]:
            yield f"the {what} needs {' and '.join(lacking)}, a run of its own that gives its part, as cases/studies show"
    if reference.file and observable.name in CURVES:
        yield f"the observable {observable.name} is not one number, and [reference] file = {reference.file!r} cannot hold it; give settings, a finer run, or analytic"
    if reference.file and not (study.directory / reference.file).is_file():
        yield f"there is no reference file {study.directory / reference.file}"
    for one in study.parameters:
        if reference.settings and not one.spread and one.key not in reference.settings:
            yield f"the reference setting lacks the parameter {one.key}"
        if one.choices and one.key in reference.settings and reference.settings[one.key] not in one.choices:
            yield f"the reference's {one.key} = {reference.settings[one.key]!r} is none of its choices: {', '.join(one.choices)}"


def column_problems(observable: Observable, columns: tuple[str, ...], run: str) -> Iterator[str]:
    """What the observable reads and a run will not write. columns: of the run's history.csv, none where there will be no such file.
    run: how messages call the run."""
    if observable.name not in COLUMNS_READ:
        return
    if not columns:
        yield f"the observable {observable.name} is read from history.csv, which poreflow does not write: give [run] a case, or take permeability, report or pressures"
        return
    at = {**observable.at, **observable.arguments.get("at", {})}
    for key, name in [("column", observable.column), ("over", observable.over), *(("at", name) for name in at)]:
        if name and name not in columns:
            given = f"at = {{ {name} = {at[name]:g} }}" if key == "at" else f'{key} = "{name}"'
            yield f"{given} in [observable]: history.csv of {run} will have no such column{nearest(name, columns)}; write one of its columns: {', '.join(columns)}"
    if lacking := [name for name in COLUMNS_READ[observable.name] if name not in columns]:
        yield f"the observable {observable.name} reads {', '.join(lacking)}, which history.csv of {run} will not have; give [run] a case that has, or another observable"
