"""The command `poreslip`: its arguments, and how an error ends all ranks with one message."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from coupling import __version__
from coupling.errors import InputError, PoreslipError

_DESCRIPTION = "Fault slip under pore pressure, grain by grain: discrete elements coupled with a pore network."
_EPILOG = """\
examples:
  poreslip run cases/two_sides/quick.toml                    the five pressure cases on a small pack
  poreslip run cases/two_sides/quick.toml --dry-run          what that would do, and how long it would take
  poreslip run cases/two_sides/full.toml --only case2 --set pack.seed=2
  mpirun -n 4 poreslip run cases/two_sides/full.toml         the same on four cores
  poreslip study cases/studies/coupling_interval.toml        error against run time, and the setting to choose
  poreslip stability                                         stiff and extreme scenes: which are stable, which are refused, and why
  poreslip plot out/quick                                    figures and onsets from the results

exit status: 0 done; 2 bad input (the message says what to correct); 3 the computation failed."""
_RUN_DESCRIPTION = """\
Carry out the runs of a case file. Results go to DIR/<case>/<run>/: case.json (every input), history.csv, report.md and what the
case asks for besides. Ctrl-C stops cleanly after the current interval; what was written stays readable."""
_RUN_EPILOG = """\
keys for --set are those of the case file, section.key, and hold for every run, over what the file says:
  --set pack.seed=3   --set loading.strain_rate_per_s=0.78   --set 'sweep.seeds=[1, 2, 3]'   --set pressure.mode=none
entries of a table join those of the file; an empty table leaves none:
  --set fluid.faces.zmin=0   --set 'fluid.faces={}'"""
_STUDY_DESCRIPTION = """\
Carry out every setting of a study, each in a process of its own, and hold it against the study's reference. Results go to DIR/<study>/:
error_time.csv, error_time.png, and study.md, which names the cheapest setting within the tolerance. Runs that are there from before with the
same inputs and the same sources (DIR/runs) are not repeated: after Ctrl-C the same command goes on. Each line tells the revision of the code that
made it; --keep takes runs of other revisions too. A setting that is refused, or breaks down, is a line with its
reason."""
_STABILITY_DESCRIPTION = """\
Carry out stiff and extreme scenes, each in a process of its own with a limit on its time: whether it is stable or caught by the program, the figure
that says so, and limits found against limits predicted. Some minutes. Writes DIR/stability.csv and DIR/stability.md; exit status 3 if a scene ends
in another way than it may."""
_TEST_DESCRIPTION = """\
Run the tests with pytest: those of seconds and of a minute or so; with --all also those marked slow. Other arguments are pytest's own,
such as tests/unit, -k bond or -x."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command; the exit status."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        return _dispatch(arguments)
    except PoreslipError as error:
        return _end_together(str(error), error.exit_status)
    except OSError as error:
        return _end_together(f"{error}. Check that the path exists, may be written, and that the disk has room.", InputError.exit_status)
    except KeyboardInterrupt:
        return 130
    except Exception:
        # A defect, or a failure of one rank alone: the others may be waiting for this one, so end them too.
        traceback.print_exc()
        if _size() > 1 and _mpi_runs():
            from mpi4py import MPI

            MPI.COMM_WORLD.Abort(1)
        return 1


def _dispatch(arguments: list[str]) -> int:
    # These two take arguments of their own, which argparse would refuse or reorder.
    if arguments[:1] == ["plot"]:
        from postproc.command_line import main as plot

        return plot(arguments[1:])
    if arguments[:1] == ["test"] and not {"-h", "--help"} & set(arguments):
        return _test(arguments[1:])
    parser = _parser()
    if not arguments:
        parser.print_help()
        return 2
    chosen = parser.parse_args(arguments)
    return chosen.action(chosen)


