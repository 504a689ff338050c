"""Which tests run which lines, and how long each takes: found by one run of the tests under coverage."""

import hashlib
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from tests.mutation.mutants import Mutant

TESTS = (
    "base_axes",
    "consistency",
    "contradictions",
    "corruption",
    "effort_share",
    "fed_proofs",
    "limit_tolerances",
    "motion_certificate",
    "motion_contacts",
    "near_pairs",
    "pauses",
    "pinned_figures",
    "point_limits",
    "promises",
    "radius_zero",
    "room",
    "rounding",
    "sample_bounds",
    "tolerance",
    "verification",
    "verification_feed",
    "wall_proofs",
)
"""Files of tests that hold the proofs and the verifier, of which most others make use, too."""
SETTINGS = """\
[run]
branch = true
source = ccm_opt.verification,ccm_opt.scene
data_file = {data}
[json]
show_contexts = true
output = {report}
"""


@dataclass(frozen=True)
class Covering:
    """What is known of the tests.

    Attributes:
        lines: by file and line the tests that run it.
        seconds: of every test.
    """

    lines: dict[str, dict[str, list[str]]]
    seconds: dict[str, float]

    def tests_of(self, path: str, mutant: Mutant) -> list[str]:
        """Tests that may find a mistake: pinned figures first, then the quickest."""
        lines = self.lines.get(path, {})
        wanted = list(lines) if mutant.at_import else [str(line) for line in range(mutant.first, mutant.last + 1)]
        tests = {test for line in wanted for test in lines.get(line, ())}
        return sorted(tests, key=lambda test: ("pinned" not in test, self.seconds[test]))


def covering(folder: Path) -> Covering:
    """Run the tests under coverage, or take what an earlier run of the same files has left in the folder."""
    report = folder / "coverage.json"
    times = folder / "times.xml"
    state = folder / "state"
    now = _state_of_files()
    if not state.exists() or state.read_text(encoding="ascii") != now:
        folder.mkdir(parents=True, exist_ok=True)
        settings = folder / "coveragerc"
        settings.write_text(SETTINGS.format(data=folder / "data", report=report), encoding="utf-8")
        files = [str(path) for name in TESTS if (path := Path(f"tests/test_{name}.py")).exists()]
        options = [
            "--cov",
            f"--cov-config={settings}",
            "--cov-context=test",
            "--cov-report=json",
            f"--junitxml={times}",
        ]
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "--hypothesis-seed=1",
            "-p",
            "no:cacheprovider",
            "-n0",
            *options,
            *files,
        ]
        subprocess.run(command, check=True)
        state.write_text(now, encoding="ascii")
    cases = ET.parse(times).iter("testcase")  # noqa: S314 - our own file
    seconds = {
        f"{case.get('classname', '').replace('.', '/')}.py::{case.get('name')}": float(case.get("time", 0))
        for case in cases
    }
    lines = {}
    for path, found in json.loads(report.read_text(encoding="utf-8"))["files"].items():
        of_file = {}
        for line, contexts in found["contexts"].items():
            tests = {context.partition("|")[0] for context in contexts if context}
            of_file[line] = [test for test in tests if test in seconds]
        lines[path] = of_file
    return Covering(lines, seconds)


def _state_of_files() -> str:
    """A digest of what the tests run and of the tests, since lines move and tests get other names."""
    digest = hashlib.sha256()
    for place in ("ccm_opt/verification", "ccm_opt/scene", "tests"):
        for path in sorted(Path(place).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()
