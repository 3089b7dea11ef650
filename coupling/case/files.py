"""Case files: TOML in, frozen dataclasses out, and one message that tells what to correct."""

from __future__ import annotations

import copy
import dataclasses
import difflib
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import cattrs

from coupling.case.checks import allowed_text, problems, toml_text
from coupling.case.run_case import CaseFile, RunCase
from coupling.case.schema import DECKS, ENGINES, SCENES, SECTIONS
from coupling.case.strict import number, strict_converter
from coupling.errors import InputError

_TOP = ("title", "scene", "engine", "decks_directory")
_RUN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def load_case(path: str | Path, overrides: Iterable[str] = ()) -> CaseFile:
    """Read a case file, apply `key=value` overrides, and check every run it stands for.

    A run is the file's own sections, then what its [[run]] entry overrides, then `overrides`; with `[sweep] seeds` each run
    is made once for each seed of the pack.
    """
    path = Path(path)
    text = _read(path)
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is not valid TOML: {error}. Correct that line; the cases in cases/two_sides show how one is written.") from None
    origin = _Origin(str(path), _key_lines(text))

    if {"parameter", "observable"} <= table.keys():
        raise InputError(f"{path} is a study file; carry it out with `poreslip study {path}`.")
    _refuse_unknown(table, {*_TOP, *SECTIONS, "run", "sweep"}, "", origin)
    entries = table.pop("run", [{"name": "run"}])
    if not isinstance(entries, list) or not entries or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"{origin.of('run')}: runs are written as tables in double brackets, [[run]], each with a name.")
    command_line = _command_line(overrides, origin)
    _refuse_unknown(command_line, {*_TOP, *SECTIONS, "sweep"}, "", origin)
    table = _merged(table, command_line)
    seeds = _sweep_seeds(table.pop("sweep", {}), origin)
    command_line.pop("sweep", None)
    if seeds and "seed" in command_line.get("pack", {}):
        raise InputError("--set pack.seed: the case sweeps over seeds, so one seed cannot be set; use --set sweep.seeds=[...] instead.")

    runs: list[RunCase] = []
    for number, entry in enumerate(entries):
        origin.run = number
        name = entry.get("name")
        if not isinstance(name, str) or not _RUN_NAME.fullmatch(name):
            raise InputError(
                f"{origin.of('name')}: run {number + 1} needs a name, which names its directory, made of letters, digits, dots, dashes and "
                f"underscores; given was {toml_text(name) if name is not None else 'none'}. Add a line such as name = \"case{number + 1}\"."
            )
        if name in {run.group for run in runs}:
            raise InputError(f"{origin.of('name')}: two runs are named {name}. Give each its own name.")
        own = {key: value for key, value in entry.items() if key != "name"}
        _refuse_unknown(own, {*_TOP, *SECTIONS}, "", origin, listed={*_TOP, *SECTIONS, "name"})
        merged = _merged(_merged(table, own), command_line)
        for seed in seeds or [None]:
            sections = copy.deepcopy(merged)
            if seed is not None:
                sections.setdefault("pack", {})["seed"] = seed
            named = name if seed is None else f"{name}-seed{seed}"
            runs.append(_structured(sections, path.stem, named, name, origin))
    return CaseFile(stem=path.stem, runs=tuple(runs))


def run_case_from_dict(resolved: Mapping[str, Any], source: str, overrides: Iterable[str] = ()) -> RunCase:
    """The run that `RunCase.to_dict` wrote down, with `key=value` overrides; `source` names the file in messages."""
    origin = _Origin(source, {})
    resolved = _merged(resolved, _command_line(overrides, origin))
    try:
        names = [resolved[key] for key in ("case", "run", "group")]
    except KeyError as error:
        raise InputError(f"{source}: the key {error} is missing, so this is not a case that poreslip wrote.") from None
    sections = {key: value for key, value in resolved.items() if key not in ("case", "run", "group", "derived")}
    _refuse_unknown(sections, {*_TOP, *SECTIONS}, "", origin)
    return _structured(sections, *names, origin)


def select_runs(case_file: CaseFile, names: Iterable[str]) -> CaseFile:
    """The runs of these names, in the file's order; a name without its seed stands for every pack. No names: all runs."""
    names = tuple(names)
    known = list(dict.fromkeys(name for run in case_file.runs for name in (run.group, run.name)))
    for name in names:
        if name not in known:
            raise InputError(f"--only {name}: the case {case_file.stem} has no run of that name{nearest(name, known)}. Its runs: {', '.join(known)}.")
    chosen = tuple(run for run in case_file.runs if not names or run.name in names or run.group in names)
    return dataclasses.replace(case_file, runs=chosen)


