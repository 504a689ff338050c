"""``python -m tests.fuzz .svg --runs 1000000`` reads as many drawings; one that is not dealt with ends it, and is kept.

``python -m tests.soak`` mutates files and knows nothing of the readers. This engine keeps whatever makes a reader run a
line or a branch that nothing before did, and goes on from there.
"""

import argparse
import sys
import tempfile
import warnings
from pathlib import Path

import atheris

from ccm_opt.errors import CcmError

with atheris.instrument_imports(include=["ccm_opt.files.scene_import"]):
    from ccm_opt.files.scene_import import ImportOptions, import_scene

SEEDS = Path(__file__).parents[1] / "data"
PROBLEMS = Path(__file__).parents[2] / "problems"
OPTIONS = ImportOptions(scale=0.001)
FORMATS = (".svg", ".dxf", ".wkt", ".geojson")
LONGEST = 5
"""Time that reading one file may take [s]."""
LARGEST = 20_000
"""Size of a drawing [bytes]."""


def main() -> None:
    """Read drawings of one format; the engine ends the process."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("suffix", choices=FORMATS)
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=int, default=0, help="at most; 0: no bound")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    warnings.simplefilter("error")  # what is refused in the end must not have been computed with before
    with tempfile.TemporaryDirectory() as folder:
        corpus = Path(folder) / "corpus"
        corpus.mkdir()
        for place in (SEEDS, PROBLEMS):
            for path in sorted(place.rglob(f"*{options.suffix}")):
                if path.stat().st_size < LARGEST:
                    (corpus / path.name).write_bytes(path.read_bytes())
        kept = Path("runs") / "fuzz"
        kept.mkdir(parents=True, exist_ok=True)
        drawing = Path(folder) / f"drawing{options.suffix}"
        settings = [f"-runs={options.runs}", f"-max_total_time={options.seconds}", f"-seed={options.seed}"]
        settings += [f"-timeout={LONGEST}", f"-max_len={LARGEST}", f"-artifact_prefix={kept}/{options.suffix[1:]}-"]
        atheris.Setup(
            [sys.argv[0], *settings, "-print_final_stats=1", str(corpus)], lambda content: read(drawing, content)
        )
        atheris.Fuzz()


def read(path: Path, content: bytes) -> None:
    """Read one drawing; it is read, or refused by an error of ours."""
    path.write_bytes(content)
    try:
        import_scene(path, OPTIONS)
    except CcmError as error:
        if not str(error).strip():
            raise RuntimeError("refused without a word") from error


if __name__ == "__main__":
    main()
