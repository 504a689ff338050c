"""Kinds of changes to the arrays of a plan's folder, all of which make the plan wrong."""

from collections.abc import Callable, Sequence

import numpy as np

from ccm_opt.core.arrays import FloatArray

from .plans import Folder, Generator, kind

MOTION = ("bend_angles", "joint_angles", "joint_velocities", "joint_accelerations", "joint_torques", "joint_positions")
SIMULATED = ("simulated_angles", "simulated_torques")
CURVES = ("segment_lengths", "segment_curvatures", "segment_knots", "base_headings")
GAPS = ("room_time", "wall_gaps", "self_gaps")
OF_FEED = ("base_feed", "feed_velocities", "feed_accelerations", "feed_forces", "simulated_feed")


def changed_array(folder: Folder, rng: Generator, names: Sequence[str], change: Callable[[FloatArray], None]) -> bool:
    """Change a random nonzero array of a plan, and return whether the change is large enough to matter.

    Args:
        folder: the plan, changed in place.
        rng: random generator.
        names: names of the arrays to choose from; arrays that the plan does not have are ignored.
        change: function that changes an array in place.
    """
    there = [name for name in names if name in folder.arrays and np.any(folder.arrays[name])]
    if not there:
        return False
    before = folder.arrays[there[int(rng.integers(len(there)))]]
    kept = before.copy()
    change(before)
    # An array that is almost unchanged is not wrong: clearances at the search distance, or equal rows swapped.
    return float(np.max(np.abs(before - kept))) > 1e-4 * max(float(np.max(np.abs(kept))), 1e-3)


def scaled(rng: Generator) -> Callable[[FloatArray], None]:
    """Return a function that scales an array in place by a random factor that differs from 1 by 0.5 % to 10 %."""
    factor = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.005, 0.1)

    def change(values: FloatArray) -> None:
        values *= factor

    return change


def one_entry(rng: Generator) -> Callable[[FloatArray], None]:
    """Return a function that shifts a random entry of an array in place by a fraction of the largest magnitude."""
    share = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-2.5, 0.5)

    def change(values: FloatArray) -> None:
        values.ravel()[int(rng.integers(values.size))] += share * np.max(np.abs(values))

    return change


def one_keyframe(rng: Generator) -> Callable[[FloatArray], None]:
    """Return a function that shifts a random bend angle in place by 0.1 to 1 rad, more than a keyframe may deviate."""

    def change(values: FloatArray) -> None:
        values.ravel()[int(rng.integers(values.size))] += rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 1.0)

    return change


def shifted(rng: Generator) -> Callable[[FloatArray], None]:
    """Return a function that shifts an array in place cyclically by one to eight samples."""
    steps = int(rng.integers(1, 9))

    def change(values: FloatArray) -> None:
        values[:] = np.roll(values, steps, axis=0)

    return change


def backwards(rng: Generator) -> Callable[[FloatArray], None]:
    """Return a function that reverses an array in place along its first axis."""
    del rng

    def change(values: FloatArray) -> None:
        values[:] = values[::-1].copy()

    return change


