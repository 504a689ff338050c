"""``python -m tests.faults solve --every`` makes each operation of a command fail in turn, and tells what is wrong."""

# ruff: noqa: T201 - it prints what it finds
import argparse
import itertools
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tests.faults import injection

injection.install()

from tests.faults.commands import IN_SPACE, PROBLEM, Bench, run  # noqa: E402 - solvers are met from here on


def main() -> int:
    """Run commands under faults, all of them beside one plan that is made before."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("command", nargs="+", choices=("solve", "check", "export", "compare"))
    parser.add_argument("--space", action="store_true", help="a problem in space")
    parser.add_argument("--every", action="store_true", help="let every operation fail in turn")
    parser.add_argument("--count", type=int, default=20, help="so many operations of each, drawn at random")
    parser.add_argument("--seed", type=int, help="of the draws")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as root:
        bench = Bench(Path(root), IN_SPACE if options.space else PROBLEM)
        bench.prepare()
        return sum(swept(command, bench, options) for command in options.command)


def arguments_of(command: str, bench: Bench) -> list[str]:
    """Command line of a command."""
    if command == "solve":
        return bench.solve()
    if command == "check":
        return ["check", str(bench.target)]
    if command == "compare":
        return [
            "compare",
            str(bench.problem),
            "--method",
            "nlp",
            "--workers",
            "1",
            "--out",
            str(bench.root / "comparison"),
            "--no-pictures",
        ]
    return ["export", str(bench.target), "--format", "urdf", "--out", str(bench.root / "arm.urdf")]


def swept(command: str, bench: Bench, options: argparse.Namespace) -> int:
    """Let operations of a command fail in turn; the number of those after which something is wrong."""
    arguments = arguments_of(command, bench)
    bench.restore()
    clean = run(arguments, None)
    print(f"{command}: {len(clean.faults.kinds)} operations, {dict(Counter(clean.faults.kinds))}")
    numbers = drawn(clean.faults.kinds, None if options.every else options.count, options.seed)
    wrong = 0
    for number in numbers:
        bench.restore()
        shutil.rmtree(bench.root / "comparison", ignore_errors=True)
        outcome = run(arguments, number)
        defects = outcome.defects() + bench.defects()
        if command == "compare":
            # The same command goes on where it was stopped, with every run once.
            again = run([*arguments, "--json"], None)
            defects += [] if again.code == 0 else [f"cannot go on: {again.stderr.strip()[-200:]}"]
        left = bench.leftovers()
        if left:
            # What could not be removed goes with the next run.
            run(bench.solve(), None)
            defects += [f"left for ever: {name}" for name in bench.leftovers() if name in left]
        wrong += bool(defects)
        if number % 20 == 0:
            print(f"  {number} done", flush=True)
        for defect in defects:
            words = (outcome.stderr.strip().splitlines() or [""])[-1 if outcome.code != 1 else -2]
            print(f"  {number} {outcome.faults.failed}: {defect}; exit code {outcome.code}: {words}")
    print(f"{len(numbers)} operations made to fail, {wrong} with something wrong after them")
    return wrong


def drawn(kinds: Sequence[str], count: int | None, seed: int | None) -> list[int]:
    """Numbers of operations to fail: all, or so many, with every kind in its turn."""
    if count is None:
        return list(range(1, len(kinds) + 1))
    generator = random.Random(seed)  # noqa: S311 - no secret
    numbers = {kind: [k for k, each in enumerate(kinds, start=1) if each == kind] for kind in kinds}
    for each in numbers.values():
        generator.shuffle(each)
    in_turn = itertools.chain.from_iterable(itertools.zip_longest(*numbers.values()))
    return sorted(itertools.islice((number for number in in_turn if number is not None), count))


if __name__ == "__main__":
    sys.exit(min(main(), 1))
