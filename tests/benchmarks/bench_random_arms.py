"""Is what is called solved safe for arms of any layout? Random arms in random scenes, swept from their files.

    python -m tests.benchmarks.bench_random_arms --count 1000 --first 0 --limit 2

Arms have sections of their own lengths, radii, tapers, limits and locked joints, on fixed bases, feed axes and, with
``--kinds axes``, chains of axes, in the plane and in space. Each problem is solved and checked by the commands, and
each plan is swept by ``swept_file.py``, which shares nothing with the package. What is found is kept in the folder of
runs.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import json
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.core.arrays import FloatArray
from tests.benchmarks.swept_arcs import ArcArm
from tests.benchmarks.swept_file import FileArm, FileScene, body_gaps, broken_promises, least_own_gap

GAP = 0.003
"""Gap that starts and goals keep from everything drawn [m]."""

LAYOUTS = ("tools", "tools plane", "even plane", "feed plane", "feed tools", "coupled tools", "axes tools", "even feed")
"""Kinds of arms that stand for all layouts, for tests of what any arm can do."""


class Drawn:
    """A random problem.

    Args:
        seed: of everything about it; even ones are in the plane, but on axes.
        limit: time limit of planning [s].
        kinds: what arms may have: "feed", "axes", "tools", which stands for bodies on any link, some of which weigh,
            "meshes", which adds meshes and polygons to these, and "coupled", which stands for drives that move several
            joints; with "plane" all are in the plane, and mostly on a feed axis; "even" stands for sections that bend
            evenly.
        folder: folder that meshes are written to.
    """

    def __init__(self, seed: int, limit: float, kinds: frozenset[str], folder: Path = Path()) -> None:
        self.folder, self.kinds, self.meshes = folder, kinds, 0
        self.rng = np.random.default_rng((20261126, seed))
        self.space = (bool(seed % 2) and "plane" not in kinds) or bool({"axes", "coupled"} & kinds)
        self.reader = ArcArm if "even" in kinds else FileArm
        self.data: dict[str, Any] = {
            "schema": 1,
            "name": f"drawn-{seed}",
            "workspace": {"clearance": float(self.rng.choice((0.0, 0.002)))},
            "arm": self._arm(kinds),
            "limits": {"velocity": 1.5, "acceleration": 6.0},
            "start": {"shape": "straight"},
            "planner": {"time_limit": limit, "seed": 0},
        }
        if self.space:
            self.data["space"] = 3
        if {"tools", "meshes"} & kinds:
            self._equip()
        self._place(kinds)

    def _equip(self) -> None:
        """Put bodies on links, clear of all others while the arm is straight, and mostly a tool."""
        rng, arm = self.rng, self.data["arm"]
        bare = self.reader(arm, self.space, self.folder)
        count = len(bare.lengths)
        free = [k for k in range(count) if bare.mounted[k] < 1.0 - 1e-8]
        last = count - 1
        d = 3 if self.space else 2
        heavy = rng.random() < 0.5
        weight = {"mass": round(rng.uniform(0.01, 0.3), 3)} if heavy else {}
        if heavy:
            self.data["limits"]["torque"] = 60.0
        for _ in range(int(rng.integers(0, 4)) if free and "even" not in self.kinds else 0):
            link = int(rng.choice(free))
            for _ in range(20):
                row = {"link": link + 1, "bodies": [self._fixed(bare, link)], **weight}
                if self._clear_at_rest(arm | {"bodies": [*arm.get("bodies", ()), row]}):
                    arm.setdefault("bodies", []).append(row)
                    break
        if rng.random() < 0.7 and last in free:
            ahead = [round(float(rng.uniform(0.0, 0.06)), 4), *rng.normal(0.0, 0.02, d - 1).round(4).tolist()]
            tool = {"tip": ahead, "direction": rng.normal(size=d).round(3).tolist()}
            radius = round(float(bare.radii[-1]) * rng.uniform(0.2, 1.2), 4)
            out = [round(0.8 * value, 4) for value in ahead]
            tool["bodies"] = [{"capsule": {"from": [0.0] * d, "to": out, "radius": radius}}] if any(out) else []
            tool |= weight if tool["bodies"] else {}
            if self._clear_at_rest(arm | {"tool": tool}):
                arm["tool"] = tool

    def _fixed(self, arm: FileArm, link: int) -> dict[str, Any]:
        rng, d = self.rng, 3 if self.space else 2
        length, radius = float(arm.lengths[link]), float(arm.radii[link])
        size = rng.uniform(0.3, 1.2) * radius
        aside = rng.normal(size=d - 1)
        aside *= rng.uniform(0.5, 2.5) * radius / np.linalg.norm(aside)
        at = np.array([-length * rng.uniform(0.0, 1.0), *aside])
        half = size * rng.uniform(0.4, 1.0, d)
        kind = rng.integers(4 if self.space else 3)
        if "meshes" in self.kinds and rng.random() < 0.6:
            return self._of_any_shape(at, size)
        if kind == 0:
            corners = [(at - half).round(4).tolist(), (at + half).round(4).tolist()]
            return {"box": corners if self.space else [*corners[0], *corners[1]]}
        if kind == 1:
            ball = {"center": at.round(4).tolist(), "radius": round(size, 4)}
            return {"sphere": ball} if self.space else {"circle": ball}
        ends = [(at + sign * half).round(4).tolist() for sign in (-1.0, 1.0)]
        bar = {"from": ends[0], "to": ends[1], "radius": round(0.5 * size, 4)}
        return {"capsule": bar} if kind == 2 else {"cylinder": bar}

    def _of_any_shape(self, at: FloatArray, size: float) -> dict[str, Any]:
        """A polygon with a notch, or two boxes that make an angle as a mesh of a file in millimetres."""
        rng = self.rng
        if not self.space:
            corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 0.0], [rng.uniform(-0.6, 0.5), 0.2], [-0.6, 1.0]])
            return {"polygon": (at + size * corners * rng.uniform(0.4, 1.0, 2)).round(4).tolist()}
        long, flat = 1000.0 * size * rng.uniform(0.4, 1.0, (2, 3))
        low, up = trimesh.creation.box(2.0 * long), trimesh.creation.box(2.0 * flat)
        up.apply_translation(long * rng.choice((-1.0, 1.0), 3))
        self.meshes += 1
        name = f"{self.data['name']}-{self.meshes}.stl"
        trimesh.util.concatenate([low, up]).export(self.folder / name)
        turns = rng.uniform(-180.0, 180.0, 3).round(1).tolist()
        return {"mesh": name, "scale": 0.001, "pose": {"position": at.round(4).tolist(), "rotation_deg": turns}}

    def _clear_at_rest(self, table: dict[str, Any]) -> bool:
        """Whether covers of bodies are clear of all but their own links while the arm is straight."""
        arm = self.reader(table, self.space, self.folder)
        compared = list(body_gaps(arm, FileScene({}, space=self.space), *arm.at_rest))
        count = len(arm.bodies) * (len(arm.lengths) - 1)
        pairs = [(i, j) for i in arm.bodies for j in arm.bodies if id(i) < id(j) and i.link != j.link]
        return len(compared) == count + len(pairs)

    def _arm(self, kinds: frozenset[str]) -> dict[str, Any]:
        rng = self.rng
        rows = [] if "even" not in kinds else [self._even_section() for _ in range(int(rng.integers(2, 6)))]
        for _ in range(int(rng.integers(1, 5)) if not rows else 0):
            count = int(rng.integers(1, 7))
            radius = rng.uniform(0.006, 0.03)
            tapers = rng.random() < 0.5
            row: dict[str, Any] = {
                "links": count,
                "link_length": round(float(rng.uniform(0.02, 0.12)), 4),
                "radius": [round(radius, 4), round(radius * rng.uniform(0.3, 1.7), 4)] if tapers else round(radius, 4),
                "joint_limit_deg": round(rng.uniform(15.0, 90.0), 1),
            }
            if rng.random() < 0.2 and count > 1:
                row["locked"] = [int(rng.integers(1, count + 1))]
            rows.append(row)
        if "even" not in kinds:
            rows[0]["links"] += max(0, 4 - sum(row["links"] for row in rows))
        arm: dict[str, Any] = {"sections": rows}
        if self.space:
            vectors = rng.normal(size=(2, 3)).round(3).tolist()
            arm["base"] = {"position": [0.0, 0.0, 0.0], "direction": vectors[0], "up": vectors[1]}
        else:
            arm["base"] = [0.0, 0.0]
            arm["base_heading_deg"] = round(rng.uniform(-180.0, 180.0), 1)
        if rng.random() < 0.5 and "even" not in kinds:
            arm["base_limit_deg"] = round(rng.uniform(20.0, 170.0), 1)
        if rng.random() < 0.3 and not {"axes", "even"} & kinds:
            arm["mount_length"] = round(sum(row["link_length"] for row in rows[:1]) * int(rng.integers(0, 3)), 6)
        if "axes" in kinds:
            arm["base"]["axes"] = [self._axis() for _ in range(int(rng.integers(1, 5)))]
        elif "feed" in kinds and "coupled" not in kinds and rng.random() < (0.8 if {"plane", "even"} & kinds else 0.3):
            arm["feed"] = self._feed(rows, kinds)
        if "coupled" in kinds:
            arm["coupling"] = self._coupling(FileArm(arm, space=True).limits.ravel() > 0.0)
        return arm

    def _even_section(self) -> dict[str, Any]:
        rng = self.rng
        length, radius, limit = rng.uniform(0.08, 0.3), rng.uniform(0.006, 0.02), rng.uniform(40.0, 150.0)
        row: dict[str, Any] = {
            "drive": "section",
            "length": round(length, 4),
            "links": int(np.ceil(limit / 15.0)),
            "radius": [round(radius, 4), round(radius * rng.uniform(0.5, 1.2), 4)],
            "bend_limit_deg": round(limit, 1),
            "mass": round(rng.uniform(0.05, 0.3), 3),
        }
        if rng.random() < 0.4:
            tendons = {"radius": 0.003, "speed": 0.02} | ({"travel": 0.01} if rng.random() < 0.5 else {})
            row["tendons"] = tendons
        return row

    def _coupling(self, free: FloatArray) -> list[list[float]]:
        """Ratios of bends that move to some drives, each of which moves one or several; others rest."""
        rng = self.rng
        moving = rng.permutation(np.flatnonzero(free))
        drives = int(rng.integers(min(3, len(moving)), min(len(moving), 10) + 1))
        ratios = np.zeros((len(free), drives))
        ratios[moving[:drives], range(drives)] = 1.0
        for bend in moving[drives:]:
            if rng.random() < 0.85:
                ratios[bend, rng.integers(drives)] = round(rng.uniform(0.2, 1.5) * rng.choice((-1.0, 1.0)), 3)
        return ratios.tolist()  # type: ignore[no-any-return]

    def _axis(self) -> dict[str, Any]:
        rng = self.rng
        row: dict[str, Any] = {"axis": rng.normal(size=3).round(3).tolist(), "velocity": 0.5, "acceleration": 2.0}
        if rng.random() < 0.5:
            return row | {"kind": "prismatic", "range": [-round(rng.uniform(0.0, 0.3), 3), 0.3]}
        turns = row | {"kind": "revolute", "range_deg": [-round(rng.uniform(0.0, 120.0), 1), 90.0]}
        return turns | ({"position": rng.normal(0.0, 0.15, 3).round(3).tolist()} if rng.random() < 0.6 else {})

    def _feed(self, rows: list[dict[str, Any]], kinds: frozenset[str]) -> dict[str, Any]:
        length = sum(row["length"] if "length" in row else row["links"] * row["link_length"] for row in rows)
        feed: dict[str, Any] = {"range": [round(-0.6 * length, 3), 0.0]}
        apart = self.rng.spawn(1)[0]  # other draws stay what they are
        if apart.random() < 0.5 and "even" not in kinds:
            # Part of the arm never leaves the tube, and at the start the tip may be inside.
            feed["hole"] = round(apart.uniform(0.0, 0.6) * length, 3)
        return feed

    def _place(self, kinds: frozenset[str]) -> None:
        """Draw a goal pose, and bodies clear of it and of the start."""
        rng, data = self.rng, self.data
        arm = self.reader(data["arm"], self.space, self.folder)
        count = arm.joints
        low = 0.0
        axes = np.zeros((2, 0))
        if "feed" in data["arm"]:
            low = data["arm"]["feed"]["range"][0]
            data["start"]["feed"] = low
            data["limits"] |= {"feed_velocity": 0.3, "feed_acceleration": 1.0}
            axes = np.array([[low], [0.3 * low]])
        if self.space and "axes" in data["arm"]["base"]:
            rows = data["arm"]["base"]["axes"]
            ranges = [row["range"] if "range" in row else np.deg2rad(row["range_deg"]) for row in rows]
            axes = np.array([np.zeros(len(rows)), [rng.uniform(*ends) for ends in ranges]])
        for _ in range(200):
            bends = np.zeros((2, count, 2) if self.space else (2, count))
            bends[1] = self._pose(arm)
            if "feed" in data["arm"]:
                bends[1][axes[1, 0] + arm.joint_places < data["arm"]["feed"].get("hole", 0.0)] = 0.0
            points, frames = arm.placed(bends, axes)
            own = [gap for _, gap in body_gaps(arm, FileScene({}, space=self.space), points, frames)]
            if min((least_own_gap(arm, points)[0], *own)) > GAP:
                break
        else:
            raise ValueError("no goal")
        pad = rng.uniform(0.05, 0.3)
        tips = arm.tips(points, frames)
        bodies_at = [arm.fixed(body.link, points, frames, body.reach[0]) for body in arm.bodies]
        reach = np.concatenate((points.reshape(-1, points.shape[-1]), tips, *bodies_at))
        pad_of_bodies = max((body.reach[1] for body in arm.bodies), default=0.0)
        pad += max(float(arm.radii.max()), pad_of_bodies)
        corners = [reach.min(axis=0) - pad, reach.max(axis=0) + pad]
        bounds = np.round(corners, 3)
        data["workspace"]["bounds"] = bounds.tolist() if self.space else bounds.ravel().tolist()
        bodies: list[dict[str, Any]] = []
        for _ in range(int(rng.integers(3, 14))):
            row = self._body(points, bounds) | {"name": f"body {len(bodies)}"}
            if self._is_clear(arm, points, frames, row):
                bodies.append(row)
        data["workspace"]["obstacles"] = bodies
        data["goal"] = {"position": tips[1].round(5).tolist()}
        if rng.random() < 0.2 and axes.shape[1] < 2 and "axes" not in kinds:
            data["goal"] = {"joints_deg": np.rad2deg(bends[1]).tolist()}
            if len(axes[0]):
                data["goal"]["feed"] = float(axes[1, 0])

    def _pose(self, arm: FileArm) -> FloatArray:
        rng, count = self.rng, arm.joints
        knots = np.linspace(0, count - 1, 3)
        waves = [np.interp(np.arange(count), knots, rng.normal(0.0, 0.5, 3)) for _ in range(2 if self.space else 1)]
        limits = 0.8 * np.minimum(arm.limits, 2.0)
        if "coupling" in arm.table:
            ratios = np.array(arm.table["coupling"])
            with np.errstate(divide="ignore", invalid="ignore"):
                most = np.nanmin(limits.reshape(-1, 1) / np.abs(ratios), axis=0)
            return (ratios @ (most * np.clip(rng.normal(0.0, 0.6, len(most)), -1.0, 1.0))).reshape(-1, 2)
        shapes = [np.clip(wave, -limits[:, k], limits[:, k]) for k, wave in enumerate(waves)]
        return np.stack(shapes, axis=1) if self.space else shapes[0]

    def _body(self, points: FloatArray, bounds: FloatArray) -> dict[str, Any]:
        rng = self.rng
        size = rng.uniform(0.01, 0.06)
        near = points.reshape(-1, points.shape[-1])
        at: FloatArray = near[rng.integers(len(near))] + rng.normal(0.0, 0.08, near.shape[1])
        at = at if rng.random() < 0.7 else bounds[0] + rng.random(len(at)) * (bounds[1] - bounds[0])
        kind = rng.integers(3)
        half = size * rng.uniform(0.5, 1.5, len(at))
        if kind == 0 and self.space:
            pose = {"position": at.round(4).tolist(), "rotation_deg": rng.uniform(-180.0, 180.0, 3).round(1).tolist()}
            return {"box": [(-half).round(4).tolist(), half.round(4).tolist()], "pose": pose}
        if kind == 0:
            return {"box": [*(at - half).round(4).tolist(), *(at + half).round(4).tolist()]}
        if kind == 1:
            ball = {"center": at.round(4).tolist(), "radius": round(size, 4)}
            return {"sphere": ball} if self.space else {"circle": ball}
        ends = [(at + sign * 2.0 * half).round(4).tolist() for sign in (-1.0, 1.0)]
        if self.space:
            return {"capsule": {"from": ends[0], "to": ends[1], "radius": round(0.5 * size, 4)}}
        corners = at + size * np.array([[1.0, 0.0], [0.0, 1.3], [-0.8, 0.0], [0.2, -1.0]])
        return {"polygon": corners.round(4).tolist()}

    def _is_clear(self, arm: FileArm, points: FloatArray, frames: Any, row: dict[str, Any]) -> bool:
        scene = FileScene({"obstacles": [row]}, space=self.space)
        kept = self.data["workspace"]["clearance"] + GAP
        base = points[:1, 0]
        gaps = [gap for _, gap in scene.gaps(base - 1e-6, base + 1e-6, 0.01)]
        gaps += [gap - kept for k, a, b in arm.exposed(points) for _, gap in scene.gaps(a, b, float(arm.radii[k]))]
        gaps += [gap - kept for name, gap in body_gaps(arm, scene, points, frames) if name == row["name"]]
        if "tool" in self.data["arm"]:
            tips = arm.tips(points, frames)
            gaps += [gap - kept for _, gap in scene.gaps(tips - 1e-6, tips + 1e-6, 0.01)]
        return min(gaps) > 0.0


def toml(data: dict[str, Any]) -> str:
    """A problem file of the tables."""

    def value(of: Any) -> str:
        if isinstance(of, dict):
            return "{ " + ", ".join(f'"{key}" = {value(each)}' for key, each in of.items()) + " }"
        if isinstance(of, (list, tuple)):
            return f"[{', '.join(map(value, of))}]"
        return json.dumps(of)

    return "\n".join(f"{key} = {value(each)}" for key, each in data.items()) + "\n"


def looked_at(folder: Path, data: dict[str, Any]) -> tuple[str, list[str]]:
    """What became of a problem, and what is wrong with that."""
    file = folder / f"{data['name']}.toml"
    file.write_text(toml(data))
    solved = CliRunner().invoke(app, ["solve", str(file), "--out", str(folder), "--no-pictures"])
    wrong = []
    if solved.exception is not None and not isinstance(solved.exception, SystemExit):
        wrong.append(f"raised {solved.exception!r}")
    if "independent verif" in solved.output or "did not pass" in solved.output:
        wrong.append(solved.output[-300:])
    plan = folder / data["name"]
    if not (plan / "solution.npz").exists():
        return f"exit {solved.exit_code}", wrong
    with np.load(plan / "solution.npz") as arrays:
        kind = ArcArm if any("drive" in row for row in data["arm"].get("sections", ())) else FileArm
        wrong += broken_promises(data, dict(arrays), folder, kind)
    checked = CliRunner().invoke(app, ["check", str(plan)])
    if checked.exit_code != solved.exit_code and solved.exit_code == 0:
        wrong.append(f"check: {checked.output[-300:]}")
    return "solved", wrong


def main() -> None:
    """Draw, solve, check and sweep, and print the counts."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--limit", type=float, default=2.0)
    parser.add_argument("--runs", type=Path, default=Path("runs/random-arms"))
    parser.add_argument("--kinds", nargs="*", default=["feed"])
    given = parser.parse_args()
    given.runs.mkdir(parents=True, exist_ok=True)
    counts: Counter[str] = Counter()
    for seed in range(given.first, given.first + given.count):
        begun = time.process_time()
        try:
            data = Drawn(seed, given.limit, frozenset(given.kinds), given.runs).data
        except ValueError:
            counts["not drawn"] += 1
            continue
        outcome, wrong = looked_at(given.runs, data)
        counts[f"{outcome}, {'space' if 'space' in data else 'plane'}{', fed' if 'feed' in data['arm'] else ''}"] += 1
        counts["wrong"] += bool(wrong)
        print(seed, outcome, f"{time.process_time() - begun:.1f} s", "; ".join(wrong), flush=True)
    for name, count in sorted(counts.items()):
        print(f"{count:5d} {name}")


if __name__ == "__main__":
    main()
