"""A tracker that is exported as C: the same joint values as in Python, step by step, in fixed memory."""

from __future__ import annotations

import platform
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Goal, Scene
from kinseek.cli.program import run
from kinseek.errors import InvalidExport
from kinseek.export import Parts, controller, prepare, to_c
from kinseek.paths.tracker import Step, Tracker, TrackStatus
from kinseek.support.transforms import rotations
from machines import BOARD, M7, levels

POSE, VELOCITY, STOP = 0, 1, 2
STATUSES = {3: TrackStatus.TRACKING, 4: TrackStatus.LAGGING, 5: TrackStatus.LIMIT, 6: TrackStatus.SINGULAR}
STATUSES |= {7: TrackStatus.STOPPING}
PERIOD = 0.002

CHECK = """
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "kinseek.h"
#include "asked.h"

static void put(const double *numbers, int count) {
    for (int i = 0; i < count; i++) {
        uint32_t half[2];
        memcpy(half, &numbers[i], sizeof half);
        printf(" %08lx%08lx", (unsigned long)half[1], (unsigned long)half[0]);
    }
}

int main(void) {
    double q[KINSEEK_DOF], v[KINSEEK_DOF], a[KINSEEK_DOF], error[2], before[KINSEEK_DOF];
    int early = kinseek_track_stop(PERIOD, q, v, a);
    int fine = kinseek_track_start(start) == KINSEEK_DONE;
    for (int k = 0; k < STEPS; k++) {
        const double *row = asked[k];
        int status;
        if (row[0] == 0.0) status = kinseek_track_pose(row + 2, row[1], q, v, a);
        else if (row[0] == 1.0) status = kinseek_track_velocity(row + 2, row[1], q, v, a);
        else status = kinseek_track_stop(row[1], q, v, a);
        kinseek_track_errors(&error[0], &error[1]);
        printf("step %d", status);
        put(q, KINSEEK_DOF);
        put(v, KINSEEK_DOF);
        put(a, KINSEEK_DOF);
        put(error, 2);
        printf("\\n");
    }
    double loose[16] = {0.0};
    memcpy(before, q, sizeof before);
    int late = kinseek_track_stop(NAN, q, v, a), back = kinseek_track_stop(-PERIOD, q, v, a);
    int still = memcmp(before, q, sizeof before) == 0;
    printf("refused %d %d %d %d %d %d", early, fine, late, back, still, kinseek_track_pose(loose, PERIOD, q, v, a));
    q[0] = INFINITY;
    printf(" %d\\n", kinseek_track_start(q));
    return 0;
}
"""


