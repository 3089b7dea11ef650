"""`poreslip plot DIR...`: figures, tables, claims and a page from the files of runs."""

from __future__ import annotations

import argparse
import platform
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from . import claims, page, tables
from .claims_coupling import pair_findings
from .claims_onset import ONSET_CLAIMS, SUPPLEMENT_CLAIMS
from .claims_stress import STRESS_CLAIMS
from .coupling_pairs import split_off_pairs
from .errors import BadOption, RunFileError
from .figure_style import Picture
from .figures_bonds import broken_bonds
from .figures_coupling import one_way_and_two_way
from .figures_curves import onsets_over_packs, slip_histories, strain_rate, stress_strain
from .figures_forces import displacement_and_chains, force_histograms
from .figures_scene import scene
from .results import MeasuredPack, MeasuredVariant, measure
from .run_sets import find_members, find_runs, sort_runs
from .samples import is_sample


def parser() -> argparse.ArgumentParser:
    described = argparse.ArgumentParser(prog="poreslip plot", description="Onset of slip, figures, tables and the paper's claims, from the files of runs.",
                                        epilog="example: poreslip plot out/quick out/full --out pictures --pdf")
    described.add_argument("directories", nargs="+", type=Path, metavar="DIR",
                           help="directory of a run (holds history.csv) or of a case (holds runs.json); several packs, seeds and parameters may be mixed")
    described.add_argument("--out", type=Path, metavar="DIR", help="where to write (default: plots/ in the first DIR)")
    described.add_argument("--pack", metavar="SEED", help="seed of the pack that the figures show (default: the first of each set of parameters)")
    described.add_argument("--dpi", type=int, default=220, help="resolution of the PNG files (default: 220)")
    described.add_argument("--pdf", action="store_true", help="write every figure as PDF as well")
    described.add_argument("--no-snapshots", action="store_true", help="leave out the figures which need snapshots (scene, force chains, histograms)")
    return described


def chosen_pack(variant: MeasuredVariant, seed: str | None) -> MeasuredPack:
    """The pack with `seed`; without it, the first of those with the most cases."""
    if seed is None:
        return max(variant.packs, key=lambda pack: len(pack.runs))
    for pack in variant.packs:
        if pack.seed == seed:
            return pack
    raise BadOption(f"--pack {seed}: there is no such pack; the seeds are {', '.join(pack.seed for pack in variant.packs)}")


def draw(variant: MeasuredVariant, pack: MeasuredPack, directory: Path, prefix: str, options: argparse.Namespace) -> tuple[Picture, ...]:
    """All figures of one variant."""
    how = (options.dpi, options.pdf)
    pictures: list[Picture | None] = []
    if not options.no_snapshots:
        pictures.append(scene(pack.runs, directory, f"{prefix}scene", *how))
        pictures.append(displacement_and_chains(pack.runs, directory, f"{prefix}displacement-and-force-chains", *how))
        pictures.append(force_histograms(pack.runs, directory, f"{prefix}contact-forces", *how))
    if variant.scene != "supplement":  # there the stresses are held, and strain rate against stress shows nothing
        pictures.append(strain_rate(pack, directory, f"{prefix}strain-rate", *how))
    pictures.append(slip_histories(pack, directory, f"{prefix}slip", *how))
    pictures.append(stress_strain(pack, directory, f"{prefix}stress-strain", *how))
    pictures.append(onsets_over_packs(variant, directory, f"{prefix}onsets", *how))
    pictures.append(broken_bonds(pack.runs, directory, f"{prefix}broken-bonds", *how))
    return tuple(picture for picture in pictures if picture is not None)


def findings_of(variants: Sequence[MeasuredVariant]) -> list[claims.Finding]:
    """All claims on all variants; those of a scene that was not given are "not tested"."""
    two_sides = ONSET_CLAIMS + STRESS_CLAIMS
    found = claims.judge(variants, two_sides, "two_sides") or claims.not_given(two_sides, 'no run of the scene "two_sides" was given')
    return found + (claims.judge(variants, SUPPLEMENT_CLAIMS, "supplement")
                    or claims.not_given(SUPPLEMENT_CLAIMS, 'no run of the scene "supplement" was given'))


