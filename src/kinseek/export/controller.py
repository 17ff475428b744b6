"""An arm as C and machine code: its constants, forward kinematics, and divide and conquer in a fixed memory."""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.arm import Arm
from kinseek.deadline import Deadline
from kinseek.errors import InvalidExport, MissingExtra
from kinseek.goal import Goal
from kinseek.kernels.entry import ENTRIES
from kinseek.kernels.grid.descent import BEGINNING, TRIED, VISITED
from kinseek.kernels.grid.memory import MOST_LANES, TAKEN_SCRATCH, memory_size
from kinseek.kernels.grid.window import PART, split_depth
from kinseek.problem import Problem
from kinseek.robots.mechanism import no_axes
from kinseek.solvers import DivideAndConquer
from kinseek.solvers.traits import require

from .c_calls import c_declarations, c_definitions
from .targets import Cpu, Target, target_of

FORMS = {"object": "kernels.o", "assembly": "kernels.s", "llvm": "kernels.ll"}
"""How the kernels may be written, and the file that holds them."""

_C = Path(__file__).parent / "c"
_MARK = "/* Written by kinseek"
_PLACES, _HEAD, _ALIGNMENT = 4, 48, 32  # As c/runtime.c has them; a head is smaller where addresses are.
_CODE = (".text", ".rodata", ".srodata", ".data", ".sdata", ".ARM.ex", ".eh_frame", ".init_array")
_ENTRIES = [ENTRIES[name] for name in ("ks_write_poses", "ks_descend")]
_GENERATED = ("arm.h", "constants.h", "goal.h", "kernels.h", "kernels.c")


@dataclass(frozen=True)
class Parts:
    """What is to be written, and what it will take of the part."""

    files: dict[str, bytes]
    """Each by its name."""
    target: Target
    cpu: Cpu
    code: int
    """[bytes] of machine code and constants of the kernels."""
    constants: int
    """[bytes] of the arm's constants and the plan of the search."""
    ram: int
    """[bytes] of static memory; the stack comes on top of it."""
    lanes: int
    """Leaves that are tabulated at once."""
    most_lanes: int
    """Leaves that the search would tabulate at once without a limit on memory."""
    kernels: str
    """Name of the file that holds the kernels."""

    @property
    def flash(self) -> int:
        """[bytes] of kernels and constants; the little C around them and the C library come on top of it."""
        return self.code + self.constants

    @property
    def command(self) -> str:
        """What compiles and links the program, in the folder; bare metal also needs what starts the part."""
        words = [
            self.target.compiler,
            "-O2",
            self.cpu.options,
            "main.c kinseek.c kernels.c runtime.c",
            self.kernels,
        ]
        return " ".join(filter(None, [*words, "-lm -o solve"]))

    def __str__(self) -> str:
        """What it takes, in a few sentences."""
        said = [
            f"{self.target.triple}, {self.cpu.name}: flash {self.flash:,} bytes (kernels {self.code:,}, constants "
            f"{self.constants:,}; the C around them and the C library come on top), RAM {self.ram:,} bytes (the stack "
            f"comes on top)."
        ]
        if self.lanes < self.most_lanes:
            said.append(
                f"The memory holds {self.lanes:,} tabulated leaves and not {self.most_lanes:,}: slower, and of two nodes "
                "that are as good rounding may take the other."
            )
        return " ".join(said)

    def write(self, folder: str | Path) -> Path:
        """Write all files into a folder, which is made unless it is there.

        Raises:
            InvalidExport: There is no place for the folder, it holds files of these names that are not kinseek's, or
                it cannot be written.
        """
        place = checked_folder(folder)
        try:
            place.mkdir(exist_ok=True)
            for name in FORMS.values():
                (place / name).unlink(missing_ok=True)  # What an earlier export wrote in another form.
            for name, content in self.files.items():
                (place / name).write_bytes(content)
        except OSError as error:
            raise InvalidExport(f"cannot write into {str(folder)!r}: {error.strerror or error}") from error
        return place


