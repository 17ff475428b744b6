"""Export of an arm as C and machine code: constants, forward kinematics, and a search or a tracker in fixed memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import kinseek
from kinseek.arm import Arm
from kinseek.errors import InvalidExport
from kinseek.goal import Goal
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.kernels.entry import ENTRIES
from kinseek.paths.tracker import Tracker
from kinseek.problem import Problem
from kinseek.solvers.atlas.solver import Atlas
from kinseek.solvers.divide_and_conquer import DivideAndConquer
from kinseek.support.validation import as_integer

from .atlas import atlas_design
from .c_calls import c_declarations, c_definitions
from .c_text import array, defined, guarded, number, string
from .compiling import compiled
from .design import C, Design, chain_constants, exported_axes
from .folder import Owned, own_folder, write_files
from .grid import grid_design
from .targets import Cpu, Target, target_of
from .tracker import tracker_design, tracker_goal, tracking

FORMS = {"object": "kernels.o", "assembly": "kernels.s", "llvm": "kernels.ll"}
"""Forms of the kernels, and the file that contains them."""

_MARK = "/* Written by kinseek"
_CODE = (
    ".text",
    ".rodata",
    ".srodata",
    ".data",
    ".sdata",
    ".ARM.ex",
    ".eh_frame",
    ".init_array",
    "CODE",
    "DATA",
)
_FK = ENTRIES["ks_write_poses"]
_GENERATED = ("arm.h", "constants.h", "goal.h", "calls.h", "calls.c", "plan.h", "rows.h", "atlas.bin")


@dataclass(frozen=True)
class Parts:
    """The files to write, and the memory that they need on the controller."""

    files: dict[str, bytes]
    """Contents of each file by name."""
    target: Target
    cpu: Cpu
    code: int
    """Size of machine code and constants of the kernels [bytes]."""
    constants: int
    """Size of the arm's constants and the plan of the search [bytes]."""
    ram: int
    """Size of static memory, without the stack [bytes]."""
    lanes: int
    """Number of leaves that are tabulated at once."""
    most_lanes: int
    """Number of leaves that the search would tabulate at once without a memory limit."""
    kernels: str
    """Name of the file with the kernels."""
    source: str = "search.c"
    """Name of the C file with the search or the tracker."""
    externals: tuple[str, ...] = ()
    """External functions that the kernels call; a compiler may add its own for instructions that the controller does not
    have.
    """

    @property
    def flash(self) -> int:
        """Size of kernels and constants, without the small C code around them and the C library [bytes]."""
        return self.code + self.constants

    @property
    def command(self) -> str:
        """Command that compiles and links the program, in the folder; bare metal also needs startup code."""
        llvm = self.kernels == FORMS["llvm"]  # GCC does not read it.
        words = [
            f"clang --target={self.target.triple}" if llvm else self.target.compiler,
            "-O2",
            self.cpu.options,
            f"main.c kinseek.c {self.source} calls.c runtime.c",
            self.kernels,
        ]
        return " ".join(filter(None, [*words, "-lm -o solve"]))

    def __str__(self) -> str:
        """A summary of the memory in a few sentences."""
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

    def write(self, folder: str | Path, named: bool = True) -> Path:
        """Write all files into a folder, and make the folder if it does not exist.

        Args:
            folder: The folder.
            named: Has the user named it? Otherwise it must not be a link, and must belong to this user.

        Raises:
            InvalidExport: The folder cannot be made or written, or it has files of these names that are not kinseek's.
        """
        write_files(folder, _owned(), self.files, named)
        return Path(folder)


def checked_folder(folder: str | Path) -> Path:
    """Check that files may be written into a folder.

    Raises:
        InvalidExport: As `Parts.write`.
    """
    own_folder(folder, _owned())
    return Path(folder)


def _owned() -> Owned:
    """Return which files of a folder are those of an export."""
    sources = (each.name for each in C.rglob("*.[ch]"))
    return Owned(frozenset((*FORMS.values(), *_GENERATED, *sources)), "kinseek.h", _MARK)