def versions() -> str:
    import matplotlib
    import numpy

    return f"Python {platform.python_version()}, numpy {numpy.__version__}, matplotlib {matplotlib.__version__}"


def output_directory(options: argparse.Namespace) -> Path:
    """Where to write; made if need be."""
    directory = options.out or options.directories[0] / "plots"
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadOption(f"--out {directory}: it cannot be made ({error.strerror}); name another directory") from None
    return directory


def make_any(options: argparse.Namespace, command: str) -> tuple[Path, list[str], list[str]]:
    """Runs of a fault, or of samples; gives the page's path, warnings, and lines to print."""
    if not 50 <= options.dpi <= 1200:
        raise BadOption(f"--dpi {options.dpi}: give a number from 50 to 1200")
    members, passed_over = find_members(options.directories)
    samples = [is_sample(member) for member in members]
    if all(samples):
        from .sample_page import make as make_samples

        path, warnings, told = make_samples(members, output_directory(options), options.dpi, options.pdf, command, versions())
        return path, passed_over + warnings, told
    if any(samples):
        raise BadOption(f"{members[samples.index(True)]} is a sample without a fault, and {members[samples.index(False)]} is not: name either kind alone")
    path, warnings, findings = make(options, command)
    return path, warnings, [
        f"({finding.claim}) {finding.statement}: {finding.verdict}" + (f" [{variant}]" if variant else "")
        for variant, chosen in claims.chief(findings).items() for finding in chosen]


def make(options: argparse.Namespace, command: str) -> tuple[Path, list[str], list[claims.Finding]]:
    """Read, measure, draw and write; gives the page's path, warnings and findings."""
    runs, warnings = find_runs(options.directories)
    warnings += [warning for run in runs for warning in run.warnings]
    pairs, single = split_off_pairs(runs)
    variants = measure(sort_runs(single)) if single else ()
    packs = [chosen_pack(variant, options.pack) for variant in variants]
    directory = output_directory(options)
    findings = (findings_of(variants) if variants else []) + pair_findings(pairs)
    scatter, shifts = tables.scatter_table(variants), tables.variant_shifts(variants)
    if variants:
        tables.run_table(variants).to_csv(directory / "table.csv", index=False)
        scatter.to_csv(directory / "scatter.csv", index=False)
    claims.table(findings).to_csv(directory / "claims.csv", index=False)
    if len(shifts):
        shifts.to_csv(directory / "shifts.csv", index=False)
    figures = [page.VariantFigures(variant, pack.seed, draw(variant, pack, directory, f"variant-{index}-" if len(variants) > 1 else "", options))
               for index, (variant, pack) in enumerate(zip(variants, packs), start=1)]
    couplings = [one_way_and_two_way(pair, directory, f"coupling-{index}" if len(pairs) > 1 else "coupling", options.dpi, options.pdf)
                 for index, pair in enumerate(pairs, start=1)]
    titles = list(dict.fromkeys(str(run.case.get("title") or run.name) for run in runs))
    title = titles[0] if len(titles) == 1 else "Two sides of a fault: " + ", ".join(dict.fromkeys(str(run.case.get("case", run.name)) for run in runs))
    (directory / "page.html").write_text(page.write(title, command, versions(), warnings, figures, couplings, findings, scatter, shifts), encoding="utf-8")
    return directory / "page.html", warnings, findings


def main(argv: Sequence[str] | None = None) -> int:
    """Exit status 0, or 2 after one message on what is wrong with the input."""
    argv = list(sys.argv[1:] if argv is None else argv)
    try:
        options = parser().parse_args(argv)
    except SystemExit as left:
        return int(left.code or 0)
    try:
        written, warnings, told = make_any(options, "poreslip plot " + shlex.join(argv))
    except (RunFileError, BadOption) as error:
        print(f"poreslip plot: {error}", file=sys.stderr)
        return error.exit_status
    for warning in warnings:
        print(f"poreslip plot: warning: {warning}", file=sys.stderr)
    for line in told:
        print(line)
    print(f"written: {written}")
    return 0
