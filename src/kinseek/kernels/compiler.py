"""The one place that asks Numba for anything: its options, its types, and the guard against stale machine code.

Numba's disk cache looks only at the file that holds the compiled function: a kernel whose imported callee
changed in another file would run on with the old machine code. So the code of each module's kernels lives in a
folder named after a digest of every source file that they are made of (`sources.module_digest`): change any of
them, reinstall in place, and the folder is a new one. Files without kernels may change freely.

Floating point: results hold no NaN (the shell refuses them), the sign of zero carries no meaning, and a
product may be fused with a sum. Sums are never reordered. Where a bound or a verdict is computed a NaN is not
assumed away: every comparison there is written so that it says nothing (see `VERDICTS`).
"""

from __future__ import annotations

from . import away  # noqa: F401  # Before Numba is imported for the first time.

# isort: split
import os
import sys
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

from kinseek.forks import finish_first
from kinseek.interrupts import uninterrupted
from kinseek.private import private_folder, user_cache

from .kept_code import c_function, keep_code, report_unwritten
from .sources import module_digest

P = ParamSpec("P")
R = TypeVar("R")


def _cache_folder() -> Path | None:
    """Return a folder for this very Numba that this user alone can write to, or None where there is none."""
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
        except (OSError, RuntimeError) as error:  # A RuntimeError: there is no home.
            refused.append(error)
    report_unwritten(candidates[0][0], refused[0])
    return None


def _is_working_folder(folder: str) -> bool:
    """Python takes it for temporary files where no other folder takes any. It may have come from anybody."""
    try:
        return os.path.samefile(folder, os.curdir)
    except OSError:  # One of them is gone.
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
"""Modules of kernels that compute a bound or a verdict, or what one is made of: no NaN is assumed away in them."""


def numerics(function: Callable[..., Any]) -> dict[str, Any]:
    """Options of floating point for a function, by the module that it stands in."""
    if f"{function.__module__}.".startswith(VERDICTS):
        return NUMERICS | {"fastmath": {"nsz", "contract"}}
    return NUMERICS


_njit: Any = numba.njit  # Its stubs leave out `no_cfunc_wrapper`, which saves compile time.
signature_of: Callable[[str], Any] = sigutils.normalize_signature
_unliteral: Callable[[Any], Any] = unliteral


def bare(function: Callable[..., Any], exact: bool) -> Any:
    """A kernel as a library takes it: without what lets Python call it, and not kept on disk."""
    options = numerics(function) | ({"fastmath": False} if exact else {})
    return _njit(nogil=True, no_cfunc_wrapper=True, no_cpython_wrapper=True, **options)(function)


class Compiled:
    """The machine code of a routine, made once: with this goes the code."""

    def __init__(self, signature: str, function: Callable[..., int]) -> None:
        """Remember what to compile, as a C function of this signature."""
        self._signature, self._function = signature, function
        self._code: Any = None

    @property
    def address(self) -> int:
        """Where its machine code stands, compiled by now or read from disk."""
        return uninterrupted(self._address)

    def _address(self) -> int:
        with _one_thread:
            if self._code is None:
                options = {"nopython": True} | numerics(self._function)
                with _cached(self._function) as folder:
                    signature = signature_of(self._signature)
                    self._code = c_function(signature, self._function, options, folder)
            address: int = self._code.address
            return address


_one_thread = threading.RLock()

# What Numba and LLVM keep is of the whole process: a child could go on with nothing that was being compiled.
finish_first(global_compiler_lock)
finish_first(_one_thread)


