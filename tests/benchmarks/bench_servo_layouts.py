"""Whether arms of any layout that are driven by hand touch anything or leave their limits.

    python -m tests.benchmarks.bench_servo_layouts --kinds axes tools --count 5 --ticks 2000 --out layouts.jsonl

Random arms of `bench_random_arms` are driven by random hands from where they begin. The folders that are written are
swept from the problem file alone, by coal and scipy's rotations, and given to `ccm-opt check`. One line of JSON a
drive. Set OMP_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import json
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.errors import CcmError
from tests.benchmarks.bench_random_arms import Drawn, toml
from tests.benchmarks.bench_servo import random_drive
from tests.benchmarks.swept_file import broken_promises


def main() -> None:
    """Parse the options, drive, and print a line of JSON for each drive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="*", default=[])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=5)
    parser.add_argument("--ticks", type=int, default=2000)
    parser.add_argument("--runs", type=Path, default=Path("runs/servo-layouts"))
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    options.runs.mkdir(parents=True, exist_ok=True)
    for seed in range(options.first, options.first + options.count):
        line = json.dumps({"kinds": options.kinds, "seed": seed} | driven(options, seed))
        print(line, flush=True)
        if options.out is not None:
            with options.out.open("a", encoding="utf-8") as file:
                file.write(line + "\n")


def driven(options: argparse.Namespace, seed: int) -> dict[str, object]:
    """Return the figures of one drive and what it breaks, or why there is none."""
    try:
        data = Drawn(seed, 2.0, frozenset(options.kinds), options.runs).data
    except ValueError:
        return {"outcome": "not drawn"}
    file = options.runs / f"{data['name']}.toml"
    file.write_text(toml(data))
    try:
        servo, figures = random_drive(ccm_opt.load_problem(file), seed, options.ticks)
        folder = servo.save(options.runs / f"{data['name']}-driven")
    except CcmError as error:
        return {"outcome": f"refused: {error}"}
    with np.load(folder / "solution.npz") as file_arrays:
        arrays = dict(file_arrays)
    # The goals are not used: the motion ends where the hand leaves the tip.
    end = arrays.get("tool_tip", arrays["joint_positions"][:, -1])[-1]
    broken = broken_promises(data | {"goal": {"position": end}}, arrays, options.runs)
    checked = CliRunner().invoke(app, ["check", str(folder)]).exit_code
    return {"outcome": "driven"} | figures | {"samples": len(arrays["time"]), "broken": broken, "check": checked}


if __name__ == "__main__":
    main()
