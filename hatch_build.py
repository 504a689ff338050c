"""Compile the package's C into one library: Hatch's hook at every install, or ``python hatch_build.py`` in place.

The compiler is the one that ``CC`` names, else the first of cc, gcc and clang that is found, else the ziglang wheel,
which the hook then adds to what is needed for building.
"""

import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent
LIBRARY = ROOT / "ccm_opt" / ("_native.dll" if sys.platform == "win32" else "_native.so")
DYNAMICS = ROOT / "ccm_opt" / "dynamics" / "runtime"
"""Folder of the C files that are no library by themselves: the generated functions of a link go in front of them."""
# Every operation is rounded by itself, as IEEE 754 has it: no product is fused with a sum, no sum reordered. So all
# processors, compilers and vector widths give the same numbers to the last bit. Nobody reads errno or floating-point
# traps, and without them loops can be vectorised; no value changes.
FLAGS = ("-O3", "-g0", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-fvisibility=hidden")
STRUCT = re.compile(r"typedef struct \{([^{}]*)\}\s*(\w+)\s*;")
FUNCTION = re.compile(r"\bvoid\s+(\w+)\s*\(\s*(?:const\s+)?(\w+)\s*\*\s*\w+\s*\)\s*\{")
PUBLIC = re.compile(r"^PUBLIC void (\w+)\(", re.MULTILINE)


class BuildError(Exception):
    """The library cannot be built; the message says why in one line."""


def find_compiler() -> list[str]:
    """Return the command of the C compiler; empty where only the ziglang wheel is left, and is not installed."""
    chosen = shlex.split(os.environ.get("CC", ""))
    found = chosen or [path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))][:1]
    if found or find_spec("ziglang") is None:
        return found
    # A named target has the processor's baseline and zig's own headers, whatever this machine has.
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    libc = "gnu.2.28" if platform.libc_ver()[0] == "glibc" else "musl"
    system = {"win32": "windows-gnu", "darwin": "macos.11.0"}.get(sys.platform, f"linux-{libc}")
    # Without zig's own runtime sines are those of the C library, to the last bit those of other compilers' code; what
    # chooses wide vectors is in that runtime, too.
    options = ("-rtlib=none", "-DWIDE=") if sys.platform == "linux" else ()
    return [sys.executable, "-m", "ziglang", "cc", *options, "-target", f"{machine}-{system}"]


def build(library: Path, work: Path, flags: Sequence[str] = ()) -> None:
    """Compile all C of the package.

    Args:
        library: file to make.
        work: folder for objects; those that are newer than all of their source are used again.
        flags: further ones of the compiler.

    Raises:
        BuildError: it cannot be done.
    """
    compiler = find_compiler()
    if not compiler:
        raise BuildError(
            "no C compiler was found: install one (cc, gcc or clang), name it by CC, or pip install ziglang"
        )
    work.mkdir(parents=True, exist_ok=True)
    sources = [path for path in sorted(ROOT.glob("ccm_opt/**/*.c")) if path.parent != DYNAMICS]
    sources += _dynamics_sources(work)
    headers = sorted(ROOT.glob("ccm_opt/**/*.h"))
    newest = max(path.stat().st_mtime for path in (*headers, Path(__file__)))
    command = (*compiler, *FLAGS, *flags, *(f"-I{folder}" for folder in sorted({path.parent for path in headers})))

    def compiled(source: Path) -> tuple[Path, dict[str, Any]]:
        target, layouts = (work / source.with_suffix(suffix).name for suffix in (".o", ".json"))
        made = min((path.stat().st_mtime if path.exists() else 0.0) for path in (target, layouts))
        if made <= max(newest, source.stat().st_mtime):
            text = _run([*command, "-E", "-P", str(source)])
            layouts.write_text(json.dumps(_layouts(text, source)))
            _run([*command, "-c", str(source), "-o", str(target)])
        return target, json.loads(layouts.read_text())

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        results = list(pool.map(compiled, sources))
    told = {name: fields for _, layouts in results for name, fields in layouts.items()}
    text = json.dumps(json.dumps(told, separators=(",", ":")))
    about = work / "native_layouts.c"
    _write_if_new(about, f'#include "native.h"\nPUBLIC const char native_layouts[] = {text};\n')
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        # Put in place in one step: others may have the library loaded.
        made = Path(folder) / library.name
        _run([*command, "-shared", str(about), *(str(target) for target, _ in results), "-o", str(made), "-lm"])
        made.replace(library)


