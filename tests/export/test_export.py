"""What is written for controllers runs as C: the same numbers as kinseek, in the memory that was told.

On this machine as plain C; on a Cortex-M7 and on a 64-bit ARM where a compiler and QEMU for them are installed.
"""

from __future__ import annotations

import html
import os
import platform
import re
import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import numpy as np
import pytest

import kinseek
from kinseek import Atlas, BruteForce, DivideAndConquer, Goal
from kinseek.cli.program import run
from kinseek.errors import InvalidExport, InvalidSolver, MissingExtra
from kinseek.export import TARGETS, Parts, compiling, controller, folder, prepare, to_c
from kinseek.export.c_calls import c_declarations, c_definitions
from kinseek.export.c_text import string
from kinseek.kernels.entry import ENTRIES
from kinseek.kernels.grid.memory import MOST_LANES
from kinseek.robots import catalog_path
from machines import BOARD, EXAMPLE, M7, levels

SMALL = DivideAndConquer(branching_factor=360)
GOALS = 8
DONE, MISSED = 1, 2

CHECK = """
#include <stdio.h>
#include <string.h>
#include "kinseek.h"
#include "asked.h"

static void put(double number) {
    uint32_t half[2];
    memcpy(half, &number, sizeof half);
    printf(" %08lx%08lx", (unsigned long)half[1], (unsigned long)half[0]);
}

int main(void) {
    for (int k = 0; k < GOALS; k++) {
        double pose[16], q[KINSEEK_DOF];
        int fine = kinseek_fk(asked_q[k], pose) == KINSEEK_DONE;
#ifdef KINSEEK_GRID
        fine = fine && kinseek_begin(asked_pose[k]) == KINSEEK_MORE;
        int state = KINSEEK_MORE;
        while (state == KINSEEK_MORE) state = kinseek_go_on(WORK, q);
        fine = fine && kinseek_nodes() >= kinseek_evaluations();
#else
        int state = kinseek_solve(asked_pose[k], q);
#endif
        printf("goal %d %d %ld", fine, state, (long)kinseek_evaluations());
        for (int i = 0; i < 16; i++) put(pose[i]);
        for (int i = 0; i < KINSEEK_DOF; i++) put(q[i]);
        printf("\\n");
    }
    double bad[16] = {0.0}, q[KINSEEK_DOF] = {0.0};
    bad[3] = 1.0 / bad[0];
    double error, weighted;
    bool refused = kinseek_solve(bad, q) == KINSEEK_NOT_FINITE;
    refused = refused && kinseek_errors(bad, q, &error, &weighted) == KINSEEK_NOT_FINITE;
#ifdef KINSEEK_GRID
    refused = refused && kinseek_go_on(WORK, q) == KINSEEK_NOT_STARTED;
#endif
    bad[3] = 1e200;
    printf("refused %d\\n", refused && kinseek_solve(bad, q) == KINSEEK_NO_POSE);
    return 0;
}
"""


ASKED = {"NRT_MemInfo_alloc_aligned", "NRT_MemInfo_call_dtor"}
"""What runtime.c has."""
MATHEMATICS = {"sin", "cos", "sincos", "sqrt", "atan2", "pow"}


def asked(arm: kinseek.Arm) -> tuple[Any, Any]:
    q = arm.sample(GOALS, seed=3)
    poses = arm.fk(q)
    poses[-1, :3, 3] *= 4.0  # Out of reach.
    return q, poses


