"""Statements of the paper that a figure settles: ``python -m tests.benchmarks.bench_paper STATEMENT``.

The paper is A. Hayashi, J. Park, B. J. Kuipers, *Toward Planning and Control of Highly Redundant Manipulators* (1990).

- ``types``: how often pure hill climbing reaches a goal in open space (section 3.1), how often after the segment type
  that SCM-1 selects, and how often after any of the five types (section 3.2).
- ``mapping``: how far the jointed arm is from its curve, and how much its joints bend, against the number of links
  ("this mapping, of course, becomes easier", section 1.2; the mapping itself: section 5.3).

Goals are tip poses of random smooth curves: five values of curvature with a standard deviation of 4 a metre, an arm of
a metre that is nearly straight in the beginning, no joint limits, no obstacles.
"""

import argparse
from collections.abc import Sequence

import numpy as np

from ccm_opt.planning.baseline.distance import TipPose
from ccm_opt.planning.baseline.hill_climb import SchemaStopped, run
from ccm_opt.planning.baseline.schemas import ranked_selections, scm_0, scm_2
from ccm_opt.planning.baseline.world import World
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.mapping import MappingName, map_curve, shape_error
from tests.arms import plain_arm
from tests.benchmarks.bench_planning import head, row
from tests.planned_runs import user_seconds

BEND = 4.0
"""Standard deviation of curvature [1/m]."""
START = 0.3
"""Curvature of the nearly straight arm [1/m]."""


def random_curve(seed: int) -> Configuration:
    """A segment of a metre with random curvature, at the origin."""
    values = np.random.default_rng(seed).normal(0.0, BEND, 5)
    return Configuration.chain(np.zeros(2), 0.0, [1.0], [values])


def climbs(start: Configuration, goal: TipPose) -> bool:
    """Whether pure hill climbing arrives."""
    try:
        run(scm_0(World(), start, goal))
    except SchemaStopped:
        return False
    return True


def types(options: argparse.Namespace) -> None:
    """Goals that are reached."""
    start = Configuration.chain(np.zeros(2), 0.0, [1.0], [np.full(5, START)])
    ways = {"pure hill climbing": 0, "after the type that SCM-1 selects": 0, "after one of the five types": 0}
    begin = user_seconds()
    for seed in range(options.goals):
        goal = TipPose(*random_curve(seed).tip)
        beginnings = [selection.configuration(start.base) for selection in ranked_selections(World(), start, goal)]
        moved = [run(scm_2(World(), start, beginning))[1] for beginning in beginnings]
        arrived = [climbs(each, goal) for each in moved[:1]]
        arrived += [climbs(each, goal) for each in moved[1:]] if not any(arrived) else []
        for name, reached in zip(ways, (climbs(start, goal), arrived[0], any(arrived)), strict=True):
            ways[name] += reached
    head("from a nearly straight arm", "reached")
    for name, count in ways.items():
        row(name, f"{count} of {options.goals}")
    row("CPU of all [s]", f"{user_seconds() - begin:.1f}")


def mapping(options: argparse.Namespace) -> None:
    """Distances and bends."""
    head(
        "links",
        "even joints: farthest from the curve [mm]",
        "greatest bend [deg]",
        "least squares: farthest [mm]",
        "bend",
    )
    curves = [random_curve(seed) for seed in range(options.goals)]
    for links in options.links:
        row(links, *_fit(curves, links, "even-joints"), *_fit(curves, links, "least-squares"))


def _fit(curves: Sequence[Configuration], links: int, method: MappingName) -> tuple[str, str]:
    """Medians over the curves of the greatest distance and of the greatest bend."""
    arm = plain_arm(links, 1.0 / links, base=np.zeros(2))
    mapped = [map_curve(arm, curve, method) for curve in curves]
    errors = [shape_error(arm, curve, each) for curve, each in zip(curves, mapped, strict=True)]
    bends = [np.max(np.abs(each[1:])) for each in mapped]
    return f"{1e3 * float(np.median(errors)):.3f}", f"{np.rad2deg(float(np.median(bends))):.1f}"


def main() -> None:
    """Parse the options and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    statements = {"types": types, "mapping": mapping}
    parser.add_argument("statement", choices=statements)
    parser.add_argument("--goals", type=int, default=200, help="or curves, drawn at random")
    parser.add_argument("--links", nargs="+", type=int, default=[6, 12, 24, 48, 96], help="of the mapped arms")
    options = parser.parse_args()
    statements[options.statement](options)


if __name__ == "__main__":
    main()
