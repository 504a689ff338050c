"""Kinds of changes to the record and the text files of a plan's folder, all of which make the plan wrong."""

import math
import re
import struct
from collections.abc import Callable
from typing import Any

from .plans import Folder, Generator, kind


def figures_of(record: dict[str, Any]) -> list[str]:
    """Return the names of the figures of merit in a record that are numbers larger than rounding errors."""
    return [name for name, value in record["metrics"].items() if value is not None and abs(value) > 1e-6]


@kind("a figure of merit scaled")
def _(folder: Folder, rng: Generator) -> bool:
    names = figures_of(folder.record)
    folder.record["metrics"][names[int(rng.integers(len(names)))]] *= 1.0 + rng.uniform(0.05, 0.5)
    return True


@kind("a recorded check made better")
def _(folder: Folder, rng: Generator) -> bool:
    checks = [check for check in folder.record["checks"] if check["worst"] is not None and abs(check["worst"]) > 1e-3]
    check = checks[int(rng.integers(len(checks)))]
    check["worst"] *= 2.0 if "clearance" in check["name"] or "collision" in check["name"] else 0.5
    return True


@kind("a recorded limit widened")
def _(folder: Folder, rng: Generator) -> bool:
    checks = [check for check in folder.record["checks"] if check["limit"]]
    checks[int(rng.integers(len(checks)))]["limit"] *= 1.5
    return True


@kind("another outcome of the simulation")
def _(folder: Folder, rng: Generator) -> bool:
    outcomes = {"followed", "saturated", "strayed", "touched", "diverged", "not simulated"}
    others = sorted(outcomes - {folder.record["simulation"]["outcome"]})
    folder.record["simulation"]["outcome"] = others[int(rng.integers(len(others)))]
    return True


@kind("another arm in the record")
def _(folder: Folder, rng: Generator) -> bool:
    arm = folder.record["problem"]["arm"]
    arm["link_length"] *= 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.001, 0.05)
    return True


@kind("another gravity in the record")
def _(folder: Folder, rng: Generator) -> bool:
    folder.record["problem"].setdefault("simulation", {})["gravity"] = [0.0, 0.0, -9.81 + rng.uniform(0.1, 3.0)]
    return True


@kind("another status or schema")
def _(folder: Folder, rng: Generator) -> bool:
    folder.record.update([{"status": "infeasible"}, {"schema": 2}, {"problem": None}][int(rng.integers(3))])
    return True


@kind("a number of the table or the message")
def _(folder: Folder, rng: Generator) -> bool:
    name = str(rng.choice(["trajectory.csv", "trajectory.yaml"]))
    text = folder.texts[name]
    found = [match for match in re.finditer(r"-?\d+\.\d+", text) if abs(float(match[0])) > 1e-6]
    match = found[int(rng.integers(len(found)))]
    folder.texts[name] = f"{text[: match.start()]}{float(match[0]) * 1.001:.12g}{text[match.end() :]}"
    return True


@kind("a line of the message missing, or an end of the table")
def _(folder: Folder, rng: Generator) -> bool:
    name = str(rng.choice(["trajectory.csv", "trajectory.yaml"]))
    lines = folder.texts[name].splitlines(keepends=True)
    del lines[int(rng.choice([1, -1])) if name == "trajectory.csv" else int(rng.integers(2, len(lines)))]
    folder.texts[name] = "".join(lines)
    return True


@kind("joints of the table or the message renamed")
def _(folder: Folder, rng: Generator) -> bool:
    name = str(rng.choice(["trajectory.csv", "trajectory.yaml"]))
    folder.texts[name] = folder.texts[name].replace("ball02_bend", "ball02_bent", 1)
    return True


@kind("a number of a description of the arm")
def _(folder: Folder, rng: Generator) -> bool:
    name = str(rng.choice(["arm.urdf", "arm.mjcf.xml"]))
    text = folder.texts[name]
    found = [match for match in re.finditer(r'(?<=[" ])-?\d+\.\d+(?=[" ])', text) if float(match[0]) != 0.0]
    match = found[int(rng.integers(len(found)))]
    folder.texts[name] = f"{text[: match.start()]}{float(match[0]) * 1.0001!r}{text[match.end() :]}"
    return True