def stream(arm: kinseek.Arm, start: Any, steps: int) -> list[tuple[int, float, Any]]:
    """Targets of all kinds: what each is, the duration of the step, and a pose (4, 4) or velocities (n,)."""
    rng = np.random.default_rng(5)
    phase = rng.uniform(0.0, 6.0, arm.dof)
    asked: list[tuple[int, float, Any]] = []
    for k in range(steps):
        part, t = k * 10 // steps, k * PERIOD
        # Every third part with the noise of a clock, and a missed period now and then.
        dt = PERIOD if part % 3 else float(PERIOD * rng.choice([1.0, 0.9, 1.2, 3.0]))
        T = arm.fk(start + 0.2 * (np.sin(t + phase) - np.sin(phase)))
        if part == 2:  # A jump, and it shakes.
            T[:3, 3] += rng.normal(0.0, 1e-3, 3)
            T[:3, :3] = rotations(rng.normal(0.0, 5e-3, (1, 3)))[0] @ T[:3, :3]
        if part in (3, 8):  # Out of reach.
            T[:3, 3] *= 3.0
        if part == 6 and k % 50 < 10:
            T[1, 2] = [np.nan, np.inf][k % 2]
        if part == 4:
            asked.append((VELOCITY, dt, 0.5 * np.sin(t + phase)))
        elif part == 5 and k % 2 and k % 100 < 50:
            asked.append((VELOCITY, dt, np.full(arm.dof, [np.nan, 1.7e308][k % 4 // 2])))
        elif part == 9:
            asked.append((STOP, dt, T))
        else:
            asked.append((POSE, dt, T))
    return asked


def by_python(tracker: Tracker, asked: list[tuple[int, float, Any]]) -> list[Step]:
    """Take the steps in Python."""
    return [
        tracker.step(target, dt=dt)
        if kind == POSE
        else tracker.step(velocity=target, dt=dt)
        if kind == VELOCITY
        else tracker.step(dt=dt)
        for kind, dt, target in asked
    ]


def by_c(
    folder: Path,
    start: Any,
    asked: list[tuple[int, float, Any]],
    build: list[str],
    run_with: list[str],
    suffix: str = "",
) -> list[tuple[int, Any]]:
    """Compile the program and the check, run both, and return of each step its status and all numbers."""

    def number(x: float) -> str:
        return x.hex() if np.isfinite(x) else "NAN" if np.isnan(x) else "INFINITY"

    rows = []
    for kind, dt, target in asked:
        numbers = np.zeros(18)
        numbers[:2] = kind, dt
        flat = np.ravel(target)
        numbers[2 : 2 + len(flat)] = flat
        rows.append("{" + ", ".join(map(number, numbers.tolist())) + "}")
    (folder / "asked.h").write_text(
        f"#define STEPS {len(asked)}\n#define PERIOD {PERIOD!r}\n"
        f"static const double start[] = {{{', '.join(map(number, start.tolist()))}}};\n"
        f"static const double asked[][18] = {{{', '.join(rows)}}};\n"
    )
    (folder / "check.c").write_text(CHECK)
    strict = ["-O2", "-Wall", "-Wextra", "-Werror", "-std=c11"]
    for program in ("main", "check"):
        files = [f"{program}.c", "kinseek.c", "track.c", "calls.c", "runtime.c"]
        command = [*build, *strict, *files, "kernels.o", "-lm", "-o", program + suffix]
        subprocess.run(command, cwd=folder, check=True)
    done = subprocess.run(
        [*run_with, f"./main{suffix}"], cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    done = subprocess.run(
        [*run_with, f"./check{suffix}"], cwd=folder, capture_output=True, text=True, timeout=300, check=True
    )
    lines = done.stdout.splitlines()
    # Not started, DONE, two times that are none and do not move it, a pose that is none, and a start at infinity.
    assert lines[-1] == "refused -5 1 -4 -4 1 -3 -1"
    found = []
    for line in lines[:-1]:
        status, *bits = line.split()[1:]
        found.append((int(status), np.array([struct.unpack(">d", bytes.fromhex(each))[0] for each in bits])))
    assert len(found) == len(asked)
    return found


def compare(found: list[tuple[int, Any]], expected: list[Step]) -> None:
    """Statuses and all bits are equal."""
    for k, ((status, numbers), step) in enumerate(zip(found, expected, strict=True)):
        errors = [step.position_error, step.orientation_error]
        same = np.concatenate([step.q, step.velocity, step.acceleration, errors])
        assert STATUSES[status] is step.status, k
        np.testing.assert_array_equal(numbers, same, err_msg=str(k))


def compare_roughly(
    found: list[tuple[int, Any]], tracker: Tracker, asked: list[tuple[int, float, Any]]
) -> None:
    """On another processor: joint values within 1e-4, and no limit is exceeded.

    A pose that is out of reach or farther than a period allows is approached by Newton steps that end where the error
    decreases by less than 1e-12 of it, so joint values that are 1e-6 apart are as good (`ENOUGH` in `atlas/newton.py`).
    `main.c` tracks a pose that is reached in each period, and compares with 1e-6.
    """
    n, before, change = tracker._mechanism.dof, tracker.q, np.zeros(tracker._mechanism.dof)
    expected = by_python(tracker, asked)
    for k, ((_, numbers), step, (_, h, _)) in enumerate(zip(found, expected, asked, strict=True)):
        q, v, a = numbers[: 3 * n].reshape(3, n)
        assert np.abs(q - step.q).max() <= 1e-4, k
        assert (np.abs(v) <= tracker.velocity * (1 + 1e-9)).all(), k
        assert (np.abs(a) <= tracker.acceleration * (1 + 1e-9)).all(), k
        assert (np.abs(a - change) <= h * tracker.jerk * (1 + 1e-9) + 1e-12 / h).all(), k
        assert np.abs((q - before) / h - v).max() <= 1e-14 / h, k
        before, change = q, a


def static_memory(folder: Path, nm: str) -> int:
    """Return the size of what the check keeps in memory, apart from its own variables [bytes]."""
    said = subprocess.run([nm, "-S", "check"], cwd=folder, capture_output=True, text=True, check=True).stdout
    rows = [line.split() for line in said.splitlines()]
    taken = {row[3]: int(row[1], 16) for row in rows if len(row) == 4}
    names = ("handle", "memory", "aim", "joints", "position_error", "orientation_error", "room")
    return sum(taken[name] for name in names)


def tracker_of(arm: kinseek.Arm, **given: Any) -> Tracker:
    limits = {"acceleration": 10.0, "jerk": 200.0} | given
    return arm.track(arm.sample(1, seed=4)[0], PERIOD, recover=False, **limits)


def exported(arm: kinseek.Arm, folder: Path, target: str, **given: Any) -> tuple[Parts, Tracker]:
    """Export a tracker, and return another one that is like it."""
    return to_c(arm, folder, target, search=tracker_of(arm, **given)), tracker_of(arm, **given)


HERE = [
    pytest.mark.slow,
    pytest.mark.skipif(platform.machine() != "x86_64", reason="runs what is written for x86-64"),
    pytest.mark.skipif(not {"avx2", "fma"} <= levels(), reason="the processor is below x86-64-v3"),
    pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc"),
]


@pytest.mark.parametrize(
    ("name", "given"),
    [
        pytest.param("panda", {}, marks=HERE),
        # Joints without limits, one without a limit of speed, and no limit of the jerk.
        pytest.param(
            "gen3", {"velocity": [1.0] * 6 + [1e9], "jerk": None}, marks=[*HERE, pytest.mark.thorough]
        ),
        pytest.param("so101", {"goal": Goal.position(np.zeros(3))}, marks=[*HERE, pytest.mark.thorough]),
        pytest.param("ur5e", {"acceleration": None, "jerk": None}, marks=[*HERE, pytest.mark.thorough]),
    ],
)
def test_c_tracks_with_the_same_bits(tmp_path: Path, name: str, given: dict[str, Any]) -> None:
    arm, folder = kinseek.load(name), tmp_path / "out"
    parts, tracker = exported(arm, folder, "x86-64", **given)
    asked = stream(arm, tracker.q, 4000)
    found = by_c(folder, tracker.q, asked, ["gcc", "-march=x86-64-v3"], [])
    expected = by_python(tracker, asked)
    compare(found, expected)
    assert {step.status for step in expected} >= {
        TrackStatus.TRACKING,
        TrackStatus.LAGGING,
        TrackStatus.STOPPING,
    }
    assert parts.ram == static_memory(folder, "nm")
    assert "track.c" in parts.command
    assert not {"search.c", "atlas.bin"} & set(parts.files)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.skipif(shutil.which("node") is None, reason="no Node here")
def test_webassembly_tracks_the_same(tmp_path: Path) -> None:
    """Another processor: 32-bit addresses, and no fused products and sums."""
    pytest.importorskip("ziglang")
    arm, folder = kinseek.load("ur5e"), tmp_path / "out"
    _, tracker = exported(arm, folder, "wasm32")
    asked = stream(arm, tracker.q, 1000)
    (folder / "run.mjs").write_text(
        "import {WASI} from 'node:wasi'; import {readFileSync} from 'node:fs';"
        "const wasi = new WASI({version: 'preview1'});"
        "const module = readFileSync(process.argv[2]);"
        "const {instance} = await WebAssembly.instantiate(module, wasi.getImportObject());"
        "process.exitCode = wasi.start(instance);"
    )
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-wasi", "-msimd128"]
    found = by_c(folder, tracker.q, asked, zig, ["node", "--no-warnings", "run.mjs"])
    compare_roughly(found, tracker, asked)


@pytest.mark.slow
def test_a_cortex_m7_tracks_the_same(tmp_path: Path) -> None:
    compiler, emulator = shutil.which("arm-none-eabi-gcc"), shutil.which("qemu-system-arm")
    if compiler is None or emulator is None:
        pytest.skip("needs arm-none-eabi-gcc and qemu-system-arm")
    arm, folder = kinseek.load("panda"), tmp_path / "out"
    parts, tracker = exported(arm, folder, "thumbv7em")
    asked = stream(arm, tracker.q, 300)
    found = by_c(folder, tracker.q, asked, [compiler, *M7], [emulator, *BOARD])
    compare_roughly(found, tracker, asked)
    assert 0 <= parts.ram - static_memory(folder, "arm-none-eabi-nm") <= 16


@pytest.mark.slow
def test_a_64_bit_arm_tracks_the_same(tmp_path: Path) -> None:
    compiler, emulator = shutil.which("aarch64-linux-gnu-gcc"), shutil.which("qemu-aarch64")
    if compiler is None or emulator is None:
        pytest.skip("needs aarch64-linux-gnu-gcc and qemu-aarch64")
    arm, folder = kinseek.load("panda"), tmp_path / "out"
    _, tracker = exported(arm, folder, "aarch64")
    asked = stream(arm, tracker.q, 4000)
    found = by_c(folder, tracker.q, asked, [compiler, "-static"], [emulator])
    compare_roughly(found, tracker, asked)


PANDA, HOME = kinseek.load("panda"), [0.0, -0.8, 0.0, -2.3, 0.0, 1.5, 0.8]


@pytest.mark.parametrize(
    ("arm", "tracker", "given", "words"),
    [
        (PANDA, tracker_of(kinseek.load("ur5e")), {}, "one of another arm, 'ur5e'; expected .* 'panda'"),
        (PANDA, PANDA.track(HOME, scene=Scene.of(PANDA, capsules=0.02)), {}, "has no scene"),
        (PANDA, tracker_of(PANDA, prefer="mid-range"), {}, "has no preference"),
        (PANDA, tracker_of(PANDA, goal=Goal.pose(np.eye(4), free="rz", frame="tool")), {}, "no free axes"),
        (
            PANDA,
            tracker_of(PANDA, goal=Goal.pose(np.eye(4), tool=np.eye(4))),
            {},
            "of the tip in the arm's base",
        ),
        (
            PANDA,
            tracker_of(PANDA),
            {"goal": Goal.pose(np.eye(4))},
            "the goal of a tracker is that of Arm.track",
        ),
        (PANDA, tracker_of(PANDA), {"ram": 4096}, r"needs 22,\d\d\d bytes of RAM for the tracker, got 4,096"),
    ],
)
def test_what_c_does_not_have_is_rejected(
    arm: kinseek.Arm, tracker: Tracker, given: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("it came to compiling")

    monkeypatch.setattr(controller, "compiled", never)
    with pytest.raises(InvalidExport, match=words):
        prepare(arm, search=tracker, **given)


def test_the_tracker_that_is_given_does_not_move(monkeypatch: pytest.MonkeyPatch) -> None:
    told = {"memory": 0, "sections": [], "externals": []}
    monkeypatch.setattr(controller, "compiled", lambda *_: (told, b""))
    tracker = tracker_of(PANDA)
    before = tracker.q
    parts = prepare(PANDA, search=tracker)
    assert (tracker.q == before).all()
    assert parts.source == "track.c"
    assert parts.constants < 4000
    assert b"limit_jerk_limit[] = {0x1.9000000000000p+7," in parts.files["rows.h"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["--solver", "tracker", "--samples", "64"],
            "tracker has no option --samples: it is one of a search",
        ),
        (["--jerk", "100"], "--jerk needs --solver tracker, got divide-and-conquer"),
        (["--solver", "tracker", "--jerk", "1", "2"], "--jerk needs 1 or 7 numbers, got 2"),
        (["--solver", "tracker", "--period", "0"], "period, in seconds, must be"),
        (
            ["--solver", "tracker", "--at", "0.4", "0", "0.4", "--rpy", "0", "0", "0"],
            "the goal of a tracker is",
        ),
    ],
)
def test_the_command_line_refuses_in_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["export", "panda", "--to", "c", *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_the_command_line_makes_a_tracker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}

    def known(arm: kinseek.Arm, target: str, **rest: Any) -> Parts:
        given.update(rest)
        raise InvalidExport("enough")

    monkeypatch.setattr("kinseek.cli.commands.export.prepare", known)
    limits = ["--velocity", "1", "--acceleration", "8", "--jerk", "100", "--period", "0.004"]
    assert (
        run(["export", "panda", "--to", "c", "--solver", "tracker", *limits, "--folder", str(tmp_path / "c")])
        == 2
    )
    made = given["search"]
    assert made.period == 0.004
    assert [set(each.tolist()) for each in (made.velocity, made.acceleration, made.jerk)] == [
        {1.0},
        {8.0},
        {100.0},
    ]
