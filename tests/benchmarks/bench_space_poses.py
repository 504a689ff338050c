"""Goal poses in space: how much room the NLP makes beside a free pose in clutter, and what it costs.

python -m tests.benchmarks.bench_space_poses [LINKS] [BODIES] [SCENES] [SEGMENTS]
"""

import resource
import sys
from dataclasses import replace

import numpy as np

from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.ik.pose_settings import DEFAULT_POSES
from tests.space_clutter import clutter


def main(links: int = 24, bodies: int = 150, scenes: int = 20, segments: int = DEFAULT_POSES.segments) -> None:
    """One line a scene, and the medians."""
    settings = replace(DEFAULT_POSES, segments=segments)
    rows = []
    for number in range(scenes):
        scene = clutter(number, links, bodies)
        poses = GoalPoses(scene.problem, scene.tree, settings=settings)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        found = poses.improved(scene.seed)
        took = resource.getrusage(resource.RUSAGE_SELF).ru_utime - before
        best = poses.best(scene.seed)
        gap = np.nan if best is None else poses.gap(best.q)
        iterations = sum(pose.answer.iterations for pose in found)
        rows.append((1e3 * poses.gap(scene.seed), 1e3 * gap, took, len(found), iterations))
        last = found[-1].answer
        words = f"none: {last.worst_row} {last.status}" if best is None else f"{1e3 * gap:6.2f} mm"
        print(f"{number:3d}  seed {rows[-1][0]:6.2f} mm  found {words}  {took:.2f} s  rounds {len(found)}")  # noqa: T201
    table = np.array(rows)
    solved = np.isfinite(table[:, 1])
    print(f"found {solved.sum()} of {scenes}; wanted {1e3 * poses.wanted_gap:.1f} mm; medians: seed")  # noqa: T201
    print(np.nanmedian(table, axis=0).round(3))  # noqa: T201


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