class _Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are InputErrors and whose help is printed by rank 0 alone."""

    def error(self, message: str) -> Any:
        raise InputError(f"{message}. `{self.prog} --help` shows what may be given.")

    def _print_message(self, message: str, file: IO[str] | None = None) -> None:
        if _rank() == 0:
            super()._print_message(message, file)


def _parser() -> argparse.ArgumentParser:
    form = {"formatter_class": argparse.RawDescriptionHelpFormatter, "allow_abbrev": False}
    parser = _Parser(prog="poreslip", description=_DESCRIPTION, epilog=_EPILOG, **form)
    parser.add_argument("--version", action="version", version=f"poreslip {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=_Parser)

    run = commands.add_parser("run", help="carry out the runs of a case file", description=_RUN_DESCRIPTION, epilog=_RUN_EPILOG, **form)
    run.add_argument("case", metavar="CASE", nargs="?", help="case file, such as cases/two_sides/quick.toml")
    run.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], dest="overrides", help="override one input; may be repeated")
    run.add_argument("--only", metavar="NAME", action="append", default=[], help="carry out this run only; may be repeated")
    run.add_argument("--out", metavar="DIR", help="directory of the results (default: out, in the current directory)")
    run.add_argument("--dry-run", action="store_true", help="print the plan (stages, steps, estimated time and memory) and stop")
    run.add_argument("--restart", metavar="DIR", help="continue the run whose results are in DIR, such as out/full/case2, from its newest checkpoint")
    run.add_argument("--checkpoint-every", metavar="N", help="write a checkpoint every N steps of loading (0: none)")
    # What the stability map finds limits with.
    run.add_argument("--unrefused", action="store_true", help=argparse.SUPPRESS)
    run.set_defaults(action=_run)

    study = commands.add_parser("study", help="error against run time over the settings of a study file", description=_STUDY_DESCRIPTION, **form)
    study.add_argument("study", metavar="STUDY", help="study file, such as cases/studies/coupling_interval.toml")
    study.add_argument("--out", metavar="DIR", help="directory of the results (default: out/studies, in the current directory)")
    study.add_argument("--dry-run", action="store_true", help="print the runs that it stands for, and which of them are kept from before")
    study.add_argument("--keep", action="store_true", help="take runs from before as they are, also those of another revision of the code")
    study.set_defaults(action=_study)

    stability = commands.add_parser("stability", help="stiff and extreme scenes: stable, refused or stopped, and by which limit", description=_STABILITY_DESCRIPTION, **form)
    stability.add_argument("--only", metavar="PATTERN", action="append", default=[], help="scenes of such names only, such as flow/lattice or 'grains/step/*/0.8'; may be repeated")
    stability.add_argument("--quick", action="store_true", help="some of the scenes, in half a minute")
    stability.add_argument("--list", action="store_true", help="print the scenes, and how each may end")
    stability.add_argument("--ranks", metavar="N", type=_count, default=1, help="MPI ranks of each scene that can be spread over them (default: 1)")
    stability.add_argument("--jobs", metavar="N", type=_count, default=1, help="scenes at a time (default: 1)")
    stability.add_argument("--out", metavar="DIR", help="directory of the results (default: out/stability, in the current directory)")
    stability.set_defaults(action=_stability)

    commands.add_parser("plot", help="figures, onsets of slip and claims from the results of runs", add_help=False)

    info = commands.add_parser("info", help="versions of poreslip and of all that it stands on", **form)
    info.set_defaults(action=_info)

    test = commands.add_parser("test", help="run the tests", description=_TEST_DESCRIPTION, **form)
    test.add_argument("--all", action="store_true", help="the slow tests too")
    return parser


def _run(chosen: argparse.Namespace) -> int:
    from coupling.case.files import load_case, select_runs
    from coupling.run_options import RunOptions

    overrides = list(chosen.overrides)
    if chosen.checkpoint_every is not None:
        overrides.append(f"output.checkpoint_every_steps={chosen.checkpoint_every}")
    if chosen.restart is not None:
        case_file, options = _restarted(chosen, overrides)
    else:
        if chosen.case is None:
            raise InputError("a case file is missing: poreslip run CASE, such as poreslip run cases/two_sides/quick.toml.")
        case_file = select_runs(load_case(chosen.case, overrides), chosen.only)
        options = RunOptions(output_root=_output_root(chosen.out), dry_run=chosen.dry_run, refuse_unstable=not chosen.unrefused)
    from coupling.driver import run_case_file

    return run_case_file(case_file, options) or 0


def _restarted(chosen: argparse.Namespace, overrides: list[str]) -> tuple[Any, Any]:
    """The one run of a directory of results, as it was started."""
    from coupling.case.files import run_case_from_dict
    from coupling.case.run_case import CaseFile
    from coupling.run_options import RunOptions

    refused = {"CASE": chosen.case, "--set": chosen.overrides, "--only": chosen.only, "--out": chosen.out}
    if given := [name for name, value in refused.items() if value]:
        raise InputError(f"--restart continues a run as it was started, so {', '.join(given)} cannot be given with it; leave it out.")
    directory = Path(chosen.restart)
    source = directory / "case.json"
    if not source.is_file():
        runs = ", ".join(sorted(str(found.parent) for found in directory.glob("*/case.json")))
        hint = f"runs found below it: {runs}" if runs else "give the directory of one run, such as out/full/case2"
        raise InputError(f"--restart {directory}: there is no case.json in it; {hint}.")
    try:
        resolved = json.loads(source.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{source} cannot be read as the case of a run ({error}); start the run anew from its case file.") from None
    if not isinstance(resolved, dict):
        raise InputError(f"{source} holds no table of inputs, so it is not the case of a run; start the run anew from its case file.")
    run = run_case_from_dict(resolved, str(source), overrides)
    options = RunOptions(output_root=directory.parent.parent, dry_run=chosen.dry_run, restart=directory)
    return CaseFile(stem=run.case, runs=(run,)), options


def _output_root(given: str | None) -> Path:
    root = Path("out" if given is None else given)
    existing = root
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir():
        raise InputError(f"--out {root}: {existing} is a file, so no directory can be made there; choose another.")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(f"--out {root}: no permission to write in {existing}; choose another directory.")
    return root


def _study(chosen: argparse.Namespace) -> int:
    if _size() > 1 or "OMPI_COMM_WORLD_SIZE" in os.environ:
        raise InputError("a study starts its runs itself: give `poreslip study` without mpirun, and `ranks` in the study file.")
    from coupling.study.carry_out import carry_out

    return carry_out(chosen.study, _output_root(chosen.out or "out/studies"), chosen.dry_run, chosen.keep)


def _count(text: str) -> int:
    """A whole number above 0, for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is no whole number above 0")
    return int(text)


