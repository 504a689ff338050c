"""Kinds of changes to a plan's folder that leave the plan correct."""

from dataclasses import replace

from .of_motions import write_anew
from .plans import Folder, Generator, kind


@kind("nothing", true=True)
def _(folder: Folder, rng: Generator) -> bool:
    del folder, rng
    return True


@kind("everything made anew", true=True)
def _(folder: Folder, rng: Generator) -> bool:
    del rng
    return write_anew(folder)


@kind("rounding of the last digits", true=True)
def _(folder: Folder, rng: Generator) -> bool:
    for name in ("joint_torques", "joint_positions", "simulated_angles", "simulated_torques", "segment_curvatures"):
        if name not in folder.arrays:
            continue
        values = folder.arrays[name]
        values *= 1.0 + 1e-14 * rng.standard_normal(values.shape)
    return True


@kind("text files deleted", true=True)
def _(folder: Folder, rng: Generator) -> bool:
    for name in sorted(folder.texts):
        if rng.random() < 0.5:
            del folder.texts[name]
    return True


@kind("another layout of the texts", true=True)
def _(folder: Folder, rng: Generator) -> bool:
    del rng
    folder.texts["trajectory.csv"] = folder.texts["trajectory.csv"].replace("\n", "\r\n")
    folder.texts["arm.urdf"] = folder.texts["arm.urdf"].replace("<robot", "<!-- moved by hand -->\n<robot", 1)
    folder.texts["trajectory.yaml"] = "# moved by hand\n" + folder.texts["trajectory.yaml"]
    return True


@kind("wider limits", true=True)
def _(folder: Folder, rng: Generator) -> bool:
    problem = folder.solution.problem
    factor = 1.0 + rng.uniform(0.01, 0.5)
    limits = problem.limits
    return write_anew(folder, replace(problem, limits=replace(limits, velocity=factor * limits.velocity)))


@kind("files of the user beside it", true=True)
def _(folder: Folder, rng: Generator) -> bool:
    del rng
    folder.texts["notes.csv"] = "mine"
    return True


@kind("a figure of merit left out, as by an earlier version", true=True)
def _(folder: Folder, rng: Generator) -> bool:
    names = sorted(folder.record["metrics"])
    del folder.record["metrics"][names[int(rng.integers(len(names)))]]
    return True
