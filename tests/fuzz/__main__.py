"""``python -m tests.fuzz .svg --runs 1000000`` reads as many files; one that is not dealt with ends it, and is kept.

``python -m tests.soak`` mutates files and knows nothing of the readers. This engine keeps whatever makes a reader run a
line or a branch that nothing before did, and goes on from there. Every other file it makes from bytes and words of the
format, the others from whole numbers, words and lines, which get past a parser more often.

Files are small: a reader takes the longer the more it is given, and what only large files bring about has its own tests
(``tests/test_input_bounds.py``).
"""

import argparse
import gc
import random
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import atheris

from ccm_opt.core.errors import CcmError
from tests.fuzz.seeds import WORDS, seeds
from tests.soak.mutations import mutated
from tests.space_files import three_mf

with atheris.instrument_imports(include=["ccm_opt.io"]):
    from ccm_opt.io.drawing import READERS, ImportOptions, import_scene
    from ccm_opt.io.mesh_obstacles import MESH_READERS, read_mesh_file, repaired_mesh

OPTIONS = ImportOptions(scale=0.001)
LONGEST = 5
"""Time of the processor that reading one file may take [s]."""
HANGING = 60
"""Time on the clock after which a file counts as one that is never read [s]; a busy machine may need much of it."""
LARGEST = 4096
"""Size of a file [bytes]."""
IN_MEMORY = Path("/dev/shm")  # noqa: S108 - a folder of its own is made in it
"""Where files are written and read the fastest."""


def main() -> None:
    """Read files of one format; the engine ends the process."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("suffix", choices=[suffix for suffix in (*READERS, *MESH_READERS) if suffix in WORDS])
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=int, default=0, help="at most; 0: no bound")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1, 10**6), help="of all draws")
    options = parser.parse_args()
    print(f"seed {options.seed}", flush=True)  # noqa: T201 - what repeats the run
    warnings.simplefilter("error")  # what is refused in the end must not have been computed with before
    kept = Path("runs") / "fuzz"
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=IN_MEMORY if IN_MEMORY.is_dir() else None) as name:
        folder = Path(name)
        settings = [f"-runs={options.runs}", f"-max_total_time={options.seconds}", f"-seed={options.seed}"]
        settings += [
            f"-timeout={HANGING}",
            f"-max_len={LARGEST}",
            "-len_control=100",
            f"-artifact_prefix={kept}/{options.suffix[1:]}-",
        ]
        settings += [f"-dict={_dictionary(folder, options.suffix)}", "-print_final_stats=1"]
        file = folder / f"file{options.suffix}"
        atheris.Setup(
            [sys.argv[0], *settings, str(_corpus(folder, options.suffix))],
            _reading(file),
            custom_mutator=_mutated,
        )
        gc.freeze()  # what is loaded stays, and need not be looked through again and again
        atheris.Fuzz()


def _dictionary(folder: Path, suffix: str) -> Path:
    """The words of a format, as the engine reads them."""
    escaped = [word.replace("\\", r"\\").replace('"', r"\"") for word in WORDS[suffix].split()]
    path = folder / "words"
    path.write_text("".join(f'"{word}"\n' for word in escaped), encoding="utf-8")
    return path


def _corpus(folder: Path, suffix: str) -> Path:
    """A folder of the files that the engine begins with."""
    corpus = folder / "corpus"
    corpus.mkdir()
    for number, content in enumerate(seeds(suffix)):
        (corpus / str(number)).write_bytes(content)
    return corpus


def _mutated(content: bytes, largest: int, seed: int) -> bytes:
    """A file made of another, half of them by the engine itself."""
    generator = random.Random(seed)  # noqa: S311 - no secret
    if generator.random() < 0.5:
        made: bytes = atheris.Mutate(content, largest)
        return made
    return mutated(content, generator, largest)


def _reading(file: Path) -> Callable[[bytes], None]:
    """What reads one file; it is read, or refused by an error of ours."""
    read = _read_mesh if file.suffix in MESH_READERS else _read_drawing

    def tried(content: bytes) -> None:
        # A packed file with a byte changed is no more than a broken archive: most are what is in one instead.
        packs = file.suffix == ".3mf" and not content.startswith(b"PK")
        file.write_bytes(three_mf(content) if packs else content)
        begun = time.process_time()
        try:
            read(file)
        except CcmError as error:
            if not str(error).strip():
                raise RuntimeError("refused without a word") from error
        taken = time.process_time() - begun
        if taken > LONGEST:
            raise RuntimeError(f"dealt with in {taken:.1f} s only")

    return tried


def _read_drawing(path: Path) -> None:
    import_scene(path, OPTIONS)


def _read_mesh(path: Path) -> None:
    repaired_mesh(read_mesh_file(path))


if __name__ == "__main__":
    main()
