"""All use of Numba: its options, its types, and the protection against stale machine code.

Numba's disk cache checks only the file of the compiled function: if an imported callee changed in another file, a kernel
would keep running with the old machine code. The code of each module's kernels is therefore stored in a folder named
after a digest of all their source files (`sources.module_digest`). If any of them changes, also by a reinstall in place,
the folder is a new one. Files without kernels may change freely.

Floating point: results contain no NaN (the Python layer rejects them), the sign of zero has no meaning, and a product may
be fused with a sum. Sums are never reordered. Code that computes a bound or a verdict does not assume that NaN is absent:
every comparison there is written so that NaN has no effect (see `VERDICTS`).
"""

from __future__ import annotations

from . import away  # noqa: F401  # Before Numba is imported for the first time.

# isort: split
import os
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from llvmlite import ir
from numba.core import codegen, config, event, sigutils
from numba.core import compiler as numba_compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.types import unliteral
from numba.extending import intrinsic
from numba.np import arrayobj
from numba.np.numpy_support import as_dtype

from kinseek.support.forks import finish_first
from kinseek.support.interrupts import uninterrupted
from kinseek.support.notices import notice
from kinseek.support.private import private_folder, user_cache

from .kept_code import c_function, keep_code, report_unwritten
from .sources import module_digest

P = ParamSpec("P")
R = TypeVar("R")


def _cache_folder() -> Path | None:
    """Return a folder for this version of Numba that only this user can write to, or None if there is none."""
    user = os.getuid() if hasattr(os, "getuid") else "user"
    candidates: list[tuple[str, ...]] = [(user_cache(), "kinseek")]
    if not _is_working_folder(temporary := tempfile.gettempdir()):
        candidates.append((temporary, f"kinseek-{user}"))
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        candidates.insert(0, (chosen,))
    name, refused = f"kinseek-{numba.__version__}", list[Exception]()
    for base, *names in candidates:
        try:
            folder = private_folder(Path(base).expanduser(), *names, name)
            with tempfile.TemporaryFile(dir=folder):
                return folder
        except (OSError, RuntimeError) as error:  # A RuntimeError is raised if there is no home folder.
            refused.append(error)
    report_unwritten(candidates[0][0], refused[0])
    return None


def _is_working_folder(folder: str) -> bool:
    """Return True if the folder is the working folder, which Python uses for temporary files if no other folder works.

    Its contents may have come from anybody.
    """
    try:
        return os.path.samefile(folder, os.curdir)
    except OSError:  # One of them has been removed.
        return False


_CACHE = _cache_folder()


NUMERICS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"nnan", "nsz", "contract"}}

VERDICTS = tuple(
    f"kinseek.kernels.{place}."
    for place in (
        "arm",
        "collision",
        "maps",
        "proof",
        "paths.around",
        "paths.motion",
        "paths.steps",
        "paths.tube",
    )
)
"""Modules of kernels that compute a bound or a verdict, or parts of one: compiled without assuming that NaN is absent."""


VECTORIZED = tuple(
    f"kinseek.kernels.{room}."
    for room in ("arm", "atlas", "branches", "collision", "paths", "structure", "timing")
)
"""Modules of kernels whose loops LLVM vectorizes. In the others this makes nothing faster and takes a sixth of the time to
compile: look with `python -m benchmarks.since` before a room is added or taken away."""


def numerics(function: Callable[..., Any]) -> dict[str, Any]:
    """Floating-point options for a function, by its module."""
    if f"{function.__module__}.".startswith(VERDICTS):
        return NUMERICS | {"fastmath": {"nsz", "contract"}}
    return NUMERICS


_types: Any = numba.types  # Untyped in Numba itself.
_ELEMENTS = {"f": _types.float64, "i": _types.int64, "b": _types.boolean}
"""Numba's types of numbers, for each `entry.Leaf.element`."""

_WORD = ir.IntType(64)

_make_array: Any = arrayobj.make_array
_njit: Any = numba.njit  # Its stubs leave out `no_cfunc_wrapper`, which saves compile time.
signature_of: Callable[[str], Any] = sigutils.normalize_signature
_unliteral: Callable[[Any], Any] = unliteral


def bare(function: Callable[..., Any], exact: bool, counted: bool) -> Any:
    """A kernel for a library: without a Python wrapper and without a copy on disk.

    Args:
        function: The kernel.
        exact: True if it may not assume what `numerics` lets it assume.
        counted: True if references to arrays are counted, which a kernel that allocates needs.
    """
    options = numerics(function) | ({"fastmath": False} if exact else {})
    return _njit(
        nogil=True,
        no_cfunc_wrapper=True,
        no_cpython_wrapper=True,
        _nrt=counted,
        pipeline_class=_compiler_of(function),
        **options,
    )(function)