def checked_folder(folder: str | Path) -> Path:
    """Look whether files may be written into a folder.

    Raises:
        InvalidExport: As `Parts.write`.
    """
    if not isinstance(folder, str | Path) or not str(folder):
        raise InvalidExport(f"folder must be a path, got {folder!r}")
    place = Path(folder)
    header, names = place / "kinseek.h", [*FORMS.values(), *_GENERATED, *(each.name for each in _C.iterdir())]
    try:
        exists, fits, around = place.exists(), place.is_dir(), place.parent.is_dir()
        ours = header.is_file() and header.read_text(encoding="utf-8", errors="replace").startswith(_MARK)
        foreign = [] if ours else [name for name in names if (place / name).exists()]
    except (OSError, ValueError) as error:
        raise InvalidExport(f"cannot look into {str(folder)!r}: {error}") from error
    if exists and not fits:
        raise InvalidExport(f"{str(folder)!r} is no folder")
    if not around:
        raise InvalidExport(f"there is no folder {str(place.parent)!r} to make {place.name!r} in")
    if foreign:
        raise InvalidExport(
            f"{str(folder)!r} holds {', '.join(sorted(foreign))}, which kinseek did not write; choose another folder"
        )
    return place


def to_c(
    arm: Arm,
    folder: str | Path,
    target: str = "x86-64",
    *,
    cpu: str | None = None,
    search: DivideAndConquer | None = None,
    goal: Goal | None = None,
    ram: int | None = None,
    flash: int | None = None,
    form: str = "object",
) -> Parts:
    """Write an arm as C and machine code into a folder; `prepare` and `Parts.write` in one.

    Args:
        arm: With axes and links.
        folder: Made unless it is there; the folder around it must be there.
        target: A name of `TARGETS`.
        cpu: A processor of the target; its first unless given.
        search: Divide and conquer with the dynamic tree; with its own defaults unless given.
        goal: One pose or position that the program solves; its kind and weights hold for all goals on the part. Unless
            given, a pose that the arm can reach.
        ram: [bytes] that static memory may take; the search tabulates fewer leaves where it must.
        flash: [bytes] that kernels and constants may take.
        form: ``"object"``, ``"assembly"`` or ``"llvm"``: how the kernels are written.

    Returns:
        What was written, and what it takes.

    Raises:
        InvalidExport: An unknown target, processor or form, an arm that is a function, a goal or search that the program
            does not know, more memory needed than there is, or a folder as in `Parts.write`.
        InvalidSolver: Parameters of the search that do not fit the arm.
        MissingExtra: Numba is not installed: it compiles the kernels.
    """
    checked_folder(folder)
    parts = prepare(arm, target, cpu=cpu, search=search, goal=goal, ram=ram, flash=flash, form=form)
    parts.write(folder)
    return parts


