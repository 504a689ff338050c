"""The recursions compiled by the machine's C compiler, once for arms of any number of links, and kept on disk.

CasADi generates the functions of one link; ``recursion.c`` runs them along the arm and closes the loop. Masses,
lengths, gravity, gains and the number of links are run-time inputs, so that a machine compiles at most four libraries:
two orders of axes, with rotor inertia or without. Without a compiler, or when it fails, CasADi's virtual machine
evaluates the same functions, about ten times slower; one log line says so.
"""

import ctypes
import hashlib
import logging
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import platformdirs

from ccm_opt.dynamics.algorithms.aba import aba_steps
from ccm_opt.dynamics.algorithms.model import Structure, arm_structure
from ccm_opt.dynamics.algorithms.rnea import rnea_steps
from ccm_opt.jointed.arm import Arm

CACHE_VARIABLE = "CCM_OPT_CACHE"  # folder of the cache
COMPILER_VARIABLE = "CCM_OPT_CC"  # compiler to use; empty: none
COMPILERS = ("gcc", "clang", "cc")
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC")
COMPILE_TIME_LIMIT = 300.0  # s
RECURSION = Path(__file__).with_name("recursion.c")
PRIVATE = "#define CASADI_SYMBOL_EXPORT static inline\n"  # the functions of one link are for the recursions alone
SYMBOLS = ("inverse_dynamics", "forward_dynamics", "simulate")
_one_at_a_time = threading.Lock()
logger = logging.getLogger(__name__)


def prepare(arm: Arm) -> None:
    """Begin to compile in the background what an arm will need; ``load_library`` waits for it."""
    pool = ThreadPoolExecutor(1, thread_name_prefix="compile")
    pool.submit(load_library, arm_structure(arm))
    pool.shutdown(wait=False)


def load_library(structure: Structure) -> ctypes.CDLL | None:
    """The compiled recursions of a structure, from the cache or compiled first; None when there is no compiling."""
    compiler = find_compiler()
    if compiler is None:
        _say_uncompiled("no C compiler was found")
        return None
    library = cache_folder() / f"{_digest(_key(structure), compiler)}{'.dll' if sys.platform == 'win32' else '.so'}"
    try:
        with _one_at_a_time:
            if library.exists():
                with suppress(OSError, AttributeError):  # damaged: compile it again
                    return _open(library)
            _compile(library, compiler, structure)
            return _open(library)
    except (OSError, AttributeError, RuntimeError, subprocess.SubprocessError) as error:
        _say_uncompiled(_first_line(error))
        return None


def find_compiler() -> str | None:
    """Path of the C compiler: ``CCM_OPT_CC`` or the first of gcc, clang, cc; None when there is none."""
    chosen = os.environ.get(COMPILER_VARIABLE)
    candidates = COMPILERS if chosen is None else (chosen,)
    return next((path for name in candidates if name and (path := shutil.which(name))), None)


def cache_folder() -> Path:
    """Folder of compiled functions: under ``CCM_OPT_CACHE`` or the user's cache folder."""
    root = os.environ.get(CACHE_VARIABLE) or platformdirs.user_cache_dir("ccm_opt", appauthor=False)
    return Path(root) / "dynamics"


def _key(structure: Structure) -> str:
    """What the generated code depends on, beside this package's source."""
    return f"{structure.axes} {'geared' if structure.geared else 'free'}"


def _open(library: Path) -> ctypes.CDLL:
    """Load a library that keeps the interpreter's lock while it runs, which makes short calls shorter."""
    opened = ctypes.PyDLL(str(library))
    for symbol in SYMBOLS:
        function = getattr(opened, symbol)
        function.restype, function.argtypes = None, (ctypes.c_void_p,)
    return opened


def _compile(library: Path, compiler: str, structure: Structure) -> None:
    """Generate, compile, and put the finished library in its place in one step, so that readers see all or nothing."""
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        source, output = Path(folder) / "dynamics.c", Path(folder) / library.name
        source.write_text(source_text(structure), encoding="utf-8")
        command = [compiler, *FLAGS, str(source), "-o", str(output), "-lm"]
        subprocess.run(command, check=True, capture_output=True, timeout=COMPILE_TIME_LIMIT)  # noqa: S603 - our own list
        output.replace(library)


def source_text(structure: Structure) -> str:
    """C source: the functions of one link, then the recursions around them."""
    rnea, aba = rnea_steps(structure.axes), aba_steps(structure)
    sizes = {"STATE": aba.inertia.size1_in(0), "SOLVED": aba.inertia.size1_out(1)}
    defines = "".join(f"#define {name} {size}\n" for name, size in sizes.items())
    return f"{PRIVATE}{_generated([*rnea, *aba])}\n{defines}{RECURSION.read_text(encoding='utf-8')}"


def _generated(functions: Sequence[Any]) -> str:
    generator = ca.CodeGenerator("steps.c")
    for function in functions:
        if not all(function.sparsity_out(i).is_dense() for i in range(function.n_out())):
            raise RuntimeError(f"{function.name()} leaves out zeros, which the recursions do not expect")
        generator.add(function)
    return _without_null_checks(str(generator.dump()))


def _without_null_checks(code: str) -> str:
    """The same code for callers that pass every argument and take every result."""
    code = re.sub(r"arg\[(\d+)\]\? arg\[\1\]\[(\d+)\] : 0", r"arg[\1][\2]", code)
    return re.sub(r"if \(res\[\d+\]!=0\) res", "res", code)


def _digest(key: str, compiler: str) -> str:
    """Name of a library: everything its machine code depends on."""
    parts = (key, str(ca.CasadiMeta.version()), _version(compiler), " ".join(FLAGS), _processor(), _own_source())
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


@cache
def _version(compiler: str) -> str:
    result = subprocess.run([compiler, "--version"], check=False, capture_output=True, text=True)  # noqa: S603 - path from which()
    return f"{compiler}\n{result.stdout}"


@cache
def _processor() -> str:
    """The processor's instruction set: ``-march=native`` code must not run on another one that shares the cache."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())
    return f"{platform.system()} {platform.machine()} {flags}"


@cache
def _own_source() -> str:
    """Digest of this package's source, from which the code is generated."""
    digest = hashlib.sha256()
    for path in sorted([*Path(__file__).parents[1].rglob("*.py"), RECURSION]):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _say_uncompiled(reason: str) -> None:
    logger.warning("dynamics run in CasADi's virtual machine, about ten times slower than compiled: %s", reason)


def _first_line(error: Exception) -> str:
    if isinstance(error, subprocess.CalledProcessError) and error.stderr:
        return f"the C compiler failed: {error.stderr.decode(errors='replace').strip().splitlines()[0]}"
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
