"""Time and memory of ``ccm-opt solve`` as a user meets them: a process for every problem and number of links.

    python -m tests.benchmarks.bench_whole_process --links 24 96

CPU is that of the whole process with all that it starts, from loading to writing; memory is the most that it held. The
arm keeps its length, mass, radius and joint limit; 0 stands for the number of links in the file.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

import ccm_opt
from ccm_opt.core.length_words import METRES
from ccm_opt.problem import Problem
from tests.benchmarks.bench_planning import head, row

ENDINGS = {0: "solved", 2: "no such start", 3: "no plan", 4: "solved, not followed"}


@dataclass(frozen=True)
class Spent:
    """What one run took.

    Attributes:
        ending: how it ended, in words.
        cpu: of the whole process [s].
        planning: CPU of planning alone, NaN without a plan [s].
        duration: of the motion, NaN without one [s].
        memory: most that was resident [MB].
    """

    ending: str
    cpu: float
    planning: float
    duration: float
    memory: float


def resized(file: Path, problem: Problem, links: int) -> list[str]:
    """Options that give the arm so many links, all else as it was; none for the arm of the file."""
    if links in {0, problem.arm.links}:
        return []
    unit = tomllib.loads(file.read_text(encoding="utf-8")).get("units", "m")
    length = float(problem.arm.length) / links / METRES[unit]
    changes = {"arm.links": links, "arm.link_length": length, "arm.link_mass": float(sum(problem.arm.masses)) / links}
    return [word for key, value in changes.items() for word in ("--set", f"{key}={value!r}")]


def measured(file: Path, links: int, out: Path) -> Spent:
    """Solve a file in a process of its own."""
    problem = ccm_opt.load_problem(file)
    changes = resized(file, problem, links)
    command = [sys.executable, "-m", "ccm_opt", "solve", str(file), "--out", str(out), "--no-pictures", "--quiet"]
    process = subprocess.Popen([*command, *changes], stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    code = os.waitstatus_to_exitcode(status)
    process.returncode = code
    planning, duration = float("nan"), float("nan")
    record = out / problem.name / "solution.json"
    if code in {0, 4}:
        told = json.loads(record.read_text(encoding="utf-8"))
        planning = sum(told["timings"].get(stage, 0.0) for stage in ("free space", "configuration", "motion"))
        duration = told["metrics"]["duration_s"]
    spent = usage.ru_utime + usage.ru_stime
    return Spent(ENDINGS.get(code, f"exit {code}"), spent, planning, duration, usage.ru_maxrss / 1024.0)


def main() -> None:
    """Print a row for every problem and number of links."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, help="problem files; all of problems/ when left out")
    parser.add_argument("--links", nargs="+", type=int, default=[0])
    options = parser.parse_args()
    head("problem", "links", "ends", "total CPU [s]", "of it planning [s]", "motion [s]", "memory [MB]")
    with tempfile.TemporaryDirectory() as folder:
        for file in options.files or sorted(Path("problems").glob("*.toml")):
            for links in options.links:
                spent = measured(file, links, Path(folder))
                count = links or ccm_opt.load_problem(file).arm.links
                figures = (f"{spent.cpu:.1f}", f"{spent.planning:.2f}", f"{spent.duration:.1f}", f"{spent.memory:.0f}")
                row(file.stem, count, spent.ending, *figures)


if __name__ == "__main__":
    main()
