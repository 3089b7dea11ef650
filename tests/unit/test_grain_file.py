"""Files of grains: what is taken as it is meant, what is refused and at which line, on any number of ranks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

CASE = Path(__file__).with_name("grain_file_ranks.py")
COUNT = 500


def written(directory: Path) -> tuple[dict[str, Path], np.ndarray]:
    """Files of the same grains in several guises, and files with a fault; the grains, (n, 4)."""
    rng = np.random.default_rng(2)
    grains = np.column_stack([rng.random((COUNT, 3)) * [1.0, 3.0, 1.0], rng.uniform(0.01, 0.02, COUNT)])
    lines = [" ".join(f"{v:.17g}" for v in row) for row in grains]
    strewn = [part for k, line in enumerate(lines) for part in ([f"{line}   # the grain {k}"] if k % 3 else ["", "#\u00e9", "  \t" + line.replace(" ", "\t")])]
    columns = [f"{COUNT - 1 - k} 1 {line.rpartition(' ')[0]} 0.5 {line.rpartition(' ')[2]} iron" for k, line in enumerate(lines)]
    step = f"ITEM: TIMESTEP\n7\nITEM: NUMBER OF ATOMS\n{COUNT}\nITEM: BOX BOUNDS pp ff ff\n0 1\n0 3\n0 1\nITEM: ATOMS id type x y z vx radius element\n"
    dump = step + "\n".join(columns) + "\n"
    half = COUNT // 2
    long = " ".join(["0.5"] * 5000)
    texts = {
        "plain": "\n".join(lines) + "\n",
        "unended": "\n".join(lines),
        "windows": "\ufeff" + "\r\n".join(lines) + "\r\n",
        "strewn": "# x y z r\n" + "\n".join(strewn) + "\n\n\n",
        "marked": "\ufeff# x y z r\n" + "\n".join(lines),
        "dump": dump,
        "two steps": dump.replace("ATOMS\n500", "ATOMS\n499").replace(columns[-1] + "\n", "").replace(" 0.5 ", " 0.1 ") + dump,
        "windows dump": dump.replace("\n", "\r\n"),
        "bad word": "\n".join([*lines[:half], "0.1 0.2 O.3 0.01", *lines[half:]]),
        "bad late": "\ufeff" + "\r\n".join([*lines, "0.1 0.2 0.3 0.01 0.5"]),
        "two bad": "\n".join([*lines[:7], "first", *lines[7:], "last"]),
        "titled": "x y z r\n" + "\n".join(lines),
        "wide": "\n".join([*lines[:half], long]),
        "all wide": "\n".join([long] * 3),
        "decimal comma": "\n".join(line.replace(".", ",") for line in lines),
        "only comments": "# nothing\n\n",
        "bad dump": dump.replace(columns[400], columns[400].replace(" 1 ", " 1 x", 1)),
        "long dump": dump + columns[0] + "\n",
        "headless": step[: step.index("ITEM: ATOMS")],
    }
    paths = {name: directory / name for name in texts}
    for name, text in texts.items():
        paths[name].write_bytes(text.encode("latin-1" if name == "strewn" else "utf-8"))
    paths["utf16"] = directory / "utf16"
    paths["utf16"].write_text("\n".join(lines), encoding="utf-16")
    paths["directory"] = directory
    return paths, grains


EXPECTED = {
    "bad word": "bad word, line 251: '0.1 0.2 O.3 0.01' (4 words): expected four numbers",
    "bad late": "bad late, line 501: '0.1 0.2 0.3 0.01 0.5' (5 words): expected four numbers",
    "two bad": "two bad, line 8: 'first' (1 word): expected four numbers",
    "titled": "titled, line 1: 'x y z r' (4 words): expected four numbers",
    "wide": "wide, line 251: '0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 0.5 ...' (5000 words): expected four",
    "all wide": "all wide, line 1: '0.5 0.5",
    "decimal comma": "decimal comma, line 1: '0,",
    "only comments": "only comments holds no grains",
    "bad dump": "bad dump, line 410: '99 1 x0.",
    "long dump": "long dump has 501 lines for 500 grains",
    "headless": "headless is a dump whose last step has no ITEM: ATOMS",
    "utf16": "utf16: it is in UTF-16",
    "directory": "Is a directory",
}


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [1, 2, 4])
def test_each_rank_reads_its_share(mpirun, tmp_path, ranks):
    """Ranks: 1, 2 and 4."""
    paths, grains = written(tmp_path)
    out = tmp_path / "out.npz"
    done = mpirun(ranks, [CASE, out, *paths.values()])
    assert done.returncode == 0, done.stderr
    found = np.load(out)
    for name, path in paths.items():
        if name in EXPECTED:
            errors = found[f"{path.name} error"]
            assert len(set(errors)) == 1 and EXPECTED[name] in errors[0], errors
            continue
        np.testing.assert_array_equal(found[f"{name} id"], np.arange(COUNT))
        # a dump's ids run backwards here
        expected = grains[::-1] if "steps" in name or "dump" in name else grains
        np.testing.assert_array_equal(found[f"{name} grains"], expected)
        shares = found[f"{name} shares"]
        assert len(shares) == ranks and np.abs(shares - COUNT / ranks).max() <= 2
        assert len(found[f"{name} box"]) == (6 if expected is not grains else 0)
