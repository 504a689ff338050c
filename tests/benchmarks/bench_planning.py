"""Planning: the shared problems, clutter, an S-duct of several widths, and soundness; prints Markdown tables.

    python -m tests.benchmarks.bench_planning nine --links 12 24 48 96 --repeat 3
    python -m tests.benchmarks.bench_planning clutter --polygons 20 40 80 --seeds 50000 50100
    python -m tests.benchmarks.bench_planning duct --widths 140 100 80 65 55 --links 24 36 48 96
    python -m tests.benchmarks.bench_planning soundness --seeds 60000 61000

User CPU of this process. "Found" is a certified C² path as the search finds it, "optimised" the same with the motion
optimised (the default of problem files); solvers that are built on the way count. Every plan is timed and passed to the
verifier. Set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product, takewhile
from typing import TypeAlias, get_args

import numpy as np

from ccm_opt.problem import JointPose, Limits, Problem, TipGoal
from tests.benchmarks.dense_sweep import Sweep, sweep
from tests.benchmarks.duct_scenes import s_duct
from tests.benchmarks.shared_problems import NAMES, problem_data, with_links
from tests.planned_runs import Outcome, Run, quantile, run
from tests.scenes import Scene, clutter, corridor

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
RATIO_OF = (96, 24)
"""Numbers of links whose planning times are compared."""


@dataclass(frozen=True)
class Pair:
    """A problem planned without and with optimisation of the motion, a number of times.

    Attributes:
        found: runs without.
        optimised: runs with.
    """

    found: tuple[Run, ...]
    optimised: tuple[Run, ...]

    @classmethod
    def of(cls, problem: Problem, repeat: int = 1, name: str = "") -> "Pair":
        """Plan a problem both ways, by turns."""
        kinds = [(run(problem, name, optimised=False), run(problem, name)) for _ in range(repeat)]
        found, optimised = (tuple(replace(item, trajectory=None) for item in runs) for runs in zip(*kinds, strict=True))
        return cls(found, optimised)

    @property
    def solved(self) -> bool:
        """Whether the optimised plan is verified."""
        return self.optimised[0].outcome == "verified"

    def seconds(self, *, optimised: bool) -> float:
        """Median user CPU [s]."""
        return quantile([item.seconds for item in (self.optimised if optimised else self.found)], 0.5)

    def cells(self) -> tuple[str, ...]:
        """Outcome, CPU and duration without and with optimisation, and the tactic."""
        found = self.found[0]
        optimised = self.optimised[0]
        return (
            found.outcome,
            optimised.outcome,
            f"{self.seconds(optimised=False):.2f}",
            f"{self.seconds(optimised=True):.2f}",
            f"{found.duration:.1f}",
            f"{optimised.duration:.1f}",
            optimised.candidate,
        )


PAIR_COLUMNS = (
    "found",
    "optimised",
    "found [s CPU]",
    "optimised [s CPU]",
    "duration found [s]",
    "optimised [s]",
    "tactic",
)


def head(*columns: str) -> None:
    """Print the head of a table."""
    row(*columns)
    row(*("---" for _ in columns))


def row(*cells: object) -> None:
    """Print a row of a table."""
    print(f"| {' | '.join(str(cell) for cell in cells)} |", flush=True)


def print_failures(runs: Iterable[Run]) -> None:
    """Print why runs failed."""
    print()
    for item in runs:
        if item.outcome != "verified":
            print(f"- {item.name}: {item.outcome} after {item.seconds:.1f} s. {item.reason}", flush=True)
    print()


def table(problems: Iterable[tuple[str, int, Callable[[], Problem]]], repeat: int) -> dict[tuple[str, int], Pair]:
    """Plan problems, named and with a number of links, and print a row for each."""
    pairs: dict[tuple[str, int], Pair] = {}
    head("problem", "links", *PAIR_COLUMNS)
    for name, links, make in problems:
        pair = pairs[name, links] = Pair.of(make(), repeat, f"{name}, {links} links")
        row(name, links, *pair.cells())
    print_failures(item for pair in pairs.values() for item in (pair.found[0], pair.optimised[0]))
    ratios(pairs)
    return pairs


def ratios(pairs: dict[tuple[str, int], Pair]) -> None:
    """Print planning times at many links against few, of the problems that are solved at both."""
    many, few = RATIO_OF
    found = {
        name: [pair.seconds(optimised=kind) / pairs[name, few].seconds(optimised=kind) for kind in (False, True)]
        for (name, links), pair in pairs.items()
        if links == many and pair.solved and (name, few) in pairs and pairs[name, few].solved
    }
    if not found:
        return
    head("problem", f"found, {many} / {few} links", f"optimised, {many} / {few} links")
    for name, values in found.items():
        row(name, *(f"{value:.2f}" for value in values))
    row("median", *(f"{value:.2f}" for value in np.median(list(found.values()), axis=0)))


def nine(options: argparse.Namespace) -> None:
    """The shared problems at several numbers of links."""
    warm_up()
    cases = product(options.problems, options.links)
    table(((name, n, partial(with_links, problem_data(name), n)) for name, n in cases), options.repeat)


def duct(options: argparse.Namespace) -> None:
    """The S-duct at several widths and numbers of links."""
    warm_up()
    cases = product(options.widths, options.links)
    table(((f"{width:g} mm", n, partial(s_duct, 1e-3 * width, n)) for width, n in cases), options.repeat)


def warm_up() -> None:
    """Load what is loaded lazily, on a scene that no table shows."""
    run(clutter(7, 5).problem())


def clutter_table(options: argparse.Namespace) -> None:
    """Random clutter at several densities."""
    warm_up()
    columns = ("solved", "median [s CPU]", "90 %", "longest", "refused or crashed", "duration, median [s]")
    head("polygons", "seeds", "", *columns)
    failed: list[Run] = []
    for count in options.polygons:
        pairs = [
            Pair.of(clutter(seed, count).problem(time_limit=options.time_limit), name=f"{count} polygons, seed {seed}")
            for seed in range(*options.seeds)
        ]
        kinds = {"found": [pair.found[0] for pair in pairs], "optimised": [pair.optimised[0] for pair in pairs]}
        for kind, runs in kinds.items():
            row(count, len(runs), kind, *clutter_cells(runs))
            failed += [item for item in runs if item.outcome != "verified"]
    print_failures(failed)


def clutter_cells(runs: list[Run]) -> tuple[str, ...]:
    """Figures of the runs of one density; times are over all runs, failed ones too."""
    seconds = [item.seconds for item in runs]
    outcomes = Counter(item.outcome for item in runs)
    durations = [item.duration for item in runs if item.outcome == "verified"]
    return (
        f"{outcomes['verified']} ({100 * outcomes['verified'] / len(runs):.0f} %)",
        *(f"{quantile(seconds, share):.2f}" for share in (0.5, 0.9, 1.0)),
        str(outcomes["refused"] + outcomes["crash"]),
        f"{quantile(durations, 0.5):.1f}",
    )


def random_problem(seed: int, time_limit: float) -> Problem:
    """A random problem: clutter or a duct, 12 to 60 links, one of three kinds of goals."""
    rng = np.random.default_rng([seed, 1])
    links = int(rng.choice((12, 18, 24, 36, 48, 60)))
    if rng.random() < 0.2:
        scene = corridor(seed, rng.uniform(0.07, 0.14), links)
    else:
        scene = clutter(seed, int(rng.choice((0, 10, 20, 40, 60))), links)
    generous = Limits(np.full(3 * links, 5.0), np.full(3 * links, 20.0))
    return replace(scene.problem(random_goal(rng, scene), time_limit), limits=generous)


def random_goal(rng: np.random.Generator, scene: Scene) -> TipGoal | JointPose:
    """One of the three kinds of goals at the scene's goal pose."""
    tip = scene.goal_tip
    goals = (tip, TipGoal(tip.position), JointPose(scene.arm.bends(scene.goal)))
    return goals[rng.integers(len(goals))]


