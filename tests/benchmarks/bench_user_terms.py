"""What own constraints and costs cost: ``python -m tests.benchmarks.bench_user_terms``.

Every row is one problem, solved in turn without and with terms of its own; user CPU of whole solves, medians. The last
column is the ratio of the two medians. The first rows have a bound that never binds, so that it is the rows' own price.
"""

import argparse
import resource
import runpy
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import ccm_opt
from ccm_opt.problem import Problem

ROOT = Path(__file__).parents[2]
IDLE = ccm_opt.Constraint("idle", lambda q: q.joint_positions[1, 1:], lower=-10.0)


@dataclass(frozen=True)
class Case:
    """One row: a problem and the terms it is solved with."""

    name: str
    problem: Problem
    constraints: Sequence[ccm_opt.Constraint] = ()
    costs: Sequence[ccm_opt.Cost] = ()


def cases() -> list[Case]:
    """Shared problems with a bound that never binds, then the examples."""
    idle = [
        Case(f"{name}, idle bound", ccm_opt.load_problem(ROOT / "problems" / f"{name}.toml"), [IDLE])
        for name in ("open-space", "fold-and-reach", "s-duct")
    ]
    look, middle, path, torque = (
        runpy.run_path(str(next((ROOT / "examples").glob(f"{number}_*.py")))) for number in ("02", "03", "04", "08")
    )
    return [
        *idle,
        Case("look at a point", look["inspection"](), look["CONSTRAINTS"]),
        Case("keep the middle up", middle["reaching"](), [middle["middle_third_above_the_line"]]),
        Case("follow a tip path", path["PROBLEM"], [path["tip_on_the_seam"]]),
        Case("prefer low torque", torque["swing"](), [], [torque["holding_effort"]]),
    ]


def spent(case: Case, *, own: bool) -> tuple[float, float]:
    """User CPU of one solve [s], and the worst residual of a hard constraint."""
    began = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    solution = ccm_opt.solve(case.problem, constraints=case.constraints if own else (), costs=case.costs if own else ())
    cpu = resource.getrusage(resource.RUSAGE_SELF).ru_utime - began
    return cpu, max((c.worst for c in solution.checks if c.name.startswith("constraint ")), default=0.0)


def main() -> None:
    """Print one line for each case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=5, help="solves of each kind")
    parser.add_argument("--rows", type=int, default=None, help="of the table, from its first; all when left out")
    options = parser.parse_args()
    table = Table("problem and terms", "without [s]", "with [s]", "ratio", "worst residual")
    for case in cases()[: options.rows]:
        spent(case, own=False)
        plain, own = zip(*((spent(case, own=False), spent(case, own=True)) for _ in range(options.repeat)), strict=True)
        without, having = (float(np.median([cpu for cpu, _ in runs])) for runs in (plain, own))
        worst = max(residual for _, residual in own)
        table.add_row(case.name, f"{without:.2f}", f"{having:.2f}", f"{having / without:.2f}", f"{worst:.1e}")
    Console().print(table)


if __name__ == "__main__":
    main()