@contextmanager
def _cached(function: Callable[..., Any]) -> Iterator[Path | None]:
    """Let Numba keep what is decorated here in our folder: it reads its settings when it builds a function's cache.

    Gives the folder, for the state of the sources that the function is made of; None where there is none.
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
"""Options that a function would otherwise take from whichever kernel is the first of all to call it."""

_SHIPPED: dict[str, Any] = {}
"""Further options where everything that is compiled is written down: see `never_run`."""

_JITCodeLibrary: Any = codegen.JITCodeLibrary  # Untyped in Numba itself, as what follows.
_Compiler: Any = numba_compiler.Compiler


class _Simplified(_JITCodeLibrary):  # type: ignore[misc]
    """LLVM's code of a part: ready to be inlined. The kernel that it becomes part of is optimised as a whole, once.

    Numba would run all passes of LLVM on every part, again on all that calls it, and so on up to the kernel. Only what is
    always inlined is a part: the code for this process that Numba makes of a library too would else be called, unoptimised.
    """

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager(
            loop_vectorize=False, slp_vectorize=False, opt=0, cost="cheap"
        )
        passes.run(self._final_module, builder)


class _PartCompiler(_Compiler):  # type: ignore[misc]
    """Compiles into `_Simplified`."""

    def define_pipelines(self) -> Any:
        """Numba's own, with our kind of library."""
        self.state.library = _Simplified(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


def part(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """Let Numba compile a function that is always inlined."""
    return compiled(function, pipeline_class=_PartCompiler, **options)


def compiled(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """Let Numba compile a function when it is first called."""
    options = _FIXED | _SHIPPED | numerics(function) | options
    made = _njit(nogil=True, no_cfunc_wrapper=True, **options)(function)
    with _cached(function) as folder:
        if folder is not None:
            keep_code(made, function, folder)
    _ignore_literals(made)
    _compile_undisturbed(made)
    return cast("Callable[P, R]", made)


def exposed(function: Callable[P, R]) -> Callable[P, R]:
    """See `jit.exposed`."""
    hidden: Any = function

    def call(*given: Any) -> Any:
        return hidden(*given)

    return cast("Callable[P, R]", _njit(call))


def pointer_to(element: str) -> Any:
    """A kernel that turns an address into a pointer to such numbers, see `entry.Leaf`."""
    types: Any = numba.types  # Untyped in Numba itself.
    of = {"f": types.float64, "i": types.int64, "b": types.boolean}[element]

    @intrinsic
    def pointer(typing_context: Any, address: Any) -> Any:
        result = types.CPointer(of)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], context.get_value_type(result))

        return result(types.int64), generate

    return pointer


@intrinsic
def call_routine(typing_context: Any, address: Any, arguments: Any) -> Any:
    """Call the `jit.Routine` at an address with a tuple of integers and floats; return the integer it returns."""
    result = numba.types.int64

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        given = [builder.extract_value(values[1], i) for i in range(len(arguments))]
        kind = ir.FunctionType(context.get_value_type(result), [value.type for value in given])
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), given)

    return result(numba.types.int64, arguments), generate


carray: Any = vars(numba)["carray"]


def _compile_undisturbed(compiled: Any) -> None:
    compile_for_args = compiled._compile_for_args
    compiled._compile_for_args = lambda *args, **kws: uninterrupted(lambda: compile_for_args(*args, **kws))


def _ignore_literals(compiled: Any) -> None:
    """Let a kernel be compiled once, not anew for each constant that another kernel calls it with."""
    template = compiled.get_call_template

    def general(args: Iterable[Any], kws: Mapping[str, Any]) -> Any:
        return template(
            tuple(_unliteral(arg) for arg in args), {name: _unliteral(kw) for name, kw in kws.items()}
        )

    compiled.get_call_template = general


class _FirstRunNotice(event.Listener):
    """Say once, on stderr, that kernels are being compiled."""

    said = False

    def on_start(self, details: Any) -> None:
        """Numba is about to compile: ours, and not found in the cache."""
        function = getattr(details.data.get("dispatcher"), "py_func", None)
        if not self.said and getattr(function, "__module__", "").startswith("kinseek."):
            _FirstRunNotice.said = True
            print(
                "kinseek: compiling kernels, once per machine and version (some twenty seconds) ...",
                file=sys.stderr,
            )

    def on_end(self, details: Any) -> None:
        """Nothing to say."""


_register: Callable[[str, event.Listener], None] = event.register
_register("numba:compile", _FirstRunNotice())


def never_run() -> None:
    """Have Numba compile without machine code for this process, where what it makes is written down and never called here.

    Call it before kernels are imported. Numba would make machine code of every kernel and of all that each is made of, and
    what lets Python call them: more than a third of the time that a library takes. What processes hand each other through
    the cache is then LLVM's own language.
    """
    library, generator = _JITCodeLibrary, cast("Any", codegen.JITCPUCodegen)
    # Each would ask LLVM for an address, so that machine code is made.
    library.get_pointer_to_function = lambda self, name: self._ensure_finalized() or 0
    generator.set_env = lambda self, name, environment: None
    library._finalize_specific = lambda self: None
    library.serialize_using_object_code = library.serialize_using_bitcode
    _SHIPPED["no_cpython_wrapper"] = True
    _FirstRunNotice.said = True  # It would not be true here.
