"""The scan of problems/jobs/pipe-gallery.toml: pipes, a valve and brackets, seen by a laser scanner from six places.

A station casts rays in all directions; each gives the nearest point of the surfaces, with an error along the ray. Of
the points in each cell of a grid one is kept. No gallery was measured for it: the pipes are assumed. Run it with a
folder for the points::

    python examples/15_scan_a_pipe_gallery.py problems/jobs
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Axis from, to, and radius [m]: pipes along the gallery, two branches across it, a valve with its spindle, brackets.
CYLINDERS = (
    ((0.0, 0.30, 0.62), (2.2, 0.30, 0.62), 0.13),
    ((0.0, 0.34, 1.12), (2.2, 0.34, 1.12), 0.10),
    ((0.0, -0.36, 0.74), (2.2, -0.36, 0.74), 0.15),
    ((0.0, -0.33, 1.28), (2.2, -0.33, 1.28), 0.08),
    ((0.0, 0.72, 0.90), (2.2, 0.72, 0.90), 0.07),
    ((0.62, 0.34, 1.12), (0.62, -0.33, 1.28), 0.06),
    ((0.95, 0.30, 0.62), (0.95, -0.05, 0.62), 0.06),
    ((0.95, -0.05, 0.62), (0.95, -0.05, 1.60), 0.06),
    ((1.35, 0.72, 0.90), (1.43, 0.72, 0.90), 0.12),
    ((1.39, 0.72, 1.00), (1.39, 0.72, 1.18), 0.02),
    ((1.20, 0.30, 0.75), (1.20, 0.34, 1.02), 0.015),
    ((1.80, 0.30, 0.75), (1.80, 0.34, 1.02), 0.015),
)
STATIONS = (
    (0.1, -0.03, 1.55),
    (0.1, 0.0, 0.35),
    (1.1, 0.05, 1.75),
    (2.1, 0.0, 1.0),
    (0.9, 0.85, 1.45),
    (1.5, 0.85, 0.45),
)
STEP = np.deg2rad(0.4)  # of the scanner, in both angles
NOISE = 0.001  # standard deviation of a distance, and none is wrong by more than twice as much [m]
CELL = 0.016  # of the grid in which points are thinned [m]


def directions() -> Array:
    """Directions of the rays of a station, shape (n, 3)."""
    up, around = np.meshgrid(np.arange(-1.5, 1.5, STEP), np.arange(-np.pi, np.pi, STEP), indexing="ij")
    rays = np.stack((np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)), axis=-1)
    return rays.reshape(-1, 3)


def hits(start: Array, rays: Array, first: Array, last: Array, radius: float) -> Array:
    """Distances along rays from a point outside a cylinder with flat ends to it, inf without, shape (n,) [m]."""
    length = float(np.linalg.norm(last - first))
    axis = (last - first) / length
    along, across = rays @ axis, rays - np.outer(rays @ axis, axis)
    begin = start - first
    height, aside = float(begin @ axis), begin - (begin @ axis) * axis
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = np.sum(across**2, axis=1), across @ aside
        side = (-b - np.sqrt(b**2 - a * (aside @ aside - radius**2))) / a
        nearest = np.where((side > 0.0) & (np.abs(height + side * along - 0.5 * length) <= 0.5 * length), side, np.inf)
        for end in (0.0, length):
            flat = (end - height) / along
            inside = (flat > 0.0) & (np.linalg.norm(aside + flat[:, None] * across, axis=1) <= radius)
            nearest = np.fmin(nearest, np.where(inside, flat, np.inf))
    return nearest


def scan() -> Array:
    """Points that the stations measure, thinned, shape (n, 3) [m]."""
    rng, rays, found = np.random.default_rng(1), directions(), []
    for station in np.array(STATIONS):
        distances = np.full(len(rays), np.inf)
        for first, last, radius in CYLINDERS:
            distances = np.minimum(distances, hits(station, rays, np.array(first), np.array(last), radius))
        seen = np.isfinite(distances)
        errors = np.clip(rng.normal(0.0, NOISE, int(np.sum(seen))), -2.0 * NOISE, 2.0 * NOISE)
        found.append(station + (distances[seen] + errors)[:, None] * rays[seen])
    points = np.concatenate(found)
    _, kept = np.unique(np.floor(points / CELL).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(kept)]


def main() -> None:
    """Write the points as a PLY file."""
    points = scan().astype("<f4")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {axis}" for axis in "xyz"] + ["end_header", ""]
    Path(sys.argv[1], "pipe-gallery.ply").write_bytes("\n".join(header).encode() + points.tobytes())


if __name__ == "__main__":
    main()