class Compiled:
    """The machine code of a routine, compiled once; it is released with this object."""

    def __init__(self, signature: str, function: Callable[..., int]) -> None:
        """Store what to compile, as a C function of this signature."""
        self._signature, self._function = signature, function
        self._code: Any = None

    @property
    def address(self) -> int:
        """Address of its machine code, which is compiled or read from disk if necessary."""
        return uninterrupted(self._address)

    def _address(self) -> int:
        with _one_thread:
            if self._code is None:
                options = {"nopython": True, "_nrt": False} | numerics(self._function)
                with _cached(self._function) as folder:
                    signature = signature_of(self._signature)
                    self._code = c_function(signature, self._function, options, folder)
            address: int = self._code.address
            return address


_one_thread = threading.RLock()

# The state of Numba and LLVM belongs to the whole process: a forked child could not continue a compilation.
finish_first(global_compiler_lock)
finish_first(_one_thread)


@contextmanager
def _cached(function: Callable[..., Any]) -> Iterator[Path | None]:
    """Let Numba store the functions decorated here in our folder; it reads its settings when it creates a function's cache.

    Yields the folder for the state of the sources that the function is made of, or None if there is none.
    """
    folder = None if _CACHE is None else _CACHE / module_digest(function.__module__)
    settings = vars(config)
    ours = {"CACHE_DIR": str(folder or ""), "CACHE_LOCATOR_CLASSES": ""}
    before = {name: settings.get(name, "") for name in ours}
    settings.update(ours)
    try:
        yield folder
    finally:
        settings.update(before)


_FIXED: dict[str, Any] = {"_nrt": True, "forceinline": False}
"""Options that a function would otherwise inherit from the first kernel that calls it."""

SHIPPED: dict[str, Any] = {}
"""Further options in a build, see `machine_code.never_run`."""

JITCodeLibrary: Any = codegen.JITCodeLibrary  # Untyped in Numba itself.
_Compiler: Any = numba_compiler.Compiler


class _Library(JITCodeLibrary):  # type: ignore[misc]
    """LLVM code of a function."""

    def _optimize_functions(self, module: Any) -> None:
        """Simplify every function, as Numba does, but make the passes once and leave declarations out."""
        module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager()
        for function in module.functions:
            if not function.is_declaration:
                passes.run(function, builder)


class _Part(_Library):
    """LLVM code of a part, ready to be inlined; the kernel that contains it is optimised as a whole, once.

    Numba would run all LLVM passes on every part, again on all its callers, and so on up to the kernel. Only functions
    that are always inlined are parts. Numba also makes code of a library for this process, which would otherwise be
    called unoptimised.
    """

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager(
            loop_vectorize=False, slp_vectorize=False, opt=0, cost="cheap"
        )
        passes.run(self._final_module, builder)


EFFORT = 2
"""LLVM's level of optimisation for whole kernels and for their machine code. Level 3, Numba's default, took a tenth longer,
gave the same bits and made no kind of call faster (`benchmarks.since`)."""


class _Whole(_Library):
    """LLVM code of a kernel.

    Numba would optimise it twice and remove pairs of reference counts in between. Kernels hardly count references.
    """

    vectorizes = False

    def _optimize_final_module(self) -> None:
        # NUMBA_OPT is 0 if the kernel is optimised later, for a machine with another layout of memory.
        effort = min(EFFORT, int(vars(config)["OPT"]))
        passes, builder = self._codegen._module_pass_manager(loop_vectorize=self.vectorizes, opt=effort)
        passes.run(self._final_module, builder)


class _Vectorized(_Whole):
    """LLVM code of a kernel of `VECTORIZED`."""

    vectorizes = True


