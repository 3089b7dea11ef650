"""What a study file may hold: one frozen dataclass a section.

A study carries out one command with every combination of its parameters' values, takes one observable from each result, and holds it
against a reference.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


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
    # CSV beside the study file with the columns that the observable "history" reads, or, of another that is a number, the column value and one line.
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