class _Origin:
    """Where a key was given, for messages: a line of the case file, or the command line."""

    def __init__(self, source: str, lines: Mapping[tuple[int | None, str], int]) -> None:
        self.source = source
        self.lines = lines
        self.command_line: set[str] = set()
        self.run: int | None = None

    def of(self, key: str) -> str:
        if any(given == key or given.startswith(f"{key}.") for given in self.command_line):
            return "--set"
        line = self.lines.get((self.run, key)) or self.lines.get((None, key))
        return f"{self.source}, line {line}" if line else self.source


def _read(path: Path) -> str:
    try:
        # Some editors put a mark of UTF-8 in front.
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        near = sorted(str(other) for other in path.parent.glob("*.toml")) if path.parent.is_dir() else []
        raise InputError(f"there is no case file {path}{nearest(str(path), near)}. Give the path of a TOML file, such as cases/two_sides/quick.toml.") from None
    except IsADirectoryError:
        held = ", ".join(sorted(other.name for other in path.glob("*.toml"))) or "none"
        raise InputError(f"{path} is a directory; give one case file in it (TOML files there: {held}).") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file in UTF-8 (byte {error.start}); give a case file, which is TOML.") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}. Check the path and its permissions.") from None


def _key_lines(text: str) -> dict[tuple[int | None, str], int]:
    """Line of each key, by number of its [[run]] (None outside of one) and dotted key; for messages only."""
    lines: dict[tuple[int | None, str], int] = {}
    runs, run, prefix = 0, None, ""
    for number, line in enumerate(text.splitlines(), start=1):
        if header := re.match(r"\s*(\[\[?)([^\[\]]+)\]", line):
            first, _, rest = re.sub(r"\s", "", header[2]).partition(".")
            if first == "run":
                runs += header[1] == "[[" and not rest
                run, prefix = runs - 1, rest
            else:
                run, prefix = None, first + (f".{rest}" if rest else "")
            lines.setdefault((run, prefix), number)
        elif key := re.match(r"""\s*([\w.\-"' ]+?)\s*=""", line):
            dotted = re.sub(r"""[\s"']""", "", key[1])
            lines.setdefault((run, f"{prefix}.{dotted}" if prefix else dotted), number)
    return lines


def _command_line(overrides: Iterable[str], origin: _Origin) -> dict[str, Any]:
    """The overrides as tables."""
    table: dict[str, Any] = {}
    for override in overrides:
        key, value = _parse_override(override)
        _insert(table, key, value, override)
        origin.command_line.add(key)
    return table


def _parse_override(override: str) -> tuple[str, Any]:
    """`pressure.left_target_Pa=2.5e7` as a dotted key and a TOML value; a value that is not TOML is text without its quotes."""
    key, equals, text = (part.strip() for part in override.partition("="))
    if not equals or not re.fullmatch(r"[\w-]+(\.[\w-]+)*", key) or not text:
        raise InputError(f"--set {override}: write --set section.key=value, such as --set pack.seed=2.")
    if key.split(".")[0] == "run":
        raise InputError(f"--set {override}: runs are set in the case file; --set section.key=value holds for all runs, and --only NAME chooses among them.")
    try:
        return key, tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return key, text


def _insert(table: dict[str, Any], key: str, value: Any, override: str) -> None:
    *sections, last = key.split(".")
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise InputError(f"--set {override}: {section} was already set to {toml_text(table)}, which has no keys of its own. Leave one of the two out.")
    table[last] = value


def _merged(below: Mapping[str, Any], above: Mapping[str, Any], in_section: bool = False) -> dict[str, Any]:
    """Both tables in one, tables within them merged too; where both hold a value, `above` has it. An empty table as the value of an input,
    as fluid.faces = {}, leaves none of the entries below; an empty section leaves all."""
    result = dict(below)
    for key, value in above.items():
        both = isinstance(value, dict) and isinstance(result.get(key), dict) and (value or not in_section)
        result[key] = _merged(result[key], value, True) if both else copy.deepcopy(value)
    return result


def _sweep_seeds(sweep: Any, origin: _Origin) -> list[int]:
    if not isinstance(sweep, dict):
        raise InputError(f"{origin.of('sweep')}: sweep = {toml_text(sweep)}: a sweep is a table, [sweep] with seeds = [1, 2, 3].")
    _refuse_unknown(sweep, {"seeds"}, "sweep", origin)
    if "seeds" not in sweep:
        return []
    seeds = sweep["seeds"]
    whole = isinstance(seeds, list) and all(isinstance(seed, int) and not isinstance(seed, bool) and 1 <= seed <= 2_000_000_000 for seed in seeds)
    if not whole or not seeds or len(set(seeds)) < len(seeds):
        raise InputError(
            f"{origin.of('sweep.seeds')}: sweep.seeds = {toml_text(seeds)}: allowed is a list of different whole numbers from 1 to 2000000000, "
            "one for each pack, such as [1, 2, 3]."
        )
    return seeds