def _compiler_into(kind: type[_Library]) -> type[Any]:
    """Numba's compiler, with our type of library."""

    class Compiler(_Compiler):  # type: ignore[misc]
        def define_pipelines(self) -> Any:
            self.state.library = kind(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
            self.state.library.enable_object_caching()
            return super().define_pipelines()

    return Compiler


_COMPILERS = {kind: _compiler_into(kind) for kind in (_Part, _Whole, _Vectorized)}


def _compiler_of(function: Callable[..., Any]) -> type[Any]:
    """The compiler for a kernel that is no part, by its module."""
    return _COMPILERS[_Vectorized if f"{function.__module__}.".startswith(VECTORIZED) else _Whole]


def part(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """Compile a function that is always inlined."""
    return compiled(function, pipeline_class=_COMPILERS[_Part], **options)


def compiled(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """Compile a function when it is first called."""
    options = {"pipeline_class": _compiler_of(function)} | _FIXED | SHIPPED | numerics(function) | options
    made = _njit(nogil=True, no_cfunc_wrapper=True, **options)(function)
    with _cached(function) as folder:
        if folder is not None:
            keep_code(made, function, folder)
    _ignore_literals(made)
    _compile_uninterrupted(made)
    return cast("Callable[P, R]", made)


def exposed(function: Callable[P, R]) -> Callable[P, R]:
    """See `jit.exposed`."""
    hidden: Any = function

    def call(*given: Any) -> Any:
        return hidden(*given)

    return cast("Callable[P, R]", _njit(call))


def view_of(element: str) -> Any:
    """A kernel from an address and a shape to a view of such numbers, see `entry.Leaf`.

    Unlike `numba.carray` it needs no reference counts: nothing in the view says who owns the memory.
    """
    dtype = _ELEMENTS[element]

    @intrinsic
    def view(typing_context: Any, address: Any, shape: Any) -> Any:
        result = _types.Array(dtype, len(shape), "C")

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            lengths = [builder.extract_value(args[1], i) for i in range(result.ndim)]
            return array_at(context, builder, result, args[0], lengths)

        return result(_types.int64, shape), generate

    return view


def array_at(context: Any, builder: Any, kind: Any, address: Any, shape: list[Any]) -> Any:
    """LLVM value of a contiguous array that owns nothing, at an address."""
    model = context.data_model_manager[kind]
    data = builder.inttoptr(address, model.get_value_type().elements[model.get_field_position("data")])
    return contiguous(model, builder, data, shape)


def contiguous(model: Any, builder: Any, data: Any, shape: list[Any]) -> Any:
    """LLVM value of a contiguous array that owns nothing."""
    place = model.get_field_position
    kinds, size = list(model.get_value_type().elements), as_dtype(model.fe_type.dtype).itemsize
    strides = [_WORD(ir.Undefined)] * (len(shape) - 1) + [_WORD(size)]
    known = [ir.Constant(kind, ir.Undefined) for kind in kinds]
    for owner in ("meminfo", "parent"):
        known[place(owner)] = ir.Constant(kinds[place(owner)], None)
    known[place("itemsize")] = _WORD(size)
    known[place("strides")] = ir.Constant(kinds[place("strides")], strides)
    value, step = ir.Constant(model.get_value_type(), known), _WORD(size)
    value = builder.insert_value(value, data, place("data"))
    for i in reversed(range(len(shape))):
        value = builder.insert_value(value, shape[i], [place("shape"), i])
        if i < len(shape) - 1:
            value = builder.insert_value(value, step, [place("strides"), i])
        if i > 0:
            step = builder.mul(step, shape[i])
    count = shape[0]
    for length in shape[1:]:
        count = builder.mul(count, length)
    return builder.insert_value(value, count, place("nitems"))


@intrinsic
def call_routine(typing_context: Any, address: Any, arguments: Any) -> Any:
    """Call the `jit.Routine` at an address with a tuple of arguments; return the integer it returns.

    The routine receives numbers: of an array its address and shape, of a named tuple those of its fields.
    """
    result = numba.types.int64

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        word = context.get_value_type(result)

        def numbers_of(kind: Any, value: Any) -> Iterator[Any]:
            if isinstance(kind, numba.types.BaseTuple):
                for i, each in enumerate(cast("Any", kind)):
                    yield from numbers_of(_unliteral(each), builder.extract_value(value, i))
            elif isinstance(kind, numba.types.Array):
                array = _make_array(kind)(context, builder, value)
                yield builder.ptrtoint(array.data, word)
                yield from (builder.extract_value(array.shape, i) for i in range(kind.ndim))
            else:
                yield builder.zext(value, word) if kind == numba.types.boolean else value

        given = list(numbers_of(arguments, values[1]))
        kind = ir.FunctionType(context.get_value_type(result), [value.type for value in given])
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), given)

    return result(numba.types.int64, arguments), generate


def _compile_uninterrupted(compiled: Any) -> None:
    compile_for_args = compiled._compile_for_args
    compiled._compile_for_args = lambda *args, **kws: uninterrupted(lambda: compile_for_args(*args, **kws))


def _ignore_literals(compiled: Any) -> None:
    """Compile a kernel once, instead of again for each constant argument."""
    template = compiled.get_call_template

    def general(args: Iterable[Any], kws: Mapping[str, Any]) -> Any:
        return template(
            tuple(_unliteral(arg) for arg in args), {name: _unliteral(kw) for name, kw in kws.items()}
        )

    compiled.get_call_template = general


class FirstRunNotice(event.Listener):
    """Report once, on stderr, that kernels are being compiled."""

    said = False

    def on_start(self, details: Any) -> None:
        """Handle the start of a compilation by Numba; only our functions that are not in the cache are reported."""
        function = getattr(details.data.get("dispatcher"), "py_func", None)
        if not self.said and getattr(function, "__module__", "").startswith("kinseek."):
            FirstRunNotice.said = True
            notice("compiling kernels, once per machine and version (up to some minutes) ...")

    def on_end(self, details: Any) -> None:
        """Do nothing."""


_register: Callable[[str, event.Listener], None] = event.register
_register("numba:compile", FirstRunNotice())
