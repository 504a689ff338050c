"""The compiled C library of the package, created by the build hook, and calls of its functions.

Every C function takes the address of one struct. The build (``hatch_build.py``) reads the layouts of the structs from
the C source and stores them in the library, so that Python does not repeat them and the two cannot differ.
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
"""Path of the library; the environment variable ``CCM_OPT_NATIVE`` selects another one, for tests."""
_HOW_TO_BUILD = "install ccm_opt anew (pip install .), or run 'python hatch_build.py' in its source folder"
_NUMBERS: dict[str, Any] = {"int64_t": ctypes.c_int64, "int32_t": ctypes.c_int32, "double": ctypes.c_double,
                            "float": ctypes.c_float}  # fmt: skip
_ELEMENTS = {"int64_t": np.int64, "int32_t": np.int32, "double": np.float64, "float": np.float32, "uint8_t": np.uint8}
_BYTES = np.dtype(np.uint8)
_HEADER = object.__basicsize__
"""Size of the header of a Python object, behind which an array keeps the address of its data."""


@dataclass(frozen=True, eq=False)
class _Pointer:
    """Type of the elements that a pointer field of a C struct points to.

    Attributes:
        dtype: type of the elements; None for a pointer without element type.
        struct: layout of the elements if they are structs; None for numbers.
        read_only: whether C only reads the elements.
    """

    dtype: np.dtype[Any] | None
    struct: "_Layout | None"
    read_only: bool


@dataclass(frozen=True, eq=False)
class _Layout:
    """The layout of a C struct.

    Attributes:
        type: the struct as a ctypes type.
        pointers: targets of the fields that are pointers, by name.
        structs: layouts of the fields that are structs, by name.
    """

    type: type[ctypes.Structure]
    pointers: Mapping[str, _Pointer]
    structs: Mapping[str, "_Layout"]


@cache
def native_library() -> ctypes.PyDLL:
    """Return the compiled library, loaded on first use.

    Its functions hold the interpreter lock, which makes short calls faster.

    Raises:
        NativeLibraryError: the library is missing, or cannot be loaded on this machine.
    """
    try:
        return ctypes.PyDLL(str(LIBRARY))
    except OSError as error:
        problem = f"{LIBRARY} is missing" if not LIBRARY.exists() else f"{LIBRARY} cannot be loaded ({error})"
        raise NativeLibraryError(f"the compiled library {problem}: {_HOW_TO_BUILD}") from error


def native_constant(name: str) -> int:
    """Return the value of an ``int64_t`` constant that the compiled library exports."""
    return ctypes.c_int64.in_dll(native_library(), name).value


@cache
def _native_interface() -> Mapping[str, Any]:
    """Return the fields of the struct of every C function, as the build stored them in the library."""
    text = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(native_library(), "native_layouts")))
    interface: Mapping[str, Any] = json.loads(text)
    return interface


@cache
def _function(name: str) -> Any:
    function = getattr(native_library(), name)
    function.restype = None
    function.argtypes = (ctypes.c_void_p,)
    return function


@cache
def _struct_layout(function: str) -> _Layout:
    if function not in _native_interface():
        raise NativeLibraryError(f"the compiled library {LIBRARY} is older than its sources: {_HOW_TO_BUILD}")
    return _layout(_native_interface()[function])


def _layout(fields: list[tuple[str, Any, str]]) -> _Layout:
    """Return the layout of a C struct.

    Args:
        fields: name, type and use of each field; the type of a struct is a list of its fields; the use is 'in' or 'out'
            for a pointer that C reads or writes, the length for an array, and '' otherwise.
    """
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
    """Return the element type of a pointer field of a C function's struct, for making arrays of structs."""
    dtype = _struct_layout(function).pointers[field].dtype
    return np.dtype(dtype)


class NativeCall:
    """A function of the compiled library bound to its struct, callable any number of times.

    Field values are numbers, arrays for pointers, sequences for arrays within the struct, and mappings for structs and
    for pointers to a struct. Arrays that C only reads are converted to the C type; arrays that C writes must already
    have that type. This object keeps alive all memory whose address C gets. It must not be used by two threads at once.

    Attributes:
        fields: the struct, whose numbers can be read and set.
        function: the C function, for direct calls with ``address`` in the innermost loops.
        address: address of the struct.

    Args:
        name: name of the C function.
        values: values of the fields by their names in C; other fields are zero or null.

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
        """Set named fields of the struct.

        Raises:
            TypeError: C would write into an array of another type or layout.
        """
        _fill(self.fields, self._layout, values, self._kept)

    def __call__(self) -> None:
        """Call the bound C function on its struct."""
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
    """Return the object that owns the memory for a pointer field: the value itself, a converted array, or a struct.

    Args:
        pointer: target of the pointer.
        value: value for the field.
        name: name of the field, for messages.

    Raises:
        TypeError: the array cannot be converted, because C writes into it or its elements are structs or bytes.
    """
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
    """A struct that a pointer refers to, together with the memory that its own pointers refer to."""

    def __init__(self, layout: _Layout, values: Mapping[str, Any]) -> None:
        self.struct = layout.type()
        self._kept: dict[str, object] = {}
        _fill(self.struct, layout, values, self._kept)


def _address(owner: Any) -> Any:
    if isinstance(owner, np.ndarray):
        # As `owner.ctypes.data`, which takes eight times as long: most calls of C are short.
        return ctypes.c_void_p.from_address(id(owner) + _HEADER).value
    if isinstance(owner, _OwnedStruct):
        return ctypes.addressof(owner.struct)
    if isinstance(owner, bytes):
        return ctypes.cast(ctypes.c_char_p(owner), ctypes.c_void_p).value
    return owner
