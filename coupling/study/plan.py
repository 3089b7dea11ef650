"""What a study carries out: its settings, and the process of each with all that decides its result."""

from __future__ import annotations

import difflib
import hashlib
import itertools
import json
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coupling import __version__
from coupling.case.files import load_case, select_runs
from coupling.case.run_case import RunCase
from coupling.case.schema import SECTIONS
from coupling.errors import InputError
from coupling.measures.of_case import measures_of
from coupling.study.checks import column_problems
from coupling.study.schema import Command, Study

#: Report of poreflow in the directory of its run.
POREFLOW_REPORT = "out.json"
#: Key of a parameter that stands for the pack itself, where the command is poreflow.
PACK = "pack"


@dataclass(frozen=True)
class Job:
    """One process.

    arguments: of Python. results: where its files will be, below the run's directory. digest: of all inputs; runs with the same one
    are the same run. refused: what is wrong with its inputs, where they are refused beforehand. columns: of its history.csv, none where it
    is refused or writes no such file.
    """

    arguments: tuple[str, ...]
    results: str
    digest: str
    ranks: int
    refused: str = ""
    columns: tuple[str, ...] = ()


@dataclass(frozen=True)
class Setting:
    """One setting. options: parameter to value or label. inputs: key to value, choices resolved. jobs: its processes, "run" the measured one."""

    options: dict[str, Any]
    inputs: dict[str, Any]
    jobs: dict[str, Job]

    def __str__(self) -> str:
        return "  ".join(f"{key} = {value}" for key, value in self.options.items())