def prepare(
    arm: Arm,
    target: str = "x86-64",
    *,
    cpu: str | None = None,
    search: DivideAndConquer | None = None,
    goal: Goal | None = None,
    ram: int | None = None,
    flash: int | None = None,
    form: str = "object",
    notice: Callable[[str], object] = lambda words: None,
) -> Parts:
    """Compile an arm for a part, and say what it takes before anything is written.

    Args:
        arm: As in `to_c`, and so are all but the last.
        target: A name of `TARGETS`.
        cpu: A processor of the target.
        search: Divide and conquer.
        goal: What the program solves.
        ram: [bytes] that static memory may take.
        flash: [bytes] that kernels and constants may take.
        form: ``"object"``, ``"assembly"`` or ``"llvm"``.
        notice: Told, once everything is checked, that compiling begins.

    Raises:
        InvalidExport: As `to_c`, but for the folder.
        InvalidSolver: Parameters of the search that do not fit the arm.
        MissingExtra: Numba is not installed: it compiles the kernels.
    """
    chosen = target_of(target)
    part = chosen.cpu(cpu)
    if form not in FORMS:
        raise InvalidExport(f"form must be one of {', '.join(map(repr, FORMS))}, got {form!r}")
    for name, limit in (("ram", ram), ("flash", flash)):
        if limit is not None and (isinstance(limit, bool) or not isinstance(limit, int) or limit < 1):
            raise InvalidExport(f"{name} must be a whole number of bytes of at least 1, got {limit!r}")
    if arm.axes is None:
        why = "a controller is given the axes and links of an arm"
        raise InvalidExport(f"an arm that is a function cannot be exported: {no_axes(arm.mechanism, why)}")
    search = search or DivideAndConquer()
    problem = _problem(arm, search, goal)
    plan = search._plan(problem, Deadline())
    most_lanes, per_lane = _lanes(problem, plan), _numbers_a_lane()
    room = 8 * max(12, arm.dof)  # A pose without its last row, or a node of each joint.
    least = memory_size(*plan.sizes) - per_lane * MOST_LANES
    fixed = 8 * (least + 12 + len(BEGINNING)) + _PLACES * (_HEAD + room + _ALIGNMENT)
    lanes = most_lanes
    if ram is not None and fixed + 8 * per_lane * lanes > ram:
        lanes = (ram - fixed) // (8 * per_lane)
        if lanes < 1:
            raise InvalidExport(
                f"{arm.name!r} with {arm.dof} joints needs {fixed + 8 * per_lane:,} bytes of RAM at least for this search, "
                f"got {ram:,}. Fewer joints (with_locked), a smaller beam or breadth, or fewer divisions need less"
            )
    numbers = least + per_lane * lanes
    notice(f"compiling the kernels for {chosen.triple}, {part.name} (some twenty seconds) ...")
    told, kernels = _compiled(chosen, part, lanes, plan.sizes, FORMS[form])
    if told["memory"] != numbers:
        raise RuntimeError(f"the kernels need {told['memory']} numbers of memory, expected {numbers}")
    texts, constants = _texts(arm, search, problem, plan, numbers, room)
    code = sum(size for name, size in told["sections"] if name.startswith(_CODE))
    parts = Parts(
        files={},
        target=chosen,
        cpu=part,
        code=code,
        constants=constants,
        ram=fixed + 8 * per_lane * lanes,
        lanes=lanes,
        most_lanes=most_lanes,
        kernels=FORMS[form],
    )
    if flash is not None and parts.flash > flash:
        raise InvalidExport(f"{arm.name!r} needs more flash than {flash:,} bytes: {parts}")
    marked = {
        name: f"{_MARK} {kinseek.__version__}: {arm.name}, {parts}\n   {parts.command} */\n{text}".encode()
        for name, text in texts.items()
    }
    parts.files.update(marked | {FORMS[form]: kernels})
    return parts


def _problem(arm: Arm, search: DivideAndConquer, goal: Goal | None) -> Problem:
    """The goal as a problem, where the program knows goals of its kind, and the search.

    Raises:
        InvalidExport: It does not.
    """
    if search.tree != "dynamic":
        raise InvalidExport(
            f"a controller makes nodes when they are needed: tree must be 'dynamic', got {search.tree!r}"
        )
    if search.ties != "rounding":
        raise InvalidExport(f"ties must be 'rounding' in an exported search, got {search.ties!r}")
    asked = Goal.pose(arm.fk(arm.sample(1)[0])) if goal is None else goal
    problem = Problem(arm.mechanism, asked)
    require(search, problem)
    if asked.shape:
        raise InvalidExport(f"the program solves one goal, got a batch of shape {asked.shape}")
    if asked.tip is not None or asked.base is not None:
        raise InvalidExport(
            "a goal for a controller is a pose or position of the tip in the arm's base: no direction, tool= or base=; "
            "Arm.with_tool moves the tip"
        )
    return problem