def _refuse_unknown(table: Mapping[str, Any], known: set[str], section: str, origin: _Origin, listed: Iterable[str] = ()) -> None:
    for key in table:
        if key not in known:
            names = sorted(listed or known)
            dotted = f"{section}.{key}" if section else key
            holder = f"[{section}]" if section else "the case"
            raise InputError(f"{origin.of(dotted)}: unknown key {dotted}{nearest(key, names)}. Keys of {holder}: {', '.join(names)}.")


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint at the name that was probably meant, for messages; empty where none is near."""
    match = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f" (did you mean {match[0]}?)" if match else ""


def _converter() -> cattrs.Converter:
    """With lists of numbers, and tables for decks."""
    converter = strict_converter()

    def numbers(count: int) -> Any:
        def hook(value: Any, _: type) -> tuple[float, ...]:
            if not isinstance(value, list | tuple) or len(value) != count:
                raise ValueError
            return tuple(number(one) for one in value)

        return hook

    def deck_variables(value: Any, _: type) -> dict[str, float | int | str]:
        simple = isinstance(value, dict) and all(re.fullmatch(r"\w+", name) and type(one) in (int, float, str) for name, one in value.items())
        if not simple or any(isinstance(one, float) and not math.isfinite(one) for one in value.values()):
            raise ValueError
        return dict(value)

    for kind, hook in (
        (tuple[float, float], numbers(2)),
        (tuple[float, float, float], numbers(3)),
        (dict[str, float | int | str], deck_variables),
    ):
        converter.register_structure_hook_func(lambda given, kind=kind: given == kind, hook)
    return converter


_CONVERTER = _converter()


def _structured(table: Mapping[str, Any], case: str, name: str, group: str, origin: _Origin) -> RunCase:
    """A run from its tables, checked."""
    title = table.get("title", case)
    if not isinstance(title, str):
        raise InputError(f"{origin.of('title')}: title = {toml_text(title)}: allowed is text in quotes.")
    chosen = {"scene": table.get("scene"), "engine": table.get("engine", ENGINES[0])}
    for key, choices in (("scene", SCENES), ("engine", ENGINES)):
        if chosen[key] not in choices:
            given = "missing" if chosen[key] is None else toml_text(chosen[key])
            near = nearest(str(chosen[key]), choices)
            raise InputError(f"{origin.of(key)}: {key} = {given}{near}: allowed is one of " + ", ".join(f'"{choice}"' for choice in choices) + ".")
    chosen["decks_directory"] = _decks_directory(table.get("decks_directory"), origin)
    sections = {section: _section(section, table.get(section, {}), origin) for section in SECTIONS}
    run = RunCase(case=case, name=name, group=group, title=title, **chosen, **sections)
    for key, trouble in problems(run):
        section, _, last = key.partition(".")
        value = toml_text(getattr(getattr(run, section), last))
        raise InputError(f"{origin.of(key)}: {key} = {value} (run {name}): {trouble}.")
    return run


def _decks_directory(given: Any, origin: _Origin) -> str:
    """Absolute path of the decks: a relative one starts from the case file's directory, on the command line from the current one."""
    if given is None:
        return str(DECKS)
    if not isinstance(given, str) or not given:
        raise InputError(f"{origin.of('decks_directory')}: decks_directory = {toml_text(given)}: allowed is a path in quotes.")
    start = Path() if "decks_directory" in origin.command_line else Path(origin.source).parent
    directory = (start / given).resolve()
    if not directory.is_dir():
        raise InputError(
            f"{origin.of('decks_directory')}: decks_directory = {toml_text(given)}: there is no directory {directory}. Copy liggghts-inputs, change the "
            "copy, and name it here."
        )
    return str(directory)


def _section(section: str, table: Any, origin: _Origin) -> Any:
    kind = SECTIONS[section]
    if not isinstance(table, dict):
        raise InputError(f"{origin.of(section)}: {section} = {toml_text(table)}: this is the name of a section; write [{section}] and its keys below it.")
    fields = {field.name: field for field in dataclasses.fields(kind)}
    _refuse_unknown(table, set(fields), section, origin)
    try:
        return _CONVERTER.structure(table, kind)
    except cattrs.ClassValidationError as errors:
        note = next(note for error in errors.exceptions for note in error.__notes__ if isinstance(note, cattrs.AttributeValidationNote))
        key = f"{section}.{note.name}"
        raise InputError(f"{origin.of(key)}: {key} = {toml_text(table[note.name])}: allowed is {allowed_text(fields[note.name])}.") from None
