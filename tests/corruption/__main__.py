"""Corrupt plans, judge them, and list those judged wrong: ``python -m tests.corruption --count 1000 --seed 1``."""

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

from .judging import judged
from .plans import write_plans


def main() -> None:
    """Corrupt random plans, run ``ccm-opt check`` on each, and print those that are judged wrongly."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    tally: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as working:
        place = Path(working)
        for one in judged(write_plans(place / "plans"), place, arguments.seed, arguments.count):
            tally["true" if one.kind.true else "corrupted"] += 1
            tally["right"] += one.right
            if not one.right:
                sys.stdout.write(f"{one.number}: {one.kind.name}, {one.plan}: accepted {one.accepted}\n")
                sys.stdout.write(one.said)
    sys.stdout.write(
        f"{tally['right']} of {arguments.count} judged right: {tally['corrupted']} corrupted, {tally['true']} true\n"
    )


if __name__ == "__main__":
    main()
