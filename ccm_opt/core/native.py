"""The package's compiled C: one library, made by the build hook, and calls of its functions.

Every function takes the address of one struct. What the structs look like the build reads from the C source and keeps
in the library (``hatch_build.py``), so that Python never repeats it and the two cannot differ.
"""

import ctypes
import json
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.core.errors import NativeLibraryError

LIBRARY = Path(
    os.environ.get("CCM_OPT_NATIVE")
    or Path(__file__).parents[1] / f"_native.{'dll' if sys.platform == 'win32' else 'so'}"
)
"""The library's file; ``CCM_OPT_NATIVE`` names another, as `tests.sanitizers` does."""
_HOW_TO_BUILD = "install ccm_opt anew (pip install .), or run 'python hatch_build.py' in its source folder"
_NUMBERS: dict[str, Any] = {"int64_t": ctypes.c_int64, "int32_t": ctypes.c_int32, "double": ctypes.c_double,
                            "float": ctypes.c_float}  # fmt: skip
_ELEMENTS = {"int64_t": np.int64, "int32_t": np.int32, "double": np.float64, "float": np.float32, "uint8_t": np.uint8}
_BYTES = np.dtype(np.uint8)


@dataclass(frozen=True, eq=False)
class _Pointer:
    """What a pointer in a struct points to.

    Attributes:
        dtype: of the elements; None where C does not say.
        struct: layout of the struct that they are; None for numbers.
        read_only: whether C only reads them.
    """

    dtype: np.dtype[Any] | None
    struct: "_Layout | None"
    read_only: bool


@dataclass(frozen=True, eq=False)
class _Layout:
    """A struct of C.

    Attributes:
        type: the same for ctypes.
        pointers: its fields that are pointers, by name.
        structs: its fields that are structs themselves.
    """

    type: type[ctypes.Structure]
    pointers: Mapping[str, _Pointer]
    structs: Mapping[str, "_Layout"]


@cache
def native_library() -> ctypes.PyDLL:
    """Load the library; it keeps the interpreter's lock while it runs, which makes short calls shorter.

    Raises:
        NativeLibraryError: it is missing, or none for this machine.
    """
    try:
        return ctypes.PyDLL(str(LIBRARY))
    except OSError as error:
        told = f"{LIBRARY} is missing" if not LIBRARY.exists() else f"{LIBRARY} cannot be loaded ({error})"
        raise NativeLibraryError(f"the compiled library {told}: {_HOW_TO_BUILD}") from error


def native_constant(name: str) -> int:
    """Return an int64_t that the library tells."""
    return ctypes.c_int64.in_dll(native_library(), name).value


@cache
def _told() -> Mapping[str, Any]:
    """Return the structs of the functions, as the build has read them from the source."""
    text = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(native_library(), "native_layouts")))
    told: Mapping[str, Any] = json.loads(text)
    return told


@cache
def _function(name: str) -> Any:
    function = getattr(native_library(), name)
    function.restype = None
    function.argtypes = (ctypes.c_void_p,)
    return function


@cache
def _struct_layout(function: str) -> _Layout:
    if function not in _told():
        raise NativeLibraryError(f"the compiled library {LIBRARY} is older than its source: {_HOW_TO_BUILD}")
    return _layout(_told()[function])


def _layout(fields: list[tuple[str, Any, str]]) -> _Layout:
    """Translate a struct; a field is its name, its type (fields for a struct), and '', 'in', 'out' or a length."""
    types: list[tuple[str, Any]] = []
    pointers: dict[str, _Pointer] = {}
    structs: dict[str, _Layout] = {}
    for name, kind, use in fields:
        inner = None if isinstance(kind, str) else _layout(kind)
        if use in {"in", "out"}:
            element = None if inner else _ELEMENTS.get(kind)
            dtype = np.dtype(inner.type) if inner else None if element is None else np.dtype(element)
            pointers[name] = _Pointer(dtype, inner, use == "in")
            types.append((name, ctypes.c_void_p))
            continue
        if inner:
            structs[name] = inner
        number = inner.type if inner else _NUMBERS[kind]
        types.append((name, number * int(use) if use else number))
    return _Layout(type("Struct", (ctypes.Structure,), {"_fields_": types}), pointers, structs)


