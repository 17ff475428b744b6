"""The kernels as WebAssembly, in Node, answer as they do here: same goals, joint values compared, success judged anew."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek.errors import InvalidExport, MissingExtra
from kinseek.export import to_wasm, wasm, wasm_module
from kinseek.export.javascript import SCRIPT
from page_parts import build_script
from places import ROOT

GOALS, FEW, FAR = 200, 20, 20
"""Goals of each arm of the page, of every other bundled arm, and out of reach."""
CLOSE = 1e-9
"""Joint values of one search that ran on two processors may differ by so much [rad or m]: rounding, grown a little."""
TOLERANCE = 1e-6
BUNDLED = sorted(path.stem for path in (Path(kinseek.__file__).parent / "robots" / "catalog").glob("*.urdf"))

pytestmark = [pytest.mark.slow, pytest.mark.thorough]


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Kernels, compiled unless they are up to date, and every bundled arm."""
    built: Path = build_script()["parts"]()
    folder = tmp_path_factory.mktemp("parts") / "arms"
    return to_wasm([kinseek.load(name) for name in BUNDLED], folder, (built / "kinseek.wasm").read_bytes())


@pytest.fixture(scope="module")
def asked() -> dict[str, Any]:
    goals = {}
    shown = build_script()["ARMS"]
    for name in BUNDLED:
        arm = kinseek.load(name)
        q = arm.sample(GOALS if name in shown else FEW, seed=5)
        poses = arm.fk(q)
        far = poses[: FAR if name in shown else FAR // 4].copy()
        far[:, :3, 3] *= 1.6
        goals[arm.name] = {"arm": arm, "q": q, "poses": poses, "far": far}
    return goals


@pytest.fixture(scope="module")
def answers(parts: Path, asked: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    file = tmp_path_factory.mktemp("asked") / "asked.json"
    flat = {
        name: {
            "q": one["q"].tolist(),
            "poses": one["poses"].reshape(-1, 16).tolist(),
            "far": one["far"].reshape(-1, 16).tolist(),
        }
        for name, one in asked.items()
    }
    file.write_text(json.dumps(flat))
    node = Path(__file__).with_name("javascript.mjs")
    done = subprocess.run(
        ["node", node, parts, file], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def joined(answers: list[dict[str, Any]]) -> Any:
    return np.array([one["q"] for one in answers])


def errors(arm: kinseek.Arm, q: Any, poses: Any) -> tuple[Any, Any]:
    """Position error [m] and angle [rad] by plain forward kinematics."""
    T = arm.fk(q)
    away = np.linalg.norm(T[:, :3, 3] - poses[:, :3, 3], axis=1)
    half = np.linalg.norm((T - poses)[:, :3, :3], axis=(1, 2)) / np.sqrt(8.0)
    return away, 2.0 * np.arcsin(np.minimum(half, 1.0))


def test_forward_kinematics_is_the_same(answers: dict[str, Any], asked: dict[str, Any]) -> None:
    for name, one in asked.items():
        found = np.array(answers[name]["fk"]).reshape(-1, 4, 4)
        assert np.abs(found - one["poses"]).max() < 1e-14, name
        away, turned = errors(one["arm"], np.roll(one["q"], -1, axis=0), one["poses"])
        told = np.array(
            [[each["positionError"], each["orientationError"]] for each in answers[name]["errors"]]
        )
        assert np.abs(told - np.stack([away, turned], axis=1)).max() < 1e-7, (
            name
        )  # An angle near π is not known better.


@pytest.mark.parametrize("how", ["solved", "near"])
def test_one_answer_is_that_of_python(answers: dict[str, Any], asked: dict[str, Any], how: str) -> None:
    for name, one in asked.items():
        arm, found = one["arm"], answers[name][how]
        here = [
            arm.ik(T, near=q if how == "near" else None) for T, q in zip(one["poses"], one["q"], strict=True)
        ]
        q = joined(found)
        away, turned = errors(arm, q, one["poses"])
        inside = ((q >= arm.lower) & (q <= arm.upper)).all(axis=1)
        for k, solution in enumerate(here):
            met = bool(away[k] <= TOLERANCE and turned[k] <= TOLERANCE and inside[k])
            assert found[k]["reached"] == met == solution.success, (name, k)
        apart = np.abs(q - np.array([solution.q for solution in here])).max(axis=1)
        assert apart.max() < CLOSE, (name, apart.max())
        assert [each["evaluations"] for each in found] == [int(each.evaluations) for each in here], name


def test_branches_are_those_of_python(answers: dict[str, Any], asked: dict[str, Any]) -> None:
    for name, one in asked.items():
        arm, poses = one["arm"], one["poses"]
        found = answers[name]["branches"]
        here = arm.branches(poses)
        spare = here[0].sampled
        for k, (there, branches) in enumerate(zip(found, here, strict=True)):
            q = joined(there["answers"])
            away, turned = errors(arm, q, np.broadcast_to(poses[k], (len(q), 4, 4)))
            assert away.max() <= TOLERANCE, (name, k)
            assert turned.max() <= TOLERANCE, (name, k)
            assert ((q >= arm.lower) & (q <= arm.upper)).all(), (name, k)
            assert there["endless"] == spare, (name, k)
            if not spare:  # The same set; those that differ by full turns alone are one.
                assert len(q) == len(branches.q), (name, k)
                apart = q[:, None] - branches.q[None]
                turns = arm.axes.periodic if arm.axes is not None else False
                apart = np.where(turns, apart - 2 * np.pi * np.round(apart / (2 * np.pi)), apart)
                nearest = np.abs(apart).max(axis=2).min(axis=1)
                assert nearest.max() < 1e-5, (name, k, nearest.max())


def test_what_is_out_of_reach_is_proved_so(answers: dict[str, Any], asked: dict[str, Any]) -> None:
    proved, waited, worse = 0, 0, []
    for name, one in asked.items():
        arm = one["arm"]
        for k, (pose, there) in enumerate(zip(one["far"], answers[name]["far"], strict=True)):
            if there["proof"]["told"] == "more":  # Of many joints it takes longer than a test waits.
                waited += 1
                continue
            verdict = arm.prove(pose).verdict.name
            word = {"unreachable": "UNREACHABLE", "reached": "REACHABLE"}[there["proof"]["told"]]
            assert word == verdict, (name, k)
            proved += word == "UNREACHABLE"
            if word == "REACHABLE":
                away, turned = errors(arm, np.array([there["proof"]["q"]]), pose[None])
                assert away[0] <= TOLERANCE, (name, k)
                assert turned[0] <= TOLERANCE, (name, k)
            else:
                assert not there["reached"]
                worse.append(there["weightedError"] / float(arm.ik(pose).weighted_error) - 1.0)
    assert proved > 100
    assert waited < 5
    # The way to the nearest pose is long and its end flat: now and then rounding leads to another place.
    assert np.mean(np.abs(worse) < 1e-6) > 0.95, np.sort(worse)
    assert max(worse) < 0.05, np.sort(worse)


def test_what_makes_no_sense_is_refused(answers: dict[str, Any]) -> None:
    for told in answers.values():
        assert told["refused"] == [
            "a pose: a number is not finite",
            "the pose is no rigid transform",
            "a pose: expected 16 numbers, got 2",
        ]


def test_the_example_of_the_documentation_runs(parts: Path, tmp_path: Path) -> None:
    text = (ROOT / "docs" / "page.md").read_text(encoding="utf-8")
    example = text.split("```js\n")[1].split("```")[0]
    (tmp_path / "arms").symlink_to(parts)
    (tmp_path / "example.mjs").write_text(example + "console.log(arm.branches(pose).answers.length);\n")
    done = subprocess.run(
        ["node", "example.mjs"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout) == (0, "8\n"), done.stderr


def test_arms_are_checked_before_anything_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = kinseek.load("scara4")
    function = kinseek.Arm.from_fk(lambda q: np.broadcast_to(np.eye(4), (len(q), 4, 4)), [-1.0], [1.0])
    with pytest.raises(InvalidExport, match="arms must have distinct names, got 'scara4' more than once"):
        to_wasm([arm, arm], tmp_path / "a")
    with pytest.raises(InvalidExport, match="an arm with black-box kinematics cannot be exported"):
        to_wasm([function], tmp_path / "a")
    with pytest.raises(InvalidExport, match="does not exist"):
        to_wasm([arm], tmp_path / "no" / "where", b"")
    monkeypatch.setattr(wasm, "find_spec", lambda name: None)
    with pytest.raises(MissingExtra, match=r"pip install 'kinseek\[wasm\]'"):
        wasm_module()
    assert not (tmp_path / "a").exists()


def test_files_of_others_and_what_links_lead_to_are_not_overwritten(tmp_path: Path) -> None:
    arm, victim, folder = kinseek.load("planar2"), tmp_path / "victim", tmp_path / "page"
    victim.write_text("mine")
    folder.mkdir()
    (folder / "arms.json").symlink_to("../victim")
    with pytest.raises(InvalidExport, match=r"holds arms\.json, which kinseek did not write"):
        to_wasm([arm], folder, b"")
    shutil.copy(SCRIPT, folder / "kinseek.js")
    to_wasm([arm], folder, b"")
    assert victim.read_text() == "mine"
    assert not (folder / "arms.json").is_symlink()
    to_wasm([arm], folder, b"again")  # Its own files may be written again.
    assert (folder / "kinseek.wasm").read_bytes() == b"again"


@pytest.mark.skipif(shutil.which("node") is None, reason="no Node here")
@pytest.mark.parametrize(
    "search", [kinseek.DivideAndConquer(branching_factor=360), kinseek.Atlas(samples=1024)]
)
def test_c_runs_as_webassembly_too(tmp_path: Path, search: Any) -> None:
    pytest.importorskip("ziglang")
    pytest.importorskip("numba")
    parts = kinseek.export.to_c(kinseek.load("scara4"), tmp_path / "c", "wasm32", search=search)
    words = [sys.executable, *parts.command.split()[1:]]
    subprocess.run(words, cwd=tmp_path / "c", check=True, capture_output=True)
    script = (
        "import {WASI} from 'node:wasi'; import {readFileSync} from 'node:fs';"
        "const wasi = new WASI({version: 'preview1'});"
        "const {instance} = await WebAssembly.instantiate(readFileSync('solve'), wasi.getImportObject());"
        "process.exitCode = wasi.start(instance);"
    )
    done = subprocess.run(
        ["node", "--no-warnings", "--input-type=module", "-e", script],
        cwd=tmp_path / "c",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "beside kinseek" in done.stdout
