"""Random lines of sight against rays and distances of trimesh: ``python -m tests.benchmarks.bench_views``.

Each is among triangles of its own, as in ``tests/test_views.py``, whose law is checked. A disagreement is printed with
its seed, which repeats it.
"""
# ruff: noqa: T201 - a script of its own that prints its findings

import argparse
import time

from tests.test_views import test_free_cones_of_sight_are_those_of_a_ray_caster as law


def main() -> None:
    """Check the law for as many seeds as asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000, help="number of lines of sight")
    count = parser.parse_args().count
    begun, wrong = time.process_time(), 0
    for seed in range(count):
        try:
            law.hypothesis.inner_test(seed=seed)
        except AssertionError as found:
            wrong += 1
            print(f"seed {seed}: {found}")
    print(f"{count} lines of sight, {wrong} disagreements, {time.process_time() - begun:.0f} s of CPU")


if __name__ == "__main__":
    main()
