"""A study from its file to its table, figure and page: `poreslip study`."""

from __future__ import annotations

import math
import signal
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from postproc.error_time import Row, cost, error_of, gathered, recommended_for_each, write_table
from postproc.errors import RunFileError
from postproc.observables import OBSERVABLES, NotObserved, Observed, ResultFiles, of_table
from postproc.references import ANALYTIC

from coupling.errors import ComputationError, InputError
from coupling.results.output import write_atomically
from coupling.study.files import load_study
from coupling.study.plan import Plan, Setting
from coupling.study.revision import revision
from coupling.study.runner import Runner
from coupling.study.schema import Observable, Study

TABLE, FIGURE, PAGE = "error_time.csv", "error_time", "study.md"


@dataclass(frozen=True)
class Paths:
    """Where a study's runs and its own results go: runs are shared by all studies below one root."""

    root: Path
    stem: str

    @property
    def runs(self) -> Path:
        return self.root / "runs"

    @property
    def results(self) -> Path:
        return self.root / self.stem


def carry_out(file: str, root: Path, dry_run: bool, keep: bool) -> int:
    """Carry out a study, or only say what it would do; the exit status. keep: take runs from before though another revision made them."""
    study = load_study(file)
    plan, paths = Plan(study), Paths(root, study.stem)
    runner = Runner(paths.runs, study.limit_s, keep)
    if dry_run:
        print(_planned(study, plan, runner))
        return 0
    paths.results.mkdir(parents=True, exist_ok=True)
    for line in _of_other_sources(study, plan, runner, keep):
        print(line, flush=True)
    work = Work(study, plan, runner)
    # The end of a job's process is as much wanted on SIGTERM as on Ctrl-C.
    # SIGINT too: what a shell starts in the background ignores it.
    before = {number: signal.signal(number, signal.default_int_handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        work.carry_out()
    except KeyboardInterrupt:
        print(f"{study.stem}  stopped; the same command goes on from here", flush=True)
        return 130
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if work.rows:
            write_table(work.rows, paths.results / TABLE)
    _write(study, work.rows, paths, file)
    return 0 if any(math.isfinite(row.error) for row in work.rows if not row.is_reference) else ComputationError.exit_status


class Work:
    """The runs of a study, one after the other, and the row of each."""

    def __init__(self, study: Study, plan: Plan, runner: Runner):
        self._study, self._plan, self._runner = study, plan, runner
        self._spread = [one.key for one in study.parameters if one.spread]
        file = study.reference.file
        # Read before anything is run.
        self._expected: dict[str, Observed] = {"file": of_file(study.directory / file, study.observable)} if file else {}
        self.rows: list[Row] = []

    def carry_out(self) -> None:
        """The reference runs come first, so that each line can tell an error."""
        references = list(self._plan.references.values())
        digests = {setting.jobs["run"].digest for setting in references}
        others = [setting for setting in self._plan.settings if setting.jobs["run"].digest not in digests]
        self._count = len(references) + len(others)
        for setting in references:
            # A reference that does not come to its end leaves the study without any error to tell.
            self.rows.append(self._row(setting, is_reference=True))
            if not self.rows[-1].stable:
                raise ComputationError(f"the reference, {setting}, did not come to its end: {self.rows[-1].reason}")
            if math.isnan(self.rows[-1].error):
                raise InputError(f"the reference, {setting}, does not show what [observable] asks for: {self.rows[-1].reason}.")
            self._tell(setting, self.rows[-1])
        for setting in others:
            self.rows.append(self._row(setting))
            self._tell(setting, self.rows[-1])

    def _row(self, setting: Setting, is_reference: bool = False) -> Row:
        outcomes = {name: self._runner.carry_out(job) for name, job in setting.jobs.items()}
        run = outcomes["run"]
        companions = {name: outcome.directory for name, outcome in outcomes.items() if name != "run"}
        files = ResultFiles(run.directory, companions, setting.inputs | setting.options)
        spent = cost(files, run.wall_s, run.cpu_s)
        value = error = math.nan
        stable, reason = run.done, run.reason
        if failed := next((f"[companion.{name}] {outcome.reason}" for name, outcome in outcomes.items() if name != "run" and not outcome.done), ""):
            reason = reason or failed
        if stable and not failed:
            try:
                observed = self._observed(files)
                if not np.isfinite(observed.value).all():
                    stable, reason = False, "the observable is not a finite number"
                else:
                    value = float(observed.value[0]) if len(observed.value) == 1 else math.nan
                    error = 0.0 if is_reference else error_of(observed, self._wanted(setting, files, observed), self._study.relative)
            except (NotObserved, RunFileError) as trouble:
                reason = str(trouble)
        reason = self._without_paths(reason, *(outcome.directory for outcome in outcomes.values()))
        options = {one.key: setting.options[one.key] for one in self._study.parameters if one.key in setting.options}
        spread = {key: options.pop(key) for key in self._spread if key in options}
        made_by = ", ".join(dict.fromkeys(outcome.revision for outcome in outcomes.values()))
        return Row(options, spread, value, error, spent, stable, reason, made_by, is_reference)

    def _without_paths(self, reason: str, *directories: Path) -> str:
        """A message with paths from the study's file on, not those of this machine."""
        for directory in (self._study.directory, *directories):
            reason = reason.replace(f"{directory}/", "")
        return reason

    def _observed(self, files: ResultFiles) -> Observed:
        wanted = self._study.observable
        if wanted.name == "history":
            return OBSERVABLES["history"](files, wanted.column, wanted.at, wanted.over)
        if wanted.name == "report":
            return OBSERVABLES["report"](files, wanted.key)
        return OBSERVABLES[wanted.name](files, **wanted.arguments)

    def _wanted(self, setting: Setting, files: ResultFiles, observed: Observed) -> Observed:
        """What the observable of a setting should be."""
        reference = self._study.reference
        if reference.value is not None:
            return Observed.number(reference.value)
        if reference.analytic:
            return Observed(ANALYTIC[reference.analytic](files, observed, **reference.arguments), observed.abscissa)
        if reference.file:
            return self._expected["file"]
        run = self._plan.reference_of(setting)
        digest = run.jobs["run"].digest
        if digest not in self._expected:
            outcomes = {name: self._runner.carry_out(job) for name, job in run.jobs.items()}
            self._expected[digest] = self._observed(ResultFiles(
                outcomes["run"].directory, {name: one.directory for name, one in outcomes.items() if name != "run"}, run.inputs | run.options))  # fmt: skip
        return self._expected[digest]

    def _tell(self, setting: Setting, row: Row) -> None:
        said = "the reference" if row.is_reference else f"error {row.error:.3g}" if math.isfinite(row.error) else " ".join(row.reason.split())[:100]
        print(f"{self._study.stem}  {len(self.rows)}/{self._count}  {setting}  {said}  {row.cost.cpu_s:.3g} CPU s", flush=True)


def of_file(path: Path, wanted: Observable) -> Observed:
    """The observable read from a CSV that is no run's: of "history" its columns, of others, which are a number each, the column `value`."""
    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read as a table with a line of names ({error}); give a CSV file such as history.csv.") from None
    if wanted.name != "history":
        if "value" in table and len(table) != 1:
            raise InputError(f"{path} has {len(table)} lines below its names: the observable {wanted.name} is one number; give one line.")
        wanted = Observable("history", column="value")
    names = [*filter(None, (wanted.column, wanted.over, *wanted.at))]
    for name in names:
        if name not in table:
            raise InputError(f"{path} has no column {name}; its columns: {', '.join(table.columns)}.")
        values = pd.to_numeric(table[name], errors="coerce").to_numpy(float)
        if not len(values) or not np.isfinite(values).all():
            line = int(np.argmin(np.isfinite(values))) + 2 if len(values) else 2
            raise InputError(f"{path}, line {line}: its column {name} holds no finite number there; every line needs one.")
    if wanted.over and not (np.diff(table[wanted.over]) >= 0.0).all():
        raise InputError(f"{path}: its column {wanted.over} does not grow throughout, so nothing can be read off between its lines; sort them by it.")
    try:
        return of_table(table, wanted.column, wanted.at, wanted.over)
    except NotObserved as trouble:
        raise InputError(f"{path}: {trouble}.") from None


def _write(study: Study, rows: list[Row], paths: Paths, file: str) -> None:
    points = gathered(rows)
    given = [one.key for one in study.parameters if one.given]
    best = recommended_for_each(points, given, study.tolerance)
    error_label = ("relative " if study.relative else "") + (study.error_label or "error")
    # Drawn only when all is there: matplotlib takes a second to load.
    from postproc.study_page import page, verdict
    from postproc.work_precision import draw

    labels = {one.key: one.label or one.key for one in study.parameters}
    picture = draw(points, best, given, study.tolerance, study.title, error_label, labels, paths.results, FIGURE)
    text = page(study.title, study.about, f"poreslip study {file}", points, best, given, study.tolerance, error_label, picture.name)
    write_atomically(paths.results / PAGE, text)
    for line in filter(None, verdict(points, best, study.tolerance)):
        print(f"{study.stem}  {line.replace('**', '')}")
    print(f"{study.stem}  {paths.results / PAGE}", flush=True)


def _of_other_sources(study: Study, plan: Plan, runner: Runner, keep: bool):
    """What is told of runs from before that other sources made."""
    jobs = {job.digest: job for setting in [*plan.references.values(), *plan.settings] for job in setting.jobs.values() if not job.refused}
    made = Counter(filter(None, (runner.of_other_sources(job) for job in jobs.values())))
    for name, count in made.items():
        done = "are taken as they are" if keep else f"are made again by {revision()}; --keep takes them as they are"
        yield f"{study.stem}  {count} of {len(jobs)} runs from before are of revision {name} and {done}"


def _planned(study: Study, plan: Plan, runner: Runner) -> str:
    """The runs that a study stands for, and what is kept of them from before."""
    jobs = {job.digest: (setting, name, job) for setting in [*plan.references.values(), *plan.settings] for name, job in setting.jobs.items()}
    lines = [f"{study.stem}: {len(plan.settings)} settings, {len(jobs)} runs", ""]
    for setting, name, job in jobs.values():
        other = runner.of_other_sources(job)
        state = f"kept from before{f' (revision {other})' if other else ''}" if runner.kept(job) else f"to be run{f' again: made by revision {other}' if other else ''}"
        if job.refused:
            state = f"refused: {' '.join(job.refused.split())}"
        lines.append(f"    {setting}{'' if name == 'run' else f'  [companion.{name}]'}  {state}")
    return "\n".join([*lines, "", "nothing was run"])