@kind("a text file cut short")
def _(folder: Folder, rng: Generator) -> bool:
    name = sorted(folder.texts)[int(rng.integers(len(folder.texts)))]
    text = folder.texts[name]
    folder.texts[name] = text[: int(rng.uniform(0.1, 0.95) * len(text))]
    return True


@kind("a mesh with a vertex moved")
def _(folder: Folder, rng: Generator) -> bool:
    if not folder.meshes:
        return False
    name = sorted(folder.meshes)[int(rng.integers(len(folder.meshes)))]
    content = folder.meshes[name]
    if content.startswith(b"solid"):
        text = content.decode()
        found = list(re.finditer(r"(?<=vertex )-?\d+\.\d+", text))
        match = found[int(rng.integers(len(found)))]
        folder.meshes[name] = f"{text[: match.start()]}{float(match[0]) + 1.0}{text[match.end() :]}".encode()
        return True
    # After a header of 84 bytes, a binary file has 50 bytes per triangle, first the normal, then the vertices.
    vertex = 84 + 50 * int(rng.integers((len(content) - 84) // 50)) + 12 * int(rng.integers(1, 4))
    (x,) = struct.unpack_from("<f", content, vertex)
    folder.meshes[name] = content[:vertex] + struct.pack("<f", x + 0.01) + content[vertex + 4 :]
    return True


@kind("a mesh missing")
def _(folder: Folder, rng: Generator) -> bool:
    if not folder.meshes:
        return False
    del folder.meshes[sorted(folder.meshes)[int(rng.integers(len(folder.meshes)))]]
    return True


@kind("a body in the record thinner, larger or elsewhere")
def _(folder: Folder, rng: Generator) -> bool:
    if folder.record["problem"].get("space") != 3:
        return False
    bodies = folder.record["problem"]["workspace"]["obstacles"]
    body = bodies[int(rng.integers(len(bodies)))]
    shape = next(name for name in ("capsule", "box", "mesh") if name in body)
    if shape == "mesh":
        body["scale"] = rng.uniform(0.5, 0.99) * body.get("scale", 1.0)
    elif shape == "capsule":
        body["capsule"]["radius"] *= rng.uniform(0.5, 0.99)
    else:
        body["box"][0][0] += rng.uniform(0.001, 0.05)
    return True


def _claims(record: dict[str, Any]) -> dict[str, Callable[[], object]]:
    """Return functions that put a wrong statement into a record, by description of the statement."""
    checks, room = record["checks"], record["room"]
    claims: dict[str, Callable[[], object]] = {
        "room": lambda: room["nearest"].update(gap=room["nearest"]["gap"] + 0.01),
        "clearance": lambda: room.update(clearance=room["clearance"] + 0.01),
        "nothing was left out": lambda: record.update(not_checked=[*record["not_checked"], "nothing"]),
        "another unit": lambda: checks[3].update(unit="mm"),
        "a check that fails": lambda: checks[4].update(passed=False),
        "a check twice": lambda: checks.insert(0, dict(checks[3])),
        "a check of nothing": lambda: checks.append(checks[3] | {"name": "gap to blades"}),
        "a figure of nothing": lambda: record["metrics"].update(least_gap_to_blades_m=0.05),
        "a figure without end": lambda: record["metrics"].update(duration_s=math.inf),
        "another step": lambda: record["simulation"].update(step=0.5 * record["simulation"]["step"]),
        "another method": lambda: record.update(method="by hand"),
    }
    if "tolerance" in record:
        claims["errors"] = lambda: [
            error.update(size=1.01 * error["size"], size_deg=None) for error in record["tolerance"]
        ]
    if "goal" in record:
        claims["roll"] = lambda: record["goal"].update(roll=record["goal"]["roll"] + 0.01)
    return claims


@kind("something else claimed in the record")
def _(folder: Folder, rng: Generator) -> bool:
    claims = _claims(folder.record)
    claims[sorted(claims)[int(rng.integers(len(claims)))]]()
    return True


@kind("more in the message than its points")
def _(folder: Folder, rng: Generator) -> bool:
    further = ["points: []", '"points": [{positions: [0.0]}]', "---", "header: {}", '  "effort": [0.0]']
    lines = folder.texts["trajectory.yaml"].splitlines()
    lines.insert(int(rng.integers(2, len(lines) + 1)), further[int(rng.integers(len(further)))])
    folder.texts["trajectory.yaml"] = "\n".join(lines) + "\n"
    return True