def to_c(
    arm: Arm,
    folder: str | Path,
    target: str = "x86-64",
    *,
    cpu: str | None = None,
    search: DivideAndConquer | Atlas | Tracker | None = None,
    goal: Goal | None = None,
    ram: int | None = None,
    flash: int | None = None,
    form: str = "object",
) -> Parts:
    """Write an arm as C and machine code into a folder; this combines `prepare` and `Parts.write`.

    Args:
        arm: An arm with axes and links.
        folder: Output folder; it is made if it does not exist, but its parent must exist.
        target: A name of `TARGETS`.
        cpu: A processor of the target; by default its first.
        search: Divide and conquer with the dynamic tree, with its default parameters unless given; the atlas, for
            controllers with some 4 MB of flash; or a tracker, ``arm.track(q0, period, ...)``, instead of a search. The
            program then has its limits and tolerances; its scene, `prefer` and `recover` have no counterpart in C.
        goal: One pose or position that the program solves; its kind and weights apply to all goals on the controller. By
            default a pose that the arm can reach. Not for a tracker.
        ram: Limit of static memory [bytes]; the search tabulates fewer leaves if necessary.
        flash: Limit of kernels and constants [bytes].
        form: Form of the kernels: ``"object"``, ``"assembly"`` or ``"llvm"``.

    Returns:
        The files written, and the memory that they need.

    Raises:
        InvalidExport: An unknown target, processor or form, an arm with black-box kinematics, an unsupported goal or search,
            too little memory, or a folder as in `Parts.write`.
        InvalidSolver: Parameters of the search that do not fit the arm.
        MissingExtra: Numba, which compiles the kernels, is not installed.
    """
    # Before the kernels are compiled, which takes some twenty seconds.
    checked_folder(folder)
    parts = prepare(arm, target, cpu=cpu, search=search, goal=goal, ram=ram, flash=flash, form=form)
    parts.write(folder)
    return parts


def prepare(
    arm: Arm,
    target: str = "x86-64",
    *,
    cpu: str | None = None,
    search: DivideAndConquer | Atlas | Tracker | None = None,
    goal: Goal | None = None,
    ram: int | None = None,
    flash: int | None = None,
    form: str = "object",
    notice: Callable[[str], object] = lambda words: None,
) -> Parts:
    """Compile an arm for a controller, and report the memory that it needs before anything is written.

    Args:
        arm: As in `to_c`, as are all arguments but the last.
        target: A name of `TARGETS`.
        cpu: A processor of the target.
        search: Divide and conquer, the atlas, or a tracker.
        goal: The goal that the program solves.
        ram: Limit of static memory [bytes].
        flash: Limit of kernels and constants [bytes].
        form: ``"object"``, ``"assembly"`` or ``"llvm"``.
        notice: Called with a message when all checks have passed and compilation begins.

    Raises:
        InvalidExport: As `to_c`, except for the folder.
        InvalidSolver: Parameters of the search that do not fit the arm.
        MissingExtra: Numba, which compiles the kernels, is not installed.
    """
    chosen = target_of(target)
    part = chosen.cpu(cpu)
    if form not in FORMS:
        raise InvalidExport(f"form must be one of {', '.join(map(repr, FORMS))}, got {form!r}")
    for name, limit in (("ram", ram), ("flash", flash)):
        if limit is not None:
            as_integer(f"{name} [bytes]", limit, 1, error=InvalidExport)
    exported_axes(arm, "a controller")
    search = DivideAndConquer() if search is None else search
    if isinstance(search, Tracker) and goal is not None:
        raise InvalidExport("the goal of a tracker is that of Arm.track, got another one with goal=")
    problem = _problem(arm, search, tracker_goal(search) if isinstance(search, Tracker) else goal)
    if isinstance(search, Tracker):
        design = tracker_design(search, problem, ram)
    elif isinstance(search, Atlas):
        design = atlas_design(search, problem, ram)
    else:
        design = grid_design(search, problem, ram)
    notice(f"compiling the kernels for {chosen.triple}, {part.name} (some twenty seconds) ...")
    report, kernels = compiled(
        chosen, part, (_FK, *design.entries), design.routines, FORMS[form], design.lanes, design.sizes
    )
    if design.memory not in (None, report["memory"]):
        raise RuntimeError(f"the kernels need {report['memory']} numbers of memory, expected {design.memory}")
    example = tracking(arm, search) if isinstance(search, Tracker) else _solving(arm, search, problem)
    texts, constants = _texts(arm, problem, design, example)
    parts = Parts(
        files={},
        target=chosen,
        cpu=part,
        code=sum(size for name, size in report["sections"] if name.startswith(_CODE)),
        constants=constants,
        ram=design.ram,
        lanes=design.lanes,
        most_lanes=design.most_lanes,
        kernels=FORMS[form],
        source=design.source,
        externals=tuple(report["externals"]),
    )
    if flash is not None and parts.flash > flash:
        raise InvalidExport(f"{arm.name!r} needs more flash than {flash:,} bytes: {parts}")
    for name, text in texts.items():
        parts.files[name] = (
            f"{_MARK} {kinseek.__version__}: {string(arm.name)}, {parts}\n   {parts.command} */\n{text}".encode()
        )
    parts.files.update({**design.data, FORMS[form]: kernels})
    return parts