def answers(folder: Path, arm: kinseek.Arm, build: list[str], start: list[str], work: int) -> list[Any]:
    """Compile and run the check; of each goal state, evaluations, pose (4, 4) and joint values (n,)."""

    def table(name: str, rows: Any) -> str:
        text = ",\n".join("{" + ", ".join(float(x).hex() for x in np.ravel(row)) + "}" for row in rows)
        return f"static const double {name}[][{np.size(rows[0])}] = {{{text}}};\n"

    q, poses = asked(arm)
    numbers = f"#define GOALS {GOALS}\n#define WORK {work}\n"
    (folder / "asked.h").write_text(numbers + table("asked_q", q) + table("asked_pose", poses))
    (folder / "check.c").write_text(CHECK)
    strict = ["-O2", "-Wall", "-Wextra", "-Werror", "-std=c11"]
    for program in ("main.c", "check.c"):
        files = [program, "kinseek.c", "search.c", "calls.c", "runtime.c"]
        subprocess.run(
            [build[0], *strict, *files, *build[1:], "-lm", "-o", program[:-2]], cwd=folder, check=True
        )
    main = subprocess.run(
        [*start, "./main"], cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    assert main.returncode == 0, main.stdout + main.stderr
    done = subprocess.run(
        [*start, "./check"], cwd=folder, capture_output=True, text=True, timeout=300, check=True
    )
    assert "refused 1" in done.stdout
    found = []
    for line in done.stdout.splitlines():
        if line.startswith("goal"):
            fine, state, spent, *bits = line.split()[1:]
            assert fine == "1"
            values = np.array([struct.unpack(">d", bytes.fromhex(each))[0] for each in bits])
            found.append((int(state), int(spent), values[:16].reshape(4, 4), values[16:]))
    assert len(found) == GOALS
    return found


def compare(found: list[Any], arm: kinseek.Arm, search: DivideAndConquer | Atlas, most: float) -> None:
    """Poses and joint values at most so far from kinseek's, after as much work where that is exact."""
    q, poses = asked(arm)
    for (state, spent, pose, answer), one, target in zip(found, q, poses, strict=True):
        expected = arm.ik(target, solver=search)
        assert np.abs(pose - arm.fk(one)).max() <= most
        if isinstance(search, DivideAndConquer):
            assert state == DONE
            assert spent == expected.evaluations
        else:
            assert state == (DONE if expected.success else MISSED)
            if most == 0.0:
                assert spent == expected.evaluations
            elif not expected.success:
                continue  # Of the best of what cannot be reached many are as good.
        assert np.abs(answer - expected.q).max() <= max(
            most, 0.0 if isinstance(search, DivideAndConquer) else 1e3 * most
        )


FROM_CPP = """
#include "kinseek.h"
#include <cstdio>

int main() {
    double q[KINSEEK_DOF] = {}, pose[16];
    bool fine = kinseek_finite(q, KINSEEK_DOF) && kinseek_fk(q, pose) == KINSEEK_DONE;
    for (double number : pose) std::printf("%a ", number);
    return fine ? 0 : 1;
}
"""


@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++")
def test_a_cpp_program_calls_the_functions_of_c(tmp_path: Path) -> None:
    """Without the kernels: C functions of the same names stand in for them."""
    header = Path(kinseek.__file__).parent / "export" / "c" / "kinseek.h"
    (tmp_path / "kinseek.h").write_text(header.read_text())
    (tmp_path / "arm.h").write_text("#define KINSEEK_DOF 2\n#define KINSEEK_GRID\n")
    (tmp_path / "user.cpp").write_text(FROM_CPP)
    (tmp_path / "stand_in.c").write_text(
        '#include "kinseek.h"\n'
        "bool kinseek_finite(const double *numbers, int count) { return numbers[count - 1] == 0.0; }\n"
        "int kinseek_fk(const double q[KINSEEK_DOF], double pose[16]) {\n"
        "    for (int i = 0; i < 16; i++) pose[i] = i + q[0];\n"
        "    return KINSEEK_DONE;\n}\n"
    )
    for compiler in (["gcc", "-std=c11", "-c", "stand_in.c"], ["g++", "-pedantic", "user.cpp", "stand_in.o"]):
        strict = ["-Wall", "-Wextra", "-Werror"]
        done = subprocess.run([*compiler, *strict], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    said = subprocess.run(["./a.out"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert [float.fromhex(word) for word in said.split()] == list(range(16))


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="runs what is written for x86-64")
@pytest.mark.skipif(not {"avx2", "fma"} <= levels(), reason="the processor is below x86-64-v3")
@pytest.mark.parametrize(
    "name",
    ["elbow6", *(pytest.param(name, marks=pytest.mark.thorough) for name in ("panda", "cylindrical3"))],
)
def test_plain_c_gives_the_same_bits(tmp_path: Path, name: str) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc")
    arm = kinseek.load(name)
    form = {"panda": "object", "elbow6": "assembly", "cylindrical3": "object"}[name]
    search = replace(SMALL, breadth=1.5)
    parts = to_c(arm, tmp_path / "out", search=search, form=form)
    assert parts.lanes == parts.most_lanes < MOST_LANES
    file = {"object": "kernels.o", "assembly": "kernels.s"}[form]
    found = answers(tmp_path / "out", arm, ["gcc", "-march=x86-64-v3", file], [], work=500)
    compare(found, arm, search, 0.0)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.skipif(platform.machine() != "x86_64", reason="runs what is written for x86-64")
def test_a_smaller_memory_finds_as_good_nodes(tmp_path: Path) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc")
    arm = kinseek.load("elbow6")
    parts = to_c(arm, tmp_path / "out", cpu="x86-64-v2", search=SMALL, ram=3 * 1024)
    assert parts.ram <= 3 * 1024
    assert parts.lanes < parts.most_lanes
    assert f"{parts.lanes} tabulated leaves and not {parts.most_lanes}" in str(parts)
    found = answers(tmp_path / "out", arm, ["gcc", "-march=x86-64-v2", "kernels.o"], [], work=1 << 40)
    _, poses = asked(arm)
    for (_, spent, _, q), target in zip(found, poses, strict=True):
        expected = arm.ik(target, solver=SMALL)
        assert spent == expected.evaluations
        error = Goal.pose(target).measure(arm.chain.arrays, q[None])[0, 2]
        assert error == pytest.approx(expected.weighted_error, rel=1e-9)


@pytest.mark.slow
def test_a_cortex_m7_finds_the_same(tmp_path: Path) -> None:
    compiler, emulator = shutil.which("arm-none-eabi-gcc"), shutil.which("qemu-system-arm")
    if compiler is None or emulator is None:
        pytest.skip("needs arm-none-eabi-gcc and qemu-system-arm")
    arm, folder = kinseek.load("panda"), tmp_path / "out"
    parts = to_c(arm, folder, "thumbv7em", search=SMALL, ram=64 * 1024, flash=64 * 1024)
    options = [*parts.cpu.options.split(), "--specs=rdimon.specs", "-nostartfiles", "-Wl,--no-warnings"]
    board = [str(EXAMPLE / "start.c"), "-T", str(EXAMPLE / "part.ld")]
    start = [
        emulator,
        "-M",
        "mps2-an500",
        "-nographic",
        "-semihosting-config",
        "enable=on,target=native",
        "-kernel",
    ]
    found = answers(folder, arm, [compiler, *options, *board, "kernels.o"], start, work=5000)
    compare(found, arm, SMALL, 1e-14)
    sizes = subprocess.run(
        ["arm-none-eabi-nm", "-S", "main"], cwd=folder, capture_output=True, text=True, check=True
    )
    taken = {
        line.split()[3]: int(line.split()[1], 16)
        for line in sizes.stdout.splitlines()
        if len(line.split()) == 4
    }
    assert 0 <= parts.ram - sum(taken[name] for name in ("memory", "wanted", "at", "room")) <= 8


@pytest.mark.slow
def test_a_64_bit_arm_finds_the_same(tmp_path: Path) -> None:
    compiler, emulator = shutil.which("aarch64-linux-gnu-gcc"), shutil.which("qemu-aarch64")
    if compiler is None or emulator is None:
        pytest.skip("needs aarch64-linux-gnu-gcc and qemu-aarch64")
    arm = kinseek.load("panda")
    to_c(arm, tmp_path / "out", "aarch64", search=SMALL)
    found = answers(tmp_path / "out", arm, [compiler, "-static", "kernels.o"], [emulator], work=1 << 40)
    compare(found, arm, SMALL, 1e-14)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.skipif(platform.machine() != "x86_64", reason="runs what is written for x86-64")
@pytest.mark.skipif(not {"avx2", "fma"} <= levels(), reason="the processor is below x86-64-v3")
def test_the_atlas_gives_the_same_bits(tmp_path: Path) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc")
    arm, search = kinseek.load("panda"), Atlas(samples=2048)
    to_c(arm, tmp_path / "out", search=search, flash=1 << 20, ram=32 * 1024)
    found = answers(tmp_path / "out", arm, ["gcc", "-march=x86-64-v3", "kernels.o"], [], work=0)
    compare(found, arm, search, 0.0)
    assert [state for state, *_ in found] == [DONE] * (GOALS - 1) + [MISSED]


@pytest.mark.slow
def test_a_cortex_m7_runs_the_atlas(tmp_path: Path) -> None:
    compiler, emulator = shutil.which("arm-none-eabi-gcc"), shutil.which("qemu-system-arm")
    if compiler is None or emulator is None:
        pytest.skip("needs arm-none-eabi-gcc and qemu-system-arm")
    arm, search = kinseek.load("panda"), Atlas(samples=2048)
    parts = to_c(arm, tmp_path / "out", "thumbv7em", search=search)
    assert set(parts.externals) - MATHEMATICS <= ASKED
    found = answers(tmp_path / "out", arm, [compiler, *M7, "kernels.o"], [emulator, *BOARD], work=0)
    compare(found, arm, search, 1e-12)


def test_c_has_the_types_that_are_declared() -> None:
    one = [ENTRIES["ks_write_poses"]]
    text = c_declarations(one)
    assert "const double *fixed;  /* (m+1, 3, 4) */" in text
    assert "const bool *prismatic;" in text
    assert re.search(
        r"int32_t kinseek_write_poses\(int64_t m, int64_t n, int64_t k, const KinseekChainArrays \*chain, "
        r"const double \*q, double \*poses\);",
        text,
    )
    body = c_definitions(one)
    assert "(int64_t)(uintptr_t)chain->fixed,\n        m + 1,\n        3,\n        4," in body
    assert "kinseek_bits(goal->position_weight)" in c_definitions([ENTRIES["ks_descend"]])


def test_assembly_of_llvm_is_for_clang() -> None:
    target = TARGETS["riscv32"]
    parts = Parts({}, target, target.cpus[0], 1, 1, 1, 1, 1, "kernels.ll")
    assert parts.command.startswith("clang --target=riscv32-unknown-elf -O2 -march=rv32imc")


def test_names_are_safe_in_c() -> None:
    assert string("left_arm 2") == '"left_arm 2"'
    assert string('*/ "\\\n??/é') == r'"\052\057 \042\134\012\077\077\057\303\251"'


@pytest.mark.parametrize("search", [SMALL, Atlas()])
def test_names_are_strings_wherever_c_has_them(search: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    told = {"memory": ANY, "sections": [], "externals": []}
    monkeypatch.setattr(controller, "compiled", lambda *_: (told, b""))
    hostile, text = "*/ int pwned; /* ??/\n#error \\", catalog_path("planar2").read_text(encoding="utf-8")
    files = []
    for name in ("N", html.escape(hostile).replace("\n", "&#10;")):
        # The names of the robot, its links and its joints.
        named = re.sub('( (?:name|link)=".*?)"', rf'\1{name.replace(chr(92), chr(92) * 2)}"', text)
        files.append(prepare(kinseek.load(named), "x86-64", search=search).files)
    plain, odd = files
    assert set(odd) == set(plain)
    assert hostile.encode() not in b"".join(odd.values())
    assert string(hostile)[1:-1].encode() in odd["goal.h"]
    for name, content in plain.items():
        assert odd[name].replace(string(hostile)[1:-1].encode(), b"N") == content, name


FUNCTION = kinseek.Arm.from_fk(lambda q: np.broadcast_to(np.eye(4), (len(q), 4, 4)), [-1.0], [1.0])
PANDA = kinseek.load("panda")


@pytest.mark.parametrize(
    ("arm", "given", "words"),
    [
        (
            PANDA,
            {"target": "avr"},
            "unknown target 'avr'.*Valid: aarch64, riscv32, thumbv7em, wasm32, x86-64",
        ),
        (PANDA, {"cpu": "cortex-m7"}, "unknown processor of x86-64 'cortex-m7'"),
        (PANDA, {"form": "elf"}, "form must be one of 'object', 'assembly', 'llvm', got 'elf'"),
        (PANDA, {"ram": 0}, "ram \\[bytes\\] must be a whole number of at least 1, got 0"),
        (PANDA, {"flash": 1e6}, "flash \\[bytes\\] must be a whole number"),
        (
            PANDA,
            {"ram": 2048},
            r"'panda' with 7 joints needs 2,\d\d\d bytes of RAM at least for this search, got 2,048",
        ),
        (FUNCTION, {}, "an arm with black-box kinematics cannot be exported"),
        ("ur5e", {}, "an export needs an Arm, as kinseek.load gives it, got str"),
        (PANDA, {"search": DivideAndConquer(tree="static")}, "tree must be 'dynamic'"),
        (PANDA, {"search": DivideAndConquer(ties="first")}, "ties must be 'rounding'"),
        (PANDA, {"goal": Goal.pose(np.stack([np.eye(4)] * 2))}, r"one goal, got a batch of shape \(2,\)"),
        (PANDA, {"goal": Goal.pointing([0.4, 0, 0.4], [0, 0, 1])}, "a pose or position of the tip"),
        (PANDA, {"goal": Goal.pose(np.eye(4), free="x")}, "no free axes"),
        (PANDA, {"search": BruteForce()}, "search must be a DivideAndConquer, an Atlas or a tracker"),
        (PANDA, {"search": Atlas(), "ram": 4096}, r"needs 3\d,\d\d\d bytes of RAM for the atlas, got 4,096"),
        (
            PANDA,
            {"search": Atlas(), "goal": Goal.position([0.4, 0, 0.4])},
            "supports whole poses.*got another kind",
        ),
        (PANDA, {"goal": Goal.pose(np.eye(4), tool=np.eye(4))}, "a pose or position of the tip"),
    ],
)
def test_bad_input_is_refused_before_anything_is_compiled(
    arm: kinseek.Arm, given: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("it came to compiling")

    monkeypatch.setattr(controller, "compiled", never)
    with pytest.raises(InvalidExport, match=words):
        prepare(arm, **given)


def test_parameters_of_the_search_are_its_own_to_refuse() -> None:
    with pytest.raises(InvalidSolver, match="breadth must be one number or 7"):
        prepare(PANDA, search=DivideAndConquer(breadth=(1, 2)))


def test_bad_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidExport, match=r"folder .*, in which 'c' would be created, does not exist"):
        to_c(PANDA, tmp_path / "nowhere" / "c")
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidExport, match="is not a folder"):
        to_c(PANDA, tmp_path / "file")
    (tmp_path / "main.c").write_text("int main(void) { return 0; }")
    with pytest.raises(InvalidExport, match=r"^'[^']*' holds main\.c, which kinseek did not write"):
        to_c(PANDA, tmp_path)
    with pytest.raises(InvalidExport, match="folder must be a path"):
        to_c(PANDA, "")


PARTS = Parts(
    {"kinseek.h": b"/* Written by kinseek", "main.c": b"int main"},
    TARGETS["thumbv7em"],
    TARGETS["thumbv7em"].cpus[1],
    30_000,
    1500,
    4000,
    9,
    27,
    "kernels.o",
)


@pytest.mark.parametrize("name", ["main.c", "kernels.o"])
def test_links_in_the_folder_are_replaced_and_not_followed(tmp_path: Path, name: str) -> None:
    victim, folder = tmp_path / "victim", tmp_path / "c"
    victim.write_text("mine")
    folder.mkdir()
    (folder / name).symlink_to("../victim")
    with pytest.raises(InvalidExport, match=f"holds {name}, which kinseek did not write"):
        PARTS.write(folder)
    (folder / "kinseek.h").write_text("/* Written by kinseek 1.0 */")
    PARTS.write(folder)
    assert victim.read_text() == "mine"
    assert (folder / "main.c").read_bytes() == b"int main"
    assert not (folder / name).is_symlink()


def test_a_link_that_leads_nowhere_is_not_written_through(tmp_path: Path) -> None:
    (tmp_path / "main.c").symlink_to("missing")
    with pytest.raises(InvalidExport, match=r"holds main\.c, which kinseek did not write"):
        PARTS.write(tmp_path)
    assert not (tmp_path / "missing").exists()


@pytest.mark.parametrize("before", [False, True], ids=["first", "again"])
def test_an_export_that_was_interrupted_can_be_repeated(
    before: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next one said that kinseek had not written what the first one had."""
    if before:
        PARTS.write(tmp_path)
    written, replace = list[str](), os.replace

    def full(part: str, name: str, **folders: int) -> None:
        if written:
            raise OSError(28, "No space left on device")
        replace(part, name, **folders)
        written.append(name)

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InvalidExport, match="No space left on device"):
        PARTS.write(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["kinseek.h"]
    monkeypatch.undo()
    PARTS.write(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kinseek.h", "main.c"]


@pytest.mark.skipif(os.name == "nt", reason="Windows opens no folders")
def test_a_folder_that_is_exchanged_while_it_is_written_leads_nowhere_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another user who owns the folder around could put a link in its place, and files of the first were replaced."""
    (victim := tmp_path / "victim").mkdir()
    (victim / "main.c").write_text("mine")
    (place := tmp_path / "c").mkdir()
    remove = os.unlink

    def exchange(name: str, **folder: int) -> None:
        if place.is_dir() and not place.is_symlink():
            place.rename(tmp_path / "away")
            place.symlink_to(victim)
        remove(name, **folder)

    monkeypatch.setattr(os, "unlink", exchange)
    PARTS.write(place)
    assert place.is_symlink()
    assert [path.read_text() for path in victim.iterdir()] == ["mine"]
    assert sorted(path.name for path in (tmp_path / "away").iterdir()) == ["kinseek.h", "main.c"]


@pytest.fixture(name="here")
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder of a command that exports `PARTS` at once."""
    monkeypatch.setattr("kinseek.cli.commands.export.prepare", lambda *given, **named: PARTS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives folders away")
def test_a_folder_of_another_user_has_to_be_named(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The other user could exchange the program before it was compiled and run."""
    (here / "scara4_c").mkdir()
    os.chown(here / "scara4_c", 65534, 65534)
    assert run(["export", "scara4", "--to", "c"]) == 2
    assert "'scara4_c' belongs to another user; name a folder with --folder" in capsys.readouterr().err
    assert run(["export", "scara4", "--to", "c", "--folder", "scara4_c"]) == 0


def test_a_link_that_is_put_there_while_kernels_are_compiled_is_not_followed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def prepare(*given: Any, **named: Any) -> Parts:
        (tmp_path / "scara4_c").symlink_to("elsewhere")
        return PARTS

    monkeypatch.setattr("kinseek.cli.commands.export.prepare", prepare)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    assert run(["export", "scara4", "--to", "c"]) == 2
    assert "cannot look into 'scara4_c'" in capsys.readouterr().err
    assert not any((tmp_path / "elsewhere").iterdir())


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives folders away")
def test_a_folder_of_another_user_that_appears_at_the_last_moment_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mkdir = Path.mkdir

    def other(folder: Path, *given: Any, **named: Any) -> None:
        mkdir(folder, *given, **named)
        os.chown(folder, 65534, 65534)

    monkeypatch.setattr(Path, "mkdir", other)
    with pytest.raises(InvalidExport, match="'arm_c' belongs to another user"):
        PARTS.write(tmp_path / "arm_c", named=False)
    assert not any((tmp_path / "arm_c").iterdir())
    assert PARTS.write(tmp_path / "arm_c") == tmp_path / "arm_c"


def test_one_of_two_exports_into_a_folder_waits_for_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both ended well, and the folder had files of each."""
    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setattr(folder, "_PATIENCE", 0.1)
    descriptor = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    with pytest.raises(InvalidExport, match="another process is writing into"):
        PARTS.write(tmp_path)
    assert not any(tmp_path.iterdir())
    os.close(descriptor)
    PARTS.write(tmp_path)


def test_a_folder_that_is_a_link_has_to_be_named(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "elsewhere").mkdir()
    (here / "scara4_c").symlink_to("elsewhere")
    assert run(["export", "scara4", "--to", "c"]) == 2
    assert "'scara4_c' is a link; name the folder with --folder" in capsys.readouterr().err
    assert not any((here / "elsewhere").iterdir())
    assert run(["export", "scara4", "--to", "c", "--folder", "scara4_c"]) == 0
    assert (here / "elsewhere" / "main.c").is_file()


def test_without_numba_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "find_spec", lambda name: None)
    with pytest.raises(MissingExtra, match=r"pip install 'kinseek\[jit\]'"):
        to_c(PANDA, tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_the_compiler_runs_no_code_of_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("sitecustomize", "json", "numba"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep + "folder"
    )  # Of `PYTHONPATH=$PYTHONPATH:folder`, if it is not set.
    begun, real = list[list[str]](), subprocess.run

    def imports_only(command: list[str], **options: Any) -> Any:
        begun.append(command)
        return real([*command[:-2], "-c", "import json, numba, kinseek.export; exit(7)"], **options)

    monkeypatch.setattr(subprocess, "run", imports_only)
    with pytest.raises(InvalidExport, match="could not be compiled"):
        to_c(PANDA, tmp_path / "c")
    assert len(begun) == 1
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["panda"], "Missing option '--to'"),
        (["panda", "--to", "rust"], "unknown language 'rust'. Valid: c"),
        (["panda", "--to", "c", "--solver", "brute-force"], "unknown search for a controller 'brute-force'"),
        (["panda", "--to", "c", "--samples", "64"], "divide-and-conquer has no option --samples"),
        (["panda", "--to", "c", "--ram", "64q"], "--ram: '64q' is not a number of bytes"),
        (["panda", "--to", "c", "--target", "arm"], "unknown target 'arm'"),
        (["panda", "--to", "c", "--ram", "1k"], "needs 2,"),
        (["panda", "--to", "c", "--at", "0.4 0 0.4"], "a goal needs exactly one of"),
        (["panda", "--to", "c", "--folder", "/no/where"], "folder '/no', in which"),
    ],
)
def test_the_command_line_refuses_in_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["export", *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("name", ["plain_c", "two words", "x;touch PWNED;$(touch PWNED)`'\"", "-P"])
def test_the_command_that_is_printed_can_be_copied(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("kinseek.cli.commands.export.prepare", lambda *_, **__: PARTS)
    assert run(["export", "scara4", "--to", "c", f"--folder={name}"]) == 0
    line = capsys.readouterr().out.splitlines()[-1]
    told, _, compiler = line.rpartition(" && ")
    assert compiler == PARTS.command
    assert told == f"cd {name}" or name != "plain_c"
    subprocess.run(["sh", "-c", f"{told} && touch here"], cwd=tmp_path, check=True)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name / "here").is_file()


def test_the_command_line_tells_sizes_before_it_writes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given: dict[str, Any] = {}
    parts = PARTS

    def known(arm: kinseek.Arm, name: str, **rest: Any) -> Parts:
        given.update(rest)
        return parts

    monkeypatch.setattr("kinseek.cli.commands.export.prepare", known)
    words = [
        "export",
        "scara4",
        "--to",
        "c",
        "--target",
        "thumbv7em",
        "--folder",
        str(tmp_path / "c"),
        "--breadth",
        "2",
    ]
    assert (
        run([*words, "--ram", "64k", "--flash", "1M", "--at", "0.3", "-0.1", "0.2", "--position-only"]) == 0
    )
    assert (given["ram"], given["flash"]) == (65536, 1048576)
    assert given["search"] == DivideAndConquer(breadth=2)
    assert given["goal"].kind == "position"
    out, error = capsys.readouterr()
    assert "flash 31,500 bytes" in error
    assert "RAM 4,000 bytes" in error
    assert "kinseek.h" in out
    assert parts.command in out
    assert run([*words, "--json"]) == 2
    assert run(words) == 0  # Its own files may be written again.