def _stability(chosen: argparse.Namespace) -> int:
    if _size() > 1 or "OMPI_COMM_WORLD_SIZE" in os.environ:
        raise InputError("the stability map starts its processes itself: give `poreslip stability --ranks N` without mpirun.")
    from coupling.stability import carry_out

    if chosen.list:
        for scene in carry_out.chosen(chosen.only, chosen.quick):
            print(f"{scene.name:40s} {' or '.join(scene.expected):20s} {scene.what}")
        return 0
    return carry_out.stability(chosen.only, _output_root(chosen.out or "out/stability"), chosen.jobs, chosen.quick, chosen.ranks)


def _info(chosen: argparse.Namespace) -> int:
    from coupling.info import information

    if _rank() == 0:
        facts = information()
        width = max(len(name) for name, _ in facts)
        for name, value in facts:
            print(f"{name:<{width}}  {value}")
    return 0


def _test(arguments: list[str]) -> int:
    from coupling.native import REPOSITORY

    if "OMPI_COMM_WORLD_SIZE" in os.environ:
        raise InputError("the tests start mpirun themselves: run `poreslip test` without it.")
    marked = [] if "--all" in arguments else ["-m", "not slow"]
    rest = [argument for argument in arguments if argument != "--all"]
    os.chdir(REPOSITORY)
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", "pytest", *marked, *rest])


def _rank() -> int:
    """This process' rank as mpirun tells it, known before MPI is loaded."""
    return int(os.environ.get("OMPI_COMM_WORLD_RANK", "0"))


def _size() -> int:
    return int(os.environ.get("OMPI_COMM_WORLD_SIZE", "1"))


def _mpi_runs() -> bool:
    """Whether MPI was started in this process and not yet ended; looks without loading it."""
    module = sys.modules.get("mpi4py.MPI")
    return module is not None and module.Is_initialized() and not module.Is_finalized()


def _end_together(message: str, status: int, patience_s: float = 10.0) -> int:
    """Print the message on rank 0, and have every rank end with `status`.

    mpirun ends the other ranks as soon as one has ended with an error, so those others have to wait until rank 0 has printed.
    A rank that waits in vain met an error of its own and says it itself.
    """
    text = f"poreslip: {message}"
    if _rank() == 0:
        print(text, file=sys.stderr, flush=True)
    if _size() == 1:
        return status
    if _mpi_runs():
        from mpi4py import MPI

        reached = MPI.COMM_WORLD.Ibarrier()
        end = time.monotonic() + patience_s
        while not reached.Test():
            if time.monotonic() > end:
                if _rank() != 0:
                    print(f"{text} (rank {_rank()} alone)", file=sys.stderr, flush=True)
                MPI.COMM_WORLD.Abort(status)
            time.sleep(0.01)
    elif _rank() != 0:
        time.sleep(patience_s)
        print(f"{text} (rank {_rank()} alone)", file=sys.stderr, flush=True)
    return status