def _problem(arm: Arm, search: DivideAndConquer | Atlas | Tracker, goal: Goal | None) -> Problem:
    """Return the goal as a problem, if the program supports the search and goals of its kind.

    Raises:
        InvalidExport: It does not.
    """
    if not isinstance(search, DivideAndConquer | Atlas | Tracker):
        raise InvalidExport(
            f"search must be a DivideAndConquer, an Atlas or a tracker from Arm.track, got {search!r}"
        )
    goal_or_default = Goal.pose(arm.fk(arm.sample(1)[0])) if goal is None else goal
    problem = Problem(arm.mechanism, goal_or_default)
    if goal_or_default.shape:
        raise InvalidExport(f"the program solves one goal, got a batch of shape {goal_or_default.shape}")
    if goal_or_default.form.ranges or goal_or_default.tip is not None or goal_or_default.base is not None:
        raise InvalidExport(
            "a goal for a controller is a pose or position of the tip in the arm's base: no free axes, direction, tool= or "
            "base=; Arm.with_tool moves the tip"
        )
    return problem


def _solving(arm: Arm, search: DivideAndConquer | Atlas, problem: Problem) -> list[str]:
    """Return the goal that the program solves, and the result of kinseek, in C."""
    expected = search.solve(problem)
    return [
        array("goal_pose", problem.goal.target),
        "/* The result of kinseek on the exporting machine. */",
        array("expected_q", np.asarray(expected.q)),
        array("expected_pose", arm.fk(expected.q)),
        f"#define EXPECTED_EVALUATIONS {int(expected.evaluations)}",
    ]


def _texts(arm: Arm, problem: Problem, design: Design, example: list[str]) -> tuple[dict[str, str], int]:
    """Return all C files by name, and the size of the constants on the controller [bytes].

    Args:
        arm: The arm.
        problem: The goal.
        design: What the search or the tracker adds.
        example: What the program does, and the result of kinseek, in C.
    """
    constants, taken = chain_constants(design.chain, design.axis_weights)
    numbers = {
        "NAME": string(arm.name),
        "DOF": arm.dof,
        "JOINTS": len(design.chain.leader),
        "ROOM": f"{design.room} /* [bytes] of working memory. */",
        "POSITION_WEIGHT": number(float(problem.goal.arrays.position_weight)),
        "LARGEST": f"{number(LARGEST)} /* With larger numbers the kernels may overflow. */",
    }
    names = ", ".join(string(name) for name in arm.joint_names)
    goal = [
        "#include <stdint.h>",
        *example,
        f"static const char *const joint_names[] = {{{names}}};",
    ]
    entries = (_FK, *design.entries)
    calls = ["#include <stdbool.h>", "#include <stdint.h>", "", c_declarations(entries)]
    texts = {
        each.name: each.read_text(encoding="utf-8")
        for folder in (C, C / design.folder)
        for each in _files(folder)
    }
    texts |= design.texts | {
        "arm.h": defined("KINSEEK_ARM_H", numbers | design.numbers),
        "constants.h": constants,
        "goal.h": guarded("KINSEEK_GOAL_H", goal),
        "calls.h": guarded("KINSEEK_CALLS_H", calls),
        "calls.c": f"{_KERNELS_C}\n{c_definitions(entries)}\n",
    }
    return texts, taken + design.constants


def _files(folder: Path) -> list[Path]:
    return sorted(each for each in folder.iterdir() if each.is_file())


_KERNELS_C = """/* Each function writes what it is given into a table of 64-bit numbers, which the compiled kernels read. */
#include "calls.h"

#include <string.h>

static inline int64_t kinseek_bits(double number) {
    int64_t bits;
    memcpy(&bits, &number, sizeof bits);
    return bits;
}

static inline double kinseek_number(int64_t bits) {
    double number;
    memcpy(&number, &bits, sizeof number);
    return number;
}
"""