def nothing(rng: Generator) -> Callable[[FloatArray], None]:
    """Return a function that sets a quarter of the rows of an array to zero, in place."""
    begin = rng.uniform(0.1, 0.6)

    def change(values: FloatArray) -> None:
        first = int(begin * len(values))
        values[first : first + max(1, len(values) // 4)] = 0.0

    return change


def no_number(rng: Generator) -> Callable[[FloatArray], None]:
    """Return a function that sets a random entry of an array to NaN or infinity, in place."""

    def change(values: FloatArray) -> None:
        values.ravel()[int(rng.integers(values.size))] = rng.choice([np.nan, np.inf, -np.inf])

    return change


for _group, _names in {
    "motion": MOTION,
    "simulation": SIMULATED,
    "keyframes": ("keyframes",),
    "curves": CURVES,
    "gaps": GAPS,
    "feed": OF_FEED,
}.items():
    for _how in (scaled, one_keyframe if _group == "keyframes" else one_entry, backwards, nothing):
        kind(f"{_group}: {_how.__name__}")(
            lambda folder, rng, names=_names, how=_how: changed_array(folder, rng, names, how(rng))
        )
# A single feed position moved slightly could still be a keyframe of the motion, so all are changed.
for _how in (scaled, backwards, nothing):
    kind(f"feeds of keyframes: {_how.__name__}")(
        lambda folder, rng, how=_how: changed_array(folder, rng, ("keyframe_feeds",), how(rng))
    )
for _group, _names in {"motion": MOTION, "simulation": SIMULATED, "feed": OF_FEED[:4]}.items():
    kind(f"{_group}: shifted")(lambda folder, rng, names=_names: changed_array(folder, rng, names, shifted(rng)))


@kind("any array: not finite")
def _(folder: Folder, rng: Generator) -> bool:
    names = [name for name in (*MOTION, *SIMULATED, *CURVES, *GAPS, "time") if name in folder.arrays]
    name = names[int(rng.integers(len(names)))]
    no_number(rng)(folder.arrays[name])
    return True


@kind("any array: missing")
def _(folder: Folder, rng: Generator) -> bool:
    names = sorted(set(folder.arrays) - {"stops"})
    del folder.arrays[names[int(rng.integers(len(names)))]]
    return True


@kind("any array: its last row missing")
def _(folder: Folder, rng: Generator) -> bool:
    names = [name for name in sorted(folder.arrays) if len(folder.arrays[name]) and name != "stops"]
    name = names[int(rng.integers(len(names)))]
    folder.arrays[name] = folder.arrays[name][:-1]
    return True


@kind("two links' columns swapped")
def _(folder: Folder, rng: Generator) -> bool:
    names = ("bend_angles", "joint_angles", "joint_torques", "keyframes")
    name = names[int(rng.integers(len(names)))]
    values = folder.arrays[name]
    first, second = rng.choice(values.shape[1] // (3 if "joint" in name else 1), 2, replace=False)
    if "joint" in name:
        first, second = 3 * first + 1, 3 * second + 1
    if np.max(np.abs(values[:, first] - values[:, second])) < 1e-3:
        return False
    values[:, [first, second]] = values[:, [second, first]]
    return True


@kind("names of joints swapped")
def _(folder: Folder, rng: Generator) -> bool:
    first, second = rng.choice(len(folder.arrays["joint_names"]), 2, replace=False)
    names = folder.arrays["joint_names"]
    names[[first, second]] = names[[second, first]]
    return True


@kind("time runs slower")
def _(folder: Folder, rng: Generator) -> bool:
    folder.arrays["time"] *= 1.0 + rng.uniform(0.01, 0.1)
    return True


@kind("time runs faster")
def _(folder: Folder, rng: Generator) -> bool:
    folder.arrays["time"] *= 1.0 - rng.uniform(0.01, 0.3)
    return True


@kind("stop elsewhere")
def _(folder: Folder, rng: Generator) -> bool:
    stops = folder.arrays["stops"]
    if not len(stops):
        return False
    stops[0] += int(rng.choice([-40, -9, 9, 60]))
    return True


@kind("stop left out")
def _(folder: Folder, rng: Generator) -> bool:
    del rng
    if not len(folder.arrays["stops"]):
        return False
    folder.arrays["stops"] = folder.arrays["stops"][:-1]
    return True


@kind("the two bends of a joint swapped")
def _(folder: Folder, rng: Generator) -> bool:
    names = [name for name in ("bend_angles", "keyframes") if folder.arrays[name].ndim == 3]
    if not names:
        return False
    pairs = folder.arrays[names[int(rng.integers(len(names)))]]
    joint = int(rng.integers(pairs.shape[1]))
    if np.max(np.abs(pairs[:, joint, 0] - pairs[:, joint, 1])) < 1e-3:
        return False
    pairs[:, joint] = pairs[:, joint, ::-1].copy()
    return True