def _dynamics_sources(work: Path) -> list[Path]:
    """Generate the sources of the dynamics, one for each structure of an arm."""
    sys.path.insert(0, str(ROOT))
    from ccm_opt.dynamics.runtime.c_source import every_source  # noqa: PLC0415 - the package that is built

    sources = []
    for name, text in every_source().items():
        sources.append(work / name)
        _write_if_new(work / name, text)
    return sources


def _layouts(text: str, source: Path) -> dict[str, Any]:
    """Read the structs of the public functions from a preprocessed source: fields by the name of the function."""
    structs = {name: body for body, name in STRUCT.findall(text)}
    public = set(PUBLIC.findall(source.read_text(encoding="utf-8")))
    functions = [match for match in FUNCTION.findall(text) if _plain(match[0]) in public]
    if len(functions) != len(public):
        raise BuildError(f"{source}: not every PUBLIC function takes a pointer to one struct")
    return {name: _fields(structs, struct, source) for name, struct in functions}


def _plain(name: str) -> str:
    """Name of a function without that of the structure of arms."""
    return name.split("__", maxsplit=1)[0]


def _fields(structs: dict[str, str], name: str, source: Path) -> list[tuple[str, Any, str]]:
    """Fields of a struct: name, type (fields for a struct), and '', 'in' or 'out' for pointers, or a length."""
    fields: list[tuple[str, Any, str]] = []
    for line in filter(None, (" ".join(part.split()) for part in structs[name].split(";"))):
        kind, declared = re.fullmatch(r"((?:const )?\w+) (.*)", line).groups()  # type: ignore[union-attr]
        of = kind.removeprefix("const ")
        inner = _fields(structs, of, source) if of in structs else of
        for each in declared.split(","):
            found = re.fullmatch(r"\s*(\**)\s*(\w+)(?:\[(\w+)\])?\s*", each)
            if found is None:
                raise BuildError(f"{source}: field '{line}' of {name} is more than this reads")
            stars, field, length = found.groups()
            use = ("in" if kind.startswith("const ") else "out") if stars else (length or "")
            fields.append((field, "pointer" if len(stars) > 1 else inner, use))
    return fields


def _run(command: list[str]) -> str:
    """Run a command to its end and return what it writes.

    Raises:
        BuildError: it fails.
    """
    try:
        ended = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)  # noqa: S603
    except OSError as error:
        raise BuildError(f"the C compiler {command[0]} cannot be run: {error.strerror}") from error
    if ended.returncode:
        lines = [line for line in ended.stderr.splitlines() if line.strip()] or [f"exit code {ended.returncode}"]
        reason = next(line for sign in (" error: ", "multiple ", "undefined ", "") for line in lines if sign in line)
        raise BuildError(f"the C compiler failed: {reason.strip()}")
    return ended.stdout


def _write_if_new(path: Path, text: str) -> None:
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # in place, where nothing is built but the library
    BuildHookInterface = object


class CompilingHook(BuildHookInterface):  # type: ignore[type-arg,misc,valid-type]
    """Puts the compiled library into the wheel."""

    def dependencies(self) -> list[str]:
        """Ask for a C compiler where there is none."""
        return [] if find_compiler() else ["ziglang"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile into the source tree, from where editable installs load too."""
        del version
        with tempfile.TemporaryDirectory() as work:
            try:
                build(LIBRARY, Path(work))
            except BuildError as error:
                self.app.abort(f"ccm_opt cannot be built: {error}")
        # The library is plain C for one system, called by ctypes: any Python can load it.
        system = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        if sys.platform == "darwin":  # Python's own may be for two kinds of processor, the library is for one
            system = f"macosx_11_0_{platform.machine()}"
        build_data["tag"] = f"py3-none-{system}"
        build_data["pure_python"] = False
        build_data["artifacts"].append(f"/{LIBRARY.relative_to(ROOT).as_posix()}")


if __name__ == "__main__":
    try:
        build(LIBRARY, ROOT / "build" / "native")
    except BuildError as problem:
        sys.exit(f"ccm_opt cannot be built: {problem}")