def soundness(options: argparse.Namespace) -> None:
    """Random problems, planned, timed, verified, and swept densely by code of the tests alone."""
    warm_up()
    outcomes: dict[str, Counter[str]] = defaultdict(Counter)
    seen: list[Sweep] = []
    end = time.monotonic() + 60.0 * options.minutes
    for seed in takewhile(lambda _: time.monotonic() < end, range(*options.seeds)):
        problem = random_problem(seed, options.time_limit)
        planned = run(problem, f"seed {seed}", optimised=seed % 2 == 0)
        for group in groups(problem):
            outcomes[group][planned.outcome] += 1
        if planned.outcome in {"refused", "crash"} or (options.list and planned.outcome != "verified"):
            print(f"- seed {seed}: {planned.outcome}. {planned.reason}", flush=True)
        if planned.trajectory is not None:
            seen.append(sweep(problem, planned.trajectory))
            if seen[-1].violations:
                print(f"- seed {seed}: the sweep says: {'; '.join(seen[-1].violations)}", flush=True)
    print()
    outcome_table(outcomes)
    sweep_table(seen)


def groups(problem: Problem) -> tuple[str, ...]:
    """What a problem counts as: any, by its links, by its walls, by its goal."""
    goal = problem.goal
    kind = "whole arm" if not isinstance(goal, TipGoal) else "tip" if goal.heading is None else "tip and heading"
    duct_walls = any(wall.name.startswith("duct") for wall in problem.workspace.obstacles)
    walls = "a duct" if duct_walls else f"{len(problem.workspace.obstacles)} polygons"
    return "all", f"links: {problem.arm.links}", f"walls: {walls}", f"goal: {kind}"