class Plan:
    """All settings of a study, and that of its reference where it is a run."""

    def __init__(self, study: Study):
        self._study = study
        self._poreflow_options: tuple[str, ...] | None = None
        self._check_keys()
        combinations = itertools.product(*(one.options for one in study.parameters))
        self.settings = [self._setting(dict(zip((one.key for one in study.parameters), values))) for values in combinations]
        self.references = self._references()
        self._check_columns()

    def _references(self) -> dict[tuple[Any, ...], Setting]:
        """The reference run for each combination of the parameters that are spread over; empty where it is no run."""
        if not self._study.reference.settings:
            return {}
        spread = [one for one in self._study.parameters if one.spread and one.key not in self._study.reference.settings]
        found = {}
        for values in itertools.product(*(one.options for one in spread)):
            found[values] = self._setting(dict(zip((one.key for one in spread), values)) | self._study.reference.settings)
        return found

    def reference_of(self, setting: Setting) -> Setting | None:
        """The reference run that a setting is held against."""
        if not self.references:
            return None
        spread = [one.key for one in self._study.parameters if one.spread and one.key not in self._study.reference.settings]
        return self.references[tuple(setting.options[key] for key in spread)]

    def _setting(self, options: dict[str, Any]) -> Setting:
        study = self._study
        jobs = {"run": self._job(study.run, options)}
        for name, command in study.companions.items():
            taken = options if command.parameters is None else {key: value for key, value in options.items() if key in command.parameters}
            jobs[name] = self._job(command, taken)
        return Setting(options, self._inputs(options), jobs)

    def _inputs(self, options: dict[str, Any]) -> dict[str, Any]:
        parameters = {one.key: one for one in self._study.parameters}
        merged: dict[str, Any] = {}
        for key, option in options.items():
            merged |= parameters[key].inputs(option) if key in parameters and option in parameters[key].options else {key: option}
        return merged

    def _job(self, command: Command, options: dict[str, Any]) -> Job:
        inputs = self._inputs(options)
        if not command.case:
            return self._poreflow_job(command, inputs)
        # A companion keeps what it sets for itself; in the measured run the setting decides.
        return self._case_job(command, command.set | inputs if command is self._study.run else inputs | command.set)

    def _case_job(self, command: Command, inputs: dict[str, Any]) -> Job:
        path = self._study.directory / command.case
        overrides = [f"{key}={toml(value)}" for key, value in inputs.items()]
        only = [command.only] if command.only else []
        arguments = ["-m", "coupling", "run", str(path), *(f"--only={name}" for name in only)]
        for override in overrides:
            arguments += ["--set", override]
        # Read without the settings first: what is wrong there is wrong with the study, and ends it.
        names = [run.name for run in select_runs(load_case(path), only).runs]
        if len(names) != 1:
            raise InputError(f"{path} stands for {len(names)} runs ({', '.join(names)}), and a study measures one: name it with only = \"...\".")
        results, refused, resolved, columns = f"{path.stem}/{names[0]}", "", {}, ()
        try:
            run = select_runs(load_case(path, overrides), only).runs[0]
            resolved, columns = run.to_dict() | {"decks": _decks_digest(run)}, measures_of(run).columns(run)
        except InputError as error:
            refused = str(error)
        content = {"version": __version__, "case": resolved, "refused": refused, "ranks": command.ranks}
        return Job((*arguments, "--out", "."), results, _digest(content), command.ranks, refused, columns)

    def _poreflow_job(self, command: Command, inputs: dict[str, Any]) -> Job:
        file, *options = shlex.split(command.poreflow)
        pack = self._study.directory / str(inputs.get(PACK, file))
        if not pack.is_file():
            raise InputError(f"there is no pack {pack}, which the study names; its path is relative to the study file.")
        for key, value in inputs.items():
            if key != PACK:
                options += _option(key, value)
        options += ["--json", POREFLOW_REPORT]
        content = {"version": __version__, "pack": hashlib.sha256(pack.read_bytes()).hexdigest(), "options": options, "ranks": command.ranks}
        return Job(("-m", "flowsolver", str(pack), *options), ".", _digest(content), command.ranks)

    def _check_columns(self) -> None:
        """Refuse an observable that a run of the study will not show, before any is carried out."""
        for setting in [*self.references.values(), *self.settings]:
            job = setting.jobs["run"]
            for trouble in () if job.refused else column_problems(self._study.observable, job.columns, f"the run {setting}"):
                raise InputError(f"{self._study.stem}: {trouble}.")

    def _check_keys(self) -> None:
        """Refuse keys that no case has and options that poreflow does not know, the nearest known one named."""
        study = self._study
        commands = {"run": study.run, **study.companions}
        for name, command in commands.items():
            reach = [one for one in study.parameters if command.parameters is None or one.key in command.parameters]
            keys = [key for one in reach for option in one.options for key in one.inputs(option)]
            extra = [key for key in study.reference.settings if key not in {one.key for one in study.parameters}]
            known = self._case_keys() if command.case else (PACK, *self._options_of_poreflow())
            for key in [*command.set, *keys, *extra]:
                if key not in known:
                    match = difflib.get_close_matches(key, known, n=1, cutoff=0.6)
                    meant = f" (did you mean {match[0]}?)" if match else ""
                    what = "no input of a case" if command.case else "no option of poreflow"
                    raise InputError(f"{key}, which the study gives to [{name}], is {what}{meant}; see " + (
                        "coupling/case/schema.py." if command.case else "`poreflow --help`."))

    @staticmethod
    def _case_keys() -> list[str]:
        return [f"{section}.{name}" for section, kind in SECTIONS.items() for name in kind.__dataclass_fields__] + ["decks_directory"]

    def _options_of_poreflow(self) -> tuple[str, ...]:
        """Asked of the command itself, in a process of its own: it loads PETSc and starts MPI."""
        if self._poreflow_options is None:
            shown = subprocess.run([sys.executable, "-m", "flowsolver", "--help"], capture_output=True, text=True, check=True).stdout
            self._poreflow_options = tuple(dict.fromkeys(re.findall(r"(?<![\w-])--[a-z][a-z-]*", shown)))
        return self._poreflow_options


def toml(value: Any) -> str:
    """A value as TOML, numbers with all their digits."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name} = {toml(one)}" for name, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml(one) for one in value) + "]"
    return json.dumps(value)


def _option(key: str, value: Any) -> list[str]:
    if isinstance(value, bool):
        return [key] if value else []
    if isinstance(value, list):
        return [key, *(str(one) for one in value)] if not any(isinstance(one, str) for one in value) else [part for one in value for part in (key, one)]
    # A value that begins with a dash is written together with its option, so that it is not read as one.
    return [f"{key}={value}"]


def _decks_digest(run: RunCase) -> str:
    decks = sorted(path for path in Path(run.decks_directory).iterdir() if path.is_file())
    return _digest({path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in decks})


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
