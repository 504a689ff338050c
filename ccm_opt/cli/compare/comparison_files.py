"""Files of a comparison of planners: tables and statistics, and the problems as files."""

import csv
import io
import json
import math
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path, PurePosixPath

import numpy as np
import tomlkit

from ccm_opt.cli.compare.methods import method_named
from ccm_opt.cli.compare.running import Comparison, Pair
from ccm_opt.cli.compare.runs import QUANTITIES, Run
from ccm_opt.cli.compare.statistics import LEVEL, ConfidenceInterval, FigurePair
from ccm_opt.cli.compare.suites import Case
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.files import put_file_or_refuse
from ccm_opt.io.problem_data import problem_data, recorded_data
from ccm_opt.problem import Problem
from ccm_opt.scene.bodies import Body

JOURNAL = "journal.jsonl"
TABLE = "runs.csv"
RECORD = "comparison.json"
PAGE = "comparison.html"


def write_comparison(comparison: Comparison, folder: Path, page: str) -> None:
    """Write table, statistics and HTML report of a comparison into a folder, each file atomically.

    Args:
        comparison: results to write.
        folder: existing folder that contains the journal.
        page: text of the HTML report; if empty, none is written.

    Raises:
        ProblemError: a file cannot be written.
    """
    files = {TABLE: runs_csv(comparison), RECORD: comparison_json(comparison)} | ({PAGE: page} if page else {})
    for name, content in files.items():
        put_file_or_refuse(folder / name, content.encode())


def runs_csv(comparison: Comparison) -> str:
    """Return a CSV table with one row per run: problem, method, outcome, figures, wall time, candidate, reason.

    Names of figures end in their unit; missing values are empty.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keys = [quantity.key for quantity in QUANTITIES]
    writer.writerow(["problem", "method", "outcome", *keys, "wall_s", "tactic", "reason"])
    for row in comparison.runs:
        for run in row:
            figures = [run.figures.get(key, "") for key in keys]
            writer.writerow([run.problem, run.method, run.outcome, *figures, run.wall, run.tactic, run.reason])
    return text.getvalue()


def comparison_json(comparison: Comparison) -> str:
    """Return the statistics of a comparison as JSON text: every method, every pair of methods, and every failed run."""
    data = {
        "schema": 1,
        "level": LEVEL,
        "problems": list(comparison.problems),
        "methods": [_method(comparison, name) for name in comparison.methods],
        "pairs": [_pair(pair) for pair in comparison.pairs],
        "failures": [
            {"problem": run.problem, "method": run.method, "outcome": run.outcome, "reason": run.reason}
            for run in comparison.failures
        ],
    }
    return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def medians(runs: Sequence[Run]) -> dict[str, float]:
    """Return the median of each figure over the solved runs that have it, by the figure's key; NaN if none has it."""
    found = {
        item.key: [run.figures[item.key] for run in runs if run.solved and item.key in run.figures]
        for item in QUANTITIES
    }
    return {key: float(np.median(values)) if values else math.nan for key, values in found.items()}


def _method(comparison: Comparison, name: str) -> dict[str, object]:
    count, interval = comparison.solved(name)
    runs = comparison.method_runs(name)
    return {
        "name": name,
        "summary": method_named(name).summary,
        "solved": count,
        "problems": len(runs),
        "share_interval": _bounds(interval),
        "outcomes": dict(Counter(run.outcome for run in runs)),
        "medians": {key: _number(value) for key, value in medians(runs).items()},
        "cpu_of_all_s": sum(run.figures.get("cpu_s", 0.0) for run in runs),
    }


def _pair(pair: Pair) -> dict[str, object]:
    success = asdict(pair.success) | {"interval": _bounds(pair.success.interval)}
    return {
        "first": pair.first,
        "second": pair.second,
        "success": success,
        "figures": {item.quantity.key: _figure(item) for item in pair.figures},
    }


def _figure(item: FigurePair) -> dict[str, object]:
    return {
        "pairs": item.pairs,
        "first_median": _number(item.first),
        "second_median": _number(item.second),
        f"median_{item.quantity.scale}": _number(item.effect),
        "interval": _bounds(item.interval),
        "first_better": _number(item.better),
        "wilcoxon_p": _number(item.p_value),
    }


def _bounds(interval: ConfidenceInterval) -> list[float | None]:
    return [_number(interval.low), _number(interval.high)]


def _number(value: float) -> float | None:
    # JSON has neither NaN nor infinity.
    return value if math.isfinite(value) else None


FOLDER = "problems"
"""Name of the folder of problem files in the output folder of a comparison."""
MESH_FOLDER = "meshes"
"""Name of the folder of mesh files in the folder of problem files."""
_DIGITS = 12
"""Number of digits of a mesh's SHA-256 in its file name."""


def write_problems(cases: Sequence[Case], folder: Path) -> tuple[Path, ...]:
    """Write every problem as ``<name>.toml``, with its meshes, and return the paths of the files.

    Angles are converted to degrees, so their last bits may differ.

    Args:
        cases: the problems.
        folder: folder for the files, created if necessary; identical files in the folder are not written again.

    Returns:
        Paths of the problem files, in the order of ``cases``.

    Raises:
        ProblemError: a file cannot be written, or exists with different content.
    """
    files = []
    for case in cases:
        file = folder / f"{case.name}.toml"
        problem = case.problem()
        if problem.dimension == 3:
            for mesh, content in mesh_files(problem).items():
                _write(folder / mesh, content)
        _write(file, problem_text(problem).encode())
        files.append(file)
    return tuple(files)


def problem_text(problem: Problem) -> str:
    """Return the text of a problem file: the original one if it needs no other files, else a newly written text."""
    if problem.dimension == 3:
        return tomlkit.dumps(problem_data(problem, [_mesh_name(each.body) for each in problem.workspace.obstacles]))
    data = recorded_data(problem)
    # A text that names other files is not complete: those would have to be written too.
    if problem.source and tomllib.loads(problem.source) == data:
        return problem.source
    return tomlkit.dumps(data)


def mesh_files(problem: Problem) -> dict[str, bytes]:
    """Return the contents of a problem's mesh files, by path relative to the problem file.

    Meshes of equal content have the same path in all problems.
    """
    return {_mesh_name(body): body.content for _, _, body in problem.workspace.meshes}


def _mesh_name(body: Body) -> str:
    """Return the path of an obstacle's mesh file, relative to the problem file; empty for other solids."""
    if body.kind != "mesh":
        return ""
    file = PurePosixPath(body.file)
    return f"{MESH_FOLDER}/{file.stem}-{body.digest[:_DIGITS]}{file.suffix}"


def _write(file: Path, content: bytes) -> None:
    """Write a file unless it exists with identical content.

    Raises:
        ProblemError: the file cannot be written, or exists with different content.
    """
    try:
        written = file.read_bytes() if file.exists() else None
    except OSError as error:
        raise ProblemError(f"cannot write {file}: {error.strerror or error}") from error
    if written is None:
        put_file_or_refuse(file, content)
    elif written != content:
        raise ProblemError(f"{file} exists with other contents; choose another --out, or remove it")
