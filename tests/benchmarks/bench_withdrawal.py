"""Ways into narrow places and their reverses: what is found, CPU and duration against the way in; prints tables.

    python -m tests.benchmarks.bench_withdrawal --seeds 100 104 --kinds tip arm

Every way in is planned first; its reverse begins where the verified motion ended, so that it certainly has a solution.
User CPU of planning in this process. Set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from ccm_opt.problem import Problem
from tests.benchmarks.bench_planning import head, row, warm_up
from tests.benchmarks.scene_families import NoSceneError
from tests.benchmarks.withdrawal_scenes import NAMES, way_in, way_out
from tests.planned_runs import Run, quantile, run

KINDS = ("place", "tip", "arm")
"""What the reverse wants back: the tip's place, its heading too, the whole arm."""


@dataclass(frozen=True)
class Reversal:
    """A way in and its reverse.

    Attributes:
        there: the way in, verified.
        back: the reverse.
    """

    there: Run
    back: Run

    @property
    def slower(self) -> float:
        """CPU of the reverse over that of the way in."""
        return self.back.seconds / self.there.seconds

    @property
    def longer(self) -> float:
        """Duration of the reverse over that of the way in; NaN where there is none."""
        return self.back.duration / self.there.duration


def main() -> None:
    """Parse the options, plan both ways, and print a table for every kind of goal."""
    options = _options()
    warm_up()
    reversals: dict[tuple[str, str], list[Reversal]] = defaultdict(list)
    missed: dict[str, int] = defaultdict(int)
    end = time.monotonic() + 60.0 * options.minutes
    for family, problem in takewhile(lambda _: time.monotonic() < end, _ways_in(options)):
        there = run(problem)
        if there.outcome != "verified" or there.trajectory is None:
            missed[family] += 1
            print(f"- {there.name}: {there.outcome} after {there.seconds:.1f} s. {there.reason}", flush=True)
            continue
        for kind in options.kinds:
            both = Reversal(there, run(way_out(problem, there.trajectory, kind)))
            reversals[kind, family].append(both)
            _report(both)
    for kind in options.kinds:
        _table(kind, {family: reversals[kind, family] for family in options.families}, missed)


def _ways_in(options: argparse.Namespace) -> Iterator[tuple[str, Problem]]:
    """The problems with their families; seeds without a scene are left out."""
    for seed in range(*options.seeds):
        for family in options.families:
            try:
                yield family, way_in(family, seed, options.time_limit)
            except NoSceneError:
                continue


def _report(both: Reversal) -> None:
    back = both.back
    print(
        f"- {back.name}: {back.outcome}, {back.seconds:.1f} s ({both.there.seconds:.1f}), "
        f"duration {back.duration:.2f} s ({both.there.duration:.2f}), {back.candidate}{back.reason}",
        flush=True,
    )


def _table(kind: str, families: dict[str, list[Reversal]], missed: dict[str, int]) -> None:
    print(f"\nback to the {kind}:\n")
    head(
        *("scenes", "no way in", "ways in", "found", "CPU in, median [s]", "CPU back, median [s]", "90 %", "longest"),
        *("CPU ratio, median", "at most 2", "duration ratio, median", "at most 1.2"),
    )
    everything = [both for items in families.values() for both in items]
    for name, items in {**families, "all": everything}.items():
        if not items:
            continue
        back = [both.back.seconds for both in items]
        slower = np.array([both.slower for both in items])
        longer = np.array([both.longer for both in items])
        row(
            name,
            sum(missed.values()) if name == "all" else missed[name],
            len(items),
            sum(both.back.outcome == "verified" for both in items),
            f"{quantile([both.there.seconds for both in items], 0.5):.2f}",
            *(f"{quantile(back, share):.2f}" for share in (0.5, 0.9, 1.0)),
            f"{np.median(slower):.2f}",
            int(np.count_nonzero(slower <= 2.0)),
            f"{np.nanmedian(longer):.2f}",
            int(np.count_nonzero(longer <= 1.2)),
        )


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument("--seeds", nargs=2, type=int, default=[0, 3], metavar=("FIRST", "END"))
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=["tip"])
    parser.add_argument("--time-limit", type=float, default=40.0, help="of each plan [s]")
    parser.add_argument("--minutes", type=float, default=np.inf, help="wall time after which no other way in is begun")
    return parser.parse_args()


if __name__ == "__main__":
    main()
