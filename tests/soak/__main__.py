"""Everything at length, each part for its share of the time: ``python -m tests.soak --hours 1``.

Plans of random problems of many families, swept densely by an oracle; corrupted solutions; mutated problem files,
drawings and meshes; Ctrl-C at random moments; faults under every operation. What is wrong is told at once, with what
repeats it, and files that were not dealt with are kept.
"""

# ruff: noqa: T201 - it prints what it finds
import argparse
import itertools
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from tests.benchmarks.bench_soundness import SOURCES, outcome
from tests.benchmarks.scene_families import NoSceneError
from tests.soak import hostile_files, memory, signals

MESHES = (".stl", ".obj", ".ply", ".glb", ".3mf")
ENOUGH_TO_WARM = 100
"""Plans after which memory may not grow any more."""


@dataclass(frozen=True)
class Part:
    """Something that is tried again and again.

    Attributes:
        name: for people.
        share: of the time.
        tries: what was wrong with each try, or an empty word, without end or not.
    """

    name: str
    share: float
    tries: Callable[[random.Random], Iterator[str]]


def plans(generator: random.Random) -> Iterator[str]:
    """Random problems of all families, their plans swept densely; memory and the longest wait are told now and then."""
    warm = 0.0
    longest = 0.0
    number = 0
    for name, source in itertools.cycle(SOURCES.items()):
        seed = generator.randrange(10**6)
        try:
            problem = source(seed, 6.0)
        except NoSceneError:
            continue
        number += 1
        begun = time.process_time()
        end = outcome(replace(problem, name=f"{name} {seed}"))
        longest = max(longest, time.process_time() - begun)
        yield "" if end in {"safe", "no plan"} else f"{name} {seed}: {end}"
        if number % ENOUGH_TO_WARM == 0:
            rest = memory.at_rest()
            warm = warm or rest.without_caches
            grown = rest.without_caches - warm
            print(
                f"  after {number} plans: {grown:+.1f} MB since the first {ENOUGH_TO_WARM}; {rest}; "
                f"{memory.most():.0f} MB at most; the longest took {longest:.1f} s",
                flush=True,
            )


def corruptions(generator: random.Random) -> Iterator[str]:
    """Corrupted solutions, a hundred at a time."""
    while True:
        seed = str(generator.randrange(10**6))
        yield from _called(["tests.corruption", "--count", "100", "--seed", seed], 100, "100 of 100 judged right")


def faults(_: random.Random) -> Iterator[str]:
    """Every operation of each command made to fail in turn."""
    for arguments in (["solve"], ["check"], ["export"], ["compare"]):
        yield from _called(["tests.faults", *arguments, "--every"], 1, ", 0 with something wrong")


def files(suffix: str) -> Callable[[random.Random], Iterator[str]]:
    """Mutated files of one kind; those that were not dealt with are kept in ``runs/soak``."""

    def tries(generator: random.Random) -> Iterator[str]:
        if suffix == ".toml":
            each = hostile_files.problem_files(generator)
        elif suffix in MESHES:
            each = hostile_files.meshes(suffix, generator)
        else:
            each = hostile_files.drawings(suffix, generator)
        for number, defect in enumerate(each):
            if defect is None:
                yield ""
                continue
            kept = Path("runs") / "soak" / f"{number}{suffix}"
            kept.parent.mkdir(parents=True, exist_ok=True)
            kept.write_bytes(defect.content)
            yield f"{kept}: {defect.what}"

    return tries


def _called(arguments: list[str], count: int, expected: str) -> Iterator[str]:
    """A module of the tests as a process of its own, which stands for so many tries."""
    ended = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, check=False)
    yield from itertools.repeat("", count - 1)
    yield "" if expected in ended.stdout else f"{' '.join(arguments)}:\n{ended.stdout[-3000:]}{ended.stderr[-2000:]}"


PARTS = (
    Part("plans", 0.5, plans),
    Part("corrupted solutions", 0.1, corruptions),
    Part("problem files", 0.1, files(".toml")),
    *(Part(f"drawings {suffix}", 0.04, files(suffix)) for suffix in (".svg", ".dxf", ".wkt", ".geojson")),
    *(Part(f"meshes {suffix}", 0.02, files(suffix)) for suffix in MESHES),
    Part("Ctrl-C", 0.1, signals.interrupted_commands),
    Part("faults", 0.04, faults),
)


def main() -> int:
    """Run the parts, and print how often each was tried and how often something was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0, help="in all")
    parser.add_argument("--count", type=int, default=10**9, help="tries of each part at most")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6), help="of all draws")
    parser.add_argument("--parts", nargs="+", choices=[part.name for part in PARTS], help="only these")
    options = parser.parse_args()
    print(f"seed {options.seed}", flush=True)
    chosen = [part for part in PARTS if options.parts is None or part.name in options.parts]
    shares = sum(part.share for part in chosen)
    wrong = [tried(part, 3600.0 * options.hours * part.share / shares, options.count, options.seed) for part in chosen]
    return min(sum(wrong), 1)


def tried(part: Part, time_limit: float, most: int, seed: int) -> int:
    """Try one part until its time is over, or so often; how often something was wrong."""
    begun = time.monotonic()
    count, wrong = 0, 0
    for defect in part.tries(random.Random(f"{part.name} {seed}")):  # noqa: S311 - no secret
        count += 1
        if defect:
            wrong += 1
            print(f"- {part.name}: {defect}", flush=True)
        if count == most or time.monotonic() - begun > time_limit:
            break
    print(f"{part.name}: {count} tried, {wrong} wrong, {time.monotonic() - begun:.0f} s", flush=True)
    return wrong


if __name__ == "__main__":
    sys.exit(main())
