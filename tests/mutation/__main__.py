"""``python -m tests.mutation --count 400`` puts mistakes into proofs and verifier, and lists those no test finds."""

# ruff: noqa: T201 - it prints what it finds
import argparse
import ast
import math
import random
import sys
import time
from pathlib import Path

from tests.mutation import trial
from tests.mutation.covering import Covering, covering
from tests.mutation.mutants import Mutant, count_of, described, mutated_tree

PLACES = ("ccm_opt/verification", "ccm_opt/scene/bad_pose.py", "ccm_opt/scene/certificate.py")
"""Files, and folders of them, that get mistakes."""
SLOWEST = 45.0
"""Tests beyond so much time in all are left out of a trial [s], but for pinned figures; what they would find counts as
not found."""


def main() -> int:
    """Draw mistakes, try them, and tell what share was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--count", type=int, default=400, help="mistakes drawn at random")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6), help="of the draw")
    parser.add_argument("--only", default="", help="files whose path holds this")
    parser.add_argument("--map", type=Path, default=Path("runs/mutation"), help="where it is kept which test runs what")
    options = parser.parse_args()
    known = covering(options.map)
    trial.prepare()
    # Numbers that tune are no mistakes when they are others; what they mean is held by the code that uses them.
    found_in = (sorted(Path(place).rglob("*.py")) or [Path(place)] for place in PLACES)
    paths = [path for found in found_in for path in found if "settings" not in path.name]
    paths = [path for path in paths if options.only in str(path)]
    everything = [(path, k) for path in paths for k in range(count_of(path.read_text(encoding="utf-8")))]
    drawn = random.Random(options.seed).sample(everything, min(options.count, len(everything)))  # noqa: S311 - no secret
    print(f"seed {options.seed}: {len(drawn)} of {len(everything)} mistakes", flush=True)
    begun = time.monotonic()
    missed = 0
    for number, (path, k) in enumerate(drawn, start=1):
        mutant = described(path.read_text(encoding="utf-8"), k)
        if number == 1 and found(path, mutant, known, without=True):
            raise RuntimeError("the tests fail without a mistake")
        if not found(path, mutant, known):
            missed += 1
            print(f"- {path}:{mutant.first} [{mutant.number}] {mutant.before}  ->  {mutant.after}", flush=True)
        if number % 20 == 0 or number == len(drawn):
            low, high = interval(number - missed, number)
            spent = time.monotonic() - begun
            print(f"{number - missed} of {number} found, {low:.1%} to {high:.1%} of all; {spent:.0f} s", flush=True)
    return min(missed, 1)


def found(path: Path, mutant: Mutant, known: Covering, *, without: bool = False) -> bool:
    """Whether a test finds a mistake; or fails without it, which must not be."""
    tests = known.tests_of(str(path), mutant)
    chosen = []
    spent = 0.0
    for test in tests:
        # Lines that hundreds of tests run have their figures pinned by the scenes, which are not the quickest.
        if spent + known.seconds[test] > SLOWEST and chosen and "pinned" not in test:
            continue
        spent += known.seconds[test]
        chosen.append(test)
    if not chosen:
        return False
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source) if without else mutated_tree(source, mutant.number)
    return trial.is_found(path, tree, chosen, 60.0 + 5.0 * spent)


def interval(count: int, total: int) -> tuple[float, float]:
    """Within which the share lies with 95 % (Wilson)."""
    z = 1.96
    share = count / total
    middle = share + z**2 / (2 * total)
    half = z * math.sqrt(share * (1 - share) / total + z**2 / (4 * total**2))
    return (middle - half) / (1 + z**2 / total), (middle + half) / (1 + z**2 / total)


if __name__ == "__main__":
    sys.exit(main())
