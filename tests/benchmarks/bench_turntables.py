"""Are motions found for which base axes and bends must move together? Arms that bend in one plane, on a turntable.

    python -m tests.benchmarks.bench_turntables --count 40 --first 0 --limit 20

Each arm stands on a turntable, every second one on a lift below it too, among random bodies in a closed tank. The goal
is where the tip of a random pose is and points, which touches nothing. Plans are swept as in ``bench_random_arms``.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from tests.benchmarks.bench_random_arms import GAP, looked_at
from tests.benchmarks.swept_file import FileArm, FileScene, least_own_gap

BODIES = 14
"""Number of bodies that are drawn; those that are not clear of start and goal are left out."""


class TurningScene:
    """A random problem of an arm that bends in one plane on a turntable.

    Args:
        seed: of everything about it; odd ones have a lift.
        limit: time limit of planning [s].
    """

    def __init__(self, seed: int, limit: float) -> None:
        self.rng = np.random.default_rng((20261127, seed))
        self.data: dict[str, Any] = {
            "schema": 1,
            "space": 3,
            "name": f"turning-{seed}",
            "workspace": {"clearance": 0.002},
            "arm": self._arm(lift=bool(seed % 2)),
            "limits": {"velocity": 1.5, "acceleration": 6.0},
            "start": {"shape": "straight"},
            "planner": {"time_limit": limit, "seed": 0},
        }
        self._place()

    def _arm(self, *, lift: bool) -> dict[str, Any]:
        rng = self.rng
        count = int(rng.integers(8, 17))
        limit = round(rng.uniform(25.0, 50.0), 1)
        pair = [limit, 0.0] if rng.random() < 0.5 else [0.0, limit]
        length = round(float(rng.uniform(0.7, 1.0)) / count, 4)
        section = {"links": count, "link_length": length, "radius": 0.02, "joint_limit_deg": pair}
        turns = {"kind": "revolute", "axis": [0.0, 0.0, 1.0], "position": [0.0, 0.0, 0.0], "range_deg": [-180.0, 180.0]}
        axes = [turns | {"velocity": 1.0, "acceleration": 3.0}]
        if lift:
            low = -round(float(rng.uniform(0.1, 0.3)), 2)
            lifts = {"kind": "prismatic", "axis": [0.0, 0.0, 1.0], "range": [low, 0.1]}
            axes.insert(0, lifts | {"velocity": 0.3, "acceleration": 1.0})
        hangs = pair[0] == 0.0 and rng.random() < 0.7  # then the arm bends in an upright plane
        base = {
            "position": [round(float(rng.uniform(0.0, 0.1)), 3), 0.0, 0.0],
            "direction": [0.0, 0.0, -1.0] if hangs else [1.0, 0.0, 0.0],
            "up": [1.0, 0.0, 0.0] if hangs else [0.0, 0.0, 1.0],
            "axes": axes,
        }
        return {"sections": [section], "base_limit_deg": pair, "base": base}

    def _place(self) -> None:
        """Draw a goal pose, and bodies clear of it and of the start."""
        rng, data = self.rng, self.data
        arm = FileArm(data["arm"], space=True)
        count = len(arm.lengths)
        rows = data["arm"]["base"]["axes"]
        ranges = [row["range"] if "range" in row else np.deg2rad(row["range_deg"]) for row in rows]
        points = np.zeros((0, 0, 0))
        for _ in range(500):
            bends = np.zeros((2, count, 2))
            bends[1] = self._pose(arm, count)
            axes = np.array([np.zeros(len(rows)), [rng.uniform(*ends) for ends in ranges]])
            points, _ = arm.placed(bends, axes)
            if least_own_gap(arm, points)[0] > GAP:
                break
        reach = np.vstack((points.reshape(-1, 3), -points.reshape(-1, 3) * [1.0, 1.0, -1.0]))
        bounds = np.round([reach.min(axis=0) - 0.12, reach.max(axis=0) + 0.12], 3)
        data["workspace"]["bounds"] = bounds.tolist()
        bodies: list[dict[str, Any]] = []
        for _ in range(BODIES):
            row = self._body(bounds) | {"name": f"body {len(bodies)}"}
            if self._is_clear(arm, points, row):
                bodies.append(row)
        data["workspace"]["obstacles"] = bodies
        ahead = points[1, -1] - points[1, -2]
        data["goal"] = {
            "position": points[1, -1].round(5).tolist(),
            "direction": (ahead / np.linalg.norm(ahead)).round(6).tolist(),
        }

    def _pose(self, arm: FileArm, count: int) -> FloatArray:
        wave = np.interp(np.arange(count), np.linspace(0, count - 1, 3), self.rng.normal(0.0, 0.3, 3))
        return np.clip(wave[:, None], -0.8 * arm.limits, 0.8 * arm.limits)

    def _body(self, bounds: FloatArray) -> dict[str, Any]:
        rng = self.rng
        at = bounds[0] + rng.random(3) * (bounds[1] - bounds[0])
        size = float(rng.uniform(0.03, 0.09))
        kind = int(rng.integers(3))
        if kind == 0:
            half = size * rng.uniform(0.5, 1.5, 3)
            pose = {"position": at.round(4).tolist(), "rotation_deg": rng.uniform(-180.0, 180.0, 3).round(1).tolist()}
            return {"box": [(-half).round(4).tolist(), half.round(4).tolist()], "pose": pose}
        if kind == 1:
            return {"sphere": {"center": at.round(4).tolist(), "radius": round(size, 4)}}
        line = rng.normal(size=3)
        ends = [(at + sign * 0.2 * line / np.linalg.norm(line)).round(4).tolist() for sign in (-1.0, 1.0)]
        return {"capsule": {"from": ends[0], "to": ends[1], "radius": round(0.4 * size, 4)}}

    def _is_clear(self, arm: FileArm, points: FloatArray, row: dict[str, Any]) -> bool:
        scene = FileScene({"obstacles": [row]}, space=True)
        kept = self.data["workspace"]["clearance"] + 3.0 * GAP
        return all(
            gap > kept
            for k in range(len(arm.lengths))
            for _, gap in scene.gaps(points[:, k], points[:, k + 1], float(arm.radii[k]))
        )


def main() -> None:
    """Draw, solve, check and sweep, and print what was found and in what time."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--limit", type=float, default=20.0)
    parser.add_argument("--runs", type=Path, default=Path("runs/turntables"))
    given = parser.parse_args()
    given.runs.mkdir(parents=True, exist_ok=True)
    took, solved, touched = [], 0, 0
    for seed in range(given.first, given.first + given.count):
        data = TurningScene(seed, given.limit).data
        begun = time.process_time()
        outcome, wrong = looked_at(given.runs, data)
        took.append(time.process_time() - begun)
        solved += outcome == "solved"
        touched += bool(wrong)
        print(seed, outcome, f"{took[-1]:.1f} s", "; ".join(wrong), flush=True)
    median = f"median {np.median(took):.2f} s of CPU with check and sweep"
    print(f"{solved} of {given.count} solved, {touched} wrong, {median}")


if __name__ == "__main__":
    main()
