"""What a comparison leaves on disk: ``runs.csv`` with a row a run, ``comparison.json`` with the statistics."""

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ccm_opt.comparison.methods import method_named
from ccm_opt.comparison.running import Comparison, Pair
from ccm_opt.comparison.runs import QUANTITIES, Run
from ccm_opt.comparison.statistics import LEVEL, ConfidenceInterval, FigurePair
from ccm_opt.errors import ProblemError
from ccm_opt.ground.whole_file import put_file

JOURNAL = "journal.jsonl"
TABLE = "runs.csv"
RECORD = "comparison.json"
PAGE = "comparison.html"


def write_comparison(comparison: Comparison, folder: Path, pictures: Mapping[str, bytes] | None = None) -> None:
    """Write the files of a comparison into a folder, each whole or not at all.

    Args:
        comparison: what came of it.
        folder: exists already, with the journal in it.
        pictures: content of pictures by file name.

    Raises:
        ProblemError: when a file cannot be written.
    """
    files = {TABLE: runs_csv(comparison).encode(), RECORD: comparison_json(comparison).encode(), **(pictures or {})}
    for name, content in files.items():
        try:
            put_file(folder / name, content)
        except OSError as error:
            raise ProblemError(f"cannot write {folder / name}: {error.strerror or error}") from error


def runs_csv(comparison: Comparison) -> str:
    """One row a run: problem, method, outcome, figures with their units, time, tactic, reason; empty where none."""
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
    """The statistics: every method by itself, every two of them by pairs, and every failure with its reason."""
    data = {
        "schema": 1,
        "level": LEVEL,
        "problems": list(comparison.problems),
        "methods": [_method(comparison, name) for name in comparison.methods],
        "pairs": [_pair(pair) for pair in comparison.pairs],
        "failures": [_failure(run) for run in comparison.failures],
    }
    return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def medians(runs: Sequence[Run]) -> dict[str, float]:
    """Median of every figure over the solved runs that have it, by key; NaN when none has."""
    found = {
        item.key: [run.figures[item.key] for run in runs if run.solved and item.key in run.figures]
        for item in QUANTITIES
    }
    return {key: float(np.median(values)) if values else math.nan for key, values in found.items()}


def _method(comparison: Comparison, name: str) -> dict[str, object]:
    count, interval = comparison.solved(name)
    runs = comparison.runs_of(name)
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


def _failure(run: Run) -> dict[str, object]:
    return {"problem": run.problem, "method": run.method, "outcome": run.outcome, "reason": run.reason}


def _bounds(interval: ConfidenceInterval) -> list[float | None]:
    return [_number(interval.low), _number(interval.high)]


def _number(value: float) -> float | None:
    # JSON knows neither NaN nor infinity.
    return value if math.isfinite(value) else None