def element_type(function: str, field: str) -> np.dtype[Any]:
    """Return the type of the elements that a pointer of a function's struct points to, for arrays of structs."""
    dtype = _struct_layout(function).pointers[field].dtype
    return np.dtype(dtype)


class NativeCall:
    """A function of the compiled library with its struct, ready to be called any number of times.

    Values are numbers, arrays for pointers, sequences for arrays within the struct, mappings for structs and for
    pointers to one. Arrays that C only reads are converted to its type; what it writes into must have that type
    already. All that C has the address of lives as long as the call. Not for use by two threads at once.

    Attributes:
        fields: the struct, whose numbers can be read and set.
        function: the C function, to be called with ``address`` where every nanosecond counts.
        address: of the struct.

    Args:
        name: of the C function.
        values: of the fields by their names in C; the others are zero or null.

    Raises:
        NativeLibraryError: the library is missing, or has no such function.
    """

    def __init__(self, name: str, **values: Any) -> None:
        self._layout = _struct_layout(name)
        self._kept: dict[str, object] = {}
        self.fields: Any = self._layout.type()
        self.function = _function(name)
        self.address = ctypes.addressof(self.fields)
        self.set(**values)

    def set(self, **values: Any) -> None:
        """Set fields of the struct.

        Raises:
            TypeError: C would write into an array of another type or layout.
        """
        _fill(self.fields, self._layout, values, self._kept)

    def __call__(self) -> None:
        """Run the function."""
        self.function(self.address)


def _fill(struct: Any, layout: _Layout, values: Mapping[str, Any], kept: dict[str, object]) -> None:
    for name, value in values.items():
        pointer = layout.pointers.get(name)
        if pointer is not None:
            kept[name] = owner = _owner(pointer, value, name)
            setattr(struct, name, _address(owner))
        elif name in layout.structs:
            inside: dict[str, object] = {}
            _fill(getattr(struct, name), layout.structs[name], value, inside)
            kept[name] = inside
        elif isinstance(value, (list, tuple, np.ndarray)):
            getattr(struct, name)[:] = list(value)
        else:
            setattr(struct, name, value)


def _owner(pointer: _Pointer, value: Any, name: str) -> Any:
    """Return what holds the memory that a pointer gets."""
    if isinstance(value, np.ndarray) and value.dtype == pointer.dtype and pointer.struct is None:
        flags = value.flags
        if flags.c_contiguous and (pointer.read_only or flags.writeable):
            return value
    if isinstance(value, Mapping) and pointer.struct is not None:
        return _OwnedStruct(pointer.struct, value)
    if value is None or pointer.dtype is None or isinstance(value, bytes):
        return value
    if pointer.read_only and pointer.struct is None and pointer.dtype != _BYTES:
        return np.ascontiguousarray(value, dtype=pointer.dtype)
    array: npt.NDArray[Any] = value
    fits = array.dtype.itemsize == pointer.dtype.itemsize and array.dtype.kind in {pointer.dtype.kind, "b", "V"}
    if not (fits and array.flags.c_contiguous and (pointer.read_only or array.flags.writeable)):
        raise TypeError(f"'{name}' must be a contiguous array of {pointer.dtype} for C, got {array.dtype}")
    return array


class _OwnedStruct:
    """A struct that a pointer points to, with what its own pointers point to."""

    def __init__(self, layout: _Layout, values: Mapping[str, Any]) -> None:
        self.struct = layout.type()
        self._kept: dict[str, object] = {}
        _fill(self.struct, layout, values, self._kept)


def _address(owner: Any) -> Any:
    if isinstance(owner, np.ndarray):
        return owner.__array_interface__["data"][0]
    if isinstance(owner, _OwnedStruct):
        return ctypes.addressof(owner.struct)
    if isinstance(owner, bytes):
        return ctypes.cast(ctypes.c_char_p(owner), ctypes.c_void_p).value
    return owner
