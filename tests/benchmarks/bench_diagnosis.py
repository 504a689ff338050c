"""Diagnose problems that cannot be solved: ``python -m tests.benchmarks.bench_diagnosis --seeds 0 10``.

Every problem of the six families (``tests/diagnosis_families.py``) is solved by the command line in a process of its
own; what is judged is what it writes and prints. User CPU is of the whole process, start and loading included. The
time limit is wall time: raise it on a busy machine.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomlkit

from tests.diagnosis_families import FAMILIES, Case, make_case
from tests.diagnosis_judgement import named_rightly, relaxation_error

PROGRAM = "from ccm_opt.cli import main; main()"
CLOSE = 0.05
"""Relative error of a relaxation that counts as close."""


@dataclass(frozen=True)
class Outcome:
    """What came of one problem.

    Attributes:
        case: the problem.
        code: exit code.
        named: whether the first finding is of the right kind and its reason has the right names.
        error: relative distance of the relaxation found from the threshold; infinite when there is none.
        seconds: user CPU [s].
        reason: what was printed first.
    """

    case: Case
    code: int
    named: bool
    error: float
    seconds: float
    reason: str

    @property
    def good(self) -> bool:
        """Whether all that is asked for holds, but for time."""
        return self.code == 3 and self.named and self.error <= CLOSE


def diagnosed(case: Case, folder: Path, time_limit: float) -> Outcome:
    """Run the command line on a problem, with a time limit [s], and judge its record."""
    path = folder / f"{case.data['name']}.toml"
    path.write_text(tomlkit.dumps({**case.data, "planner": {"time_limit": time_limit}}))
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", PROGRAM, "solve", str(path), "--out", str(folder / "runs")]
    begin = os.times().children_user
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    seconds = os.times().children_user - begin
    record = folder / "runs" / case.data["name"] / "solution.json"
    if done.returncode != 3 or not record.is_file():
        return Outcome(case, done.returncode, named=False, error=np.inf, seconds=seconds, reason=done.stderr[-300:])
    diagnosis = json.loads(record.read_text())["diagnosis"]
    return Outcome(
        case, 3, named_rightly(case, diagnosis), relaxation_error(case, diagnosis), seconds, diagnosis["reason"]
    )


def main() -> None:
    """Print one line a family, and every problem that was not diagnosed as it should be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 10), metavar=("FIRST", "END"))
    parser.add_argument("--families", nargs="+", default=FAMILIES, choices=FAMILIES)
    parser.add_argument("--time-limit", type=float, default=60.0, help="of every problem [s]")
    parser.add_argument("--list", action="store_true", help="print every reason")
    arguments = parser.parse_args()
    everything: list[Outcome] = []
    print(f"{'family':12s} {'named':>8s} {'within 5 %':>11s} {'error':>22s} {'user CPU [s]':>22s}")
    with tempfile.TemporaryDirectory() as folder:
        for family in arguments.families:
            outcomes = [
                diagnosed(make_case(family, seed), Path(folder), arguments.time_limit)
                for seed in range(*arguments.seeds)
            ]
            print(line(family, outcomes), flush=True)
            everything += outcomes
    print(line("all", everything))
    for outcome in everything:
        if arguments.list or not outcome.good or outcome.seconds > 5.0:
            figures = f"code {outcome.code}, named {outcome.named}, error {outcome.error:.3f}, {outcome.seconds:.2f} s"
            print(f"{outcome.case.data['name']}: {figures}: {outcome.reason}")


def line(name: str, outcomes: list[Outcome]) -> str:
    """Counts, and median and worst of error and time."""
    errors = np.array([outcome.error for outcome in outcomes])
    seconds = np.array([outcome.seconds for outcome in outcomes])
    named = sum(outcome.named for outcome in outcomes)
    close = int(np.sum(errors <= CLOSE))
    spread = f"{np.median(errors):.3f}, worst {errors.max():.3f}"
    times = f"{np.median(seconds):.2f}, worst {seconds.max():.2f}"
    return f"{name:12s} {named:4d}/{len(outcomes):3d} {close:7d}/{len(outcomes):3d} {spread:>22s} {times:>22s}"


if __name__ == "__main__":
    main()