def outcome_table(outcomes: Mapping[str, Counter[str]]) -> None:
    """Print the outcomes by group."""
    kinds = get_args(Outcome)
    head("problems", "number", *kinds)
    for group in sorted(outcomes, key=_by_number):
        row(group, outcomes[group].total(), *(outcomes[group][kind] for kind in kinds))
    print()


def _by_number(group: str) -> tuple[str, int, str]:
    kind, _, value = group.partition(": ")
    number = next((int(word) for word in value.split() if word.isdigit()), 0)
    return kind, number, value


def sweep_table(seen: Sequence[Sweep]) -> None:
    """Print what the sweep saw."""
    head("dense sweep", "")
    row("motions", len(seen))
    row("that violate something", sum(bool(item.violations) for item in seen))
    row("poses looked at", sum(item.poses for item in seen))
    if seen:
        row("least gap to a wall [mm]", f"{1e3 * min(item.wall_gap for item in seen):.3f}")
        row("least gap to itself [mm]", f"{1e3 * min(item.self_gap for item in seen):.3f}")


def main() -> None:
    """Parse the options and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    command = _command(commands, "nine", nine)
    command.add_argument("--problems", nargs="+", choices=NAMES, default=NAMES)
    command.add_argument("--links", nargs="+", type=int, default=[12, 24, 48, 96])
    command.add_argument("--repeat", type=int, default=3, help="runs of each, of which the median counts")
    command = _command(commands, "duct", duct)
    command.add_argument("--widths", nargs="+", type=float, default=[140, 100, 80, 65, 55], help="[mm]")
    command.add_argument("--links", nargs="+", type=int, default=[24, 36, 48, 96])
    command.add_argument("--repeat", type=int, default=1)
    command = _command(commands, "clutter", clutter_table)
    command.add_argument("--polygons", nargs="+", type=int, default=[20, 40, 80])
    command.add_argument("--seeds", nargs=2, type=int, default=[50_000, 50_100], metavar=("FIRST", "END"))
    command.add_argument("--time-limit", type=float, default=60.0, help="of each plan [s]")
    command = _command(commands, "soundness", soundness)
    command.add_argument("--seeds", nargs=2, type=int, default=[60_000, 61_000], metavar=("FIRST", "END"))
    command.add_argument("--time-limit", type=float, default=30.0, help="of each plan [s]")
    command.add_argument("--minutes", type=float, default=np.inf, help="wall time after which no other seed is begun")
    command.add_argument("--list", action="store_true", help="list the problems without a plan too")
    options = parser.parse_args()
    options.action(options)


def _command(commands: Commands, name: str, action: Callable[[argparse.Namespace], None]) -> argparse.ArgumentParser:
    command = commands.add_parser(name, help=action.__doc__)
    command.set_defaults(action=action)
    return command


if __name__ == "__main__":
    main()