def _lanes(problem: Problem, plan: Any) -> int:
    """Leaves that the search tabulates at once: those of the suffix that it chooses for a full window of each pass."""
    passes, size = plan.passes, plan.grid.size
    windows = [passes.counts]
    windows += [
        np.minimum(passes.later, (size - 1) // spacing + 1) for spacing in passes.spacings[1:].tolist()
    ]
    most = 1
    for counts in windows:
        s = split_depth(problem.arrays, counts.astype(np.int64))
        most = max(most, math.prod(counts[s:].tolist()))
    return most


def _numbers_a_lane() -> int:
    """Numbers of a search's memory that each tabulated leaf takes."""
    taken = 0
    for leaf in TAKEN_SCRATCH.fields.values():
        lengths = [each.plus for each in getattr(leaf, "shape", ()) if not each.name]
        if MOST_LANES in lengths:
            taken += math.prod(lengths) // MOST_LANES
    return taken


def _compiled(
    target: Target, cpu: Cpu, lanes: int, sizes: Iterable[int], name: str
) -> tuple[dict[str, Any], bytes]:
    """Have the kernels compiled in a process of their own: what it tells of them, and the file of a name.

    Raises:
        MissingExtra: Numba is not installed.
        InvalidExport: The kernels could not be compiled.
    """
    if find_spec("numba") is None:
        raise MissingExtra("compiling the kernels for another processor", "jit")
    optimised = target.numba and platform.machine().lower() in ("x86_64", "amd64")
    job = {
        "lanes": lanes,
        "sizes": [int(each) for each in sizes],
        "modules": sorted({each.function.__module__ for each in _ENTRIES}),
        "entries": [each.name for each in _ENTRIES],
        "triple": target.triple,
        "cpu": cpu.name,
        "features": cpu.features,
        "relocation": target.relocation,
        "abi": target.abi,
        "optimised": optimised,
    }
    with tempfile.TemporaryDirectory(prefix="kinseek-export-") as place:
        work = Path(place)
        (work / "job.json").write_text(json.dumps(job), encoding="utf-8")
        package = str(Path(kinseek.__file__).parent.parent)
        environment = {
            each: value for each, value in os.environ.items() if not each.startswith(("NUMBA_", "KINSEEK_"))
        }
        environment |= {
            "KINSEEK_JIT": "1",
            "NUMBA_CPU_NAME": cpu.name if optimised else "generic",
            "NUMBA_CPU_FEATURES": "",
            "NUMBA_CACHE_DIR": str(work),
            "PYTHONPATH": os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH", "")])),
        }
        if not optimised:
            environment["NUMBA_OPT"] = "0"
        command = [
            sys.executable,
            "-P",
            "-W",
            "ignore",
            str(Path(__file__).with_name("emit.py")),
            str(work / "job.json"),
        ]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
            raise InvalidExport(f"the kernels could not be compiled for {target.triple}, {cpu.name}: {last}")
        told: dict[str, Any] = json.loads((work / "told.json").read_text(encoding="utf-8"))
        return told, (work / name).read_bytes()


def _texts(
    arm: Arm, search: DivideAndConquer, problem: Problem, plan: Any, numbers: int, room: int
) -> tuple[dict[str, str], int]:
    """All files in C, by name, and the bytes of the constants that the part holds."""
    chain, goal, passes, grid = problem.arrays, problem.goal.arrays, plan.passes, plan.grid
    arrays: dict[str, NDArray[Any]] = {f"chain_{name}": each for name, each in chain._asdict().items()}
    arrays |= {name: getattr(grid, name) for name in ("step", "wraps")}
    arrays |= {name: getattr(passes, name) for name in ("spacings", "later", "first", "counts")}
    arrays["axis_weights"] = goal.axis_weights
    arm_h = _defined(
        "KINSEEK_ARM_H",
        {
            "NAME": json.dumps(arm.name),
            "DOF": arm.dof,
            "JOINTS": len(chain.leader),
            "MEMORY": f"{numbers} /* Numbers of 8 bytes, of which a search makes use. */",
            "ROOM": f"{room} /* [bytes] of each place for working memory. */",
            "AT": len(BEGINNING),
            "BEGINNING": f"{{{', '.join(map(str, BEGINNING))}}}",
            "TRIED": TRIED,
            "VISITED": VISITED,
            "PART": f"{PART} /* Leaves of a part of the search, where nobody asks for shorter ones. */",
            "POSITION_WEIGHT": _number(float(goal.position_weight)),
        },
    )
    fields = {name: f"chain_{name}" for name in chain._fields}
    constants = [_array(name, values) for name, values in arrays.items()]
    constants += [
        _structure("KinseekChainArrays", "chain", fields),
        _structure(
            "KinseekGrid",
            "grid",
            {
                "lower": "chain_lower",
                "upper": "chain_upper",
                "step": "step",
                "wraps": "wraps",
                "size": str(grid.size),
                "table": "chain_lower",
                "table_length": "0 /* No node is made beforehand. */",
            },
        ),
        _structure(
            "KinseekPasses",
            "passes",
            {
                "spacings": "spacings",
                "spacings_length": str(len(passes.spacings)),
                "later": "later",
                "first": "first",
                "first_length": str(passes.first.shape[1]),
                "counts": "counts",
                "clips": str(int(passes.clips)),
                "stop_below": _number(passes.stop_below),
                "tie": _number(passes.tie),
                "beam": str(passes.beam),
                "children": str(passes.children),
            },
        ),
    ]
    answer = search.solve(problem)
    goal_h = [
        _array("goal_pose", problem.goal.target),
        "/* What kinseek answers. */",
        _array("expected_q", np.asarray(answer.q)),
        _array("expected_pose", arm.fk(answer.q)),
        f"#define EXPECTED_LEAVES {int(answer.evaluations)}",
        "static const char *const joint_names[] = {"
        + ", ".join(json.dumps(name) for name in arm.joint_names)
        + "};",
    ]
    texts = {each.name: each.read_text(encoding="utf-8") for each in sorted(_C.iterdir())}
    texts |= {
        "arm.h": arm_h,
        "constants.h": _guarded("KINSEEK_CONSTANTS_H", ['#include "kernels.h"', *constants]),
        "goal.h": _guarded("KINSEEK_GOAL_H", ["#include <stdint.h>", *goal_h]),
        "kernels.h": _guarded(
            "KINSEEK_KERNELS_H", ["#include <stdbool.h>\n#include <stdint.h>", c_declarations(_ENTRIES)]
        ),
        "kernels.c": f"{_KERNELS_C}\n{c_definitions(_ENTRIES)}\n",
    }
    return texts, sum(each.nbytes for each in arrays.values())


_KERNELS_C = """/* Each function writes what it is given into a table of 64-bit numbers, which the compiled kernels read. */
#include "kernels.h"

#include <string.h>

static inline int64_t kinseek_bits(double number) {
    int64_t bits;
    memcpy(&bits, &number, sizeof bits);
    return bits;
}
"""

_ELEMENTS = {"f": "double", "i": "int64_t", "b": "bool"}


def _array(name: str, values: NDArray[Any]) -> str:
    """An array of constants in C, every number to the last bit."""
    flat = np.ravel(values)
    write = _number if flat.dtype.kind == "f" else lambda each: str(int(each))
    words = ", ".join(write(each) for each in flat.tolist())
    shape = f"  /* {values.shape} */" if values.ndim > 1 else ""
    return f"static const {_ELEMENTS[flat.dtype.kind]} {name}[] = {{{words}}};{shape}"


def _number(value: float) -> str:
    if not math.isfinite(value):
        raise InvalidExport(f"a constant of the arm or search is {value}")
    return value.hex()


def _structure(kind: str, name: str, fields: dict[str, str]) -> str:
    lines = [f"    .{field} = {value}," for field, value in fields.items()]
    return "\n".join([f"static const {kind} {name} = {{", *lines, "};"])


def _defined(guard: str, values: dict[str, object]) -> str:
    return _guarded(guard, [f"#define KINSEEK_{name} {value}" for name, value in values.items()])


def _guarded(guard: str, lines: list[str]) -> str:
    return "\n".join([f"#ifndef {guard}", f"#define {guard}", "", *lines, "", "#endif", ""])
