"""Meshes that other libraries read are read by a process of its own, which ends at its limits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import InvalidRobot
from kinseek.meshes import limits, process
from kinseek.meshes.limits import Budget
from kinseek.meshes.parts import mesh_parts
from kinseek.meshes.process import MeshReader
from kinseek.support import workers
from mesh_builders import TRIANGLE, dae, noted_glb, one_glb, pictured_glb, robot_of, written_glb

trimesh = pytest.importorskip("trimesh")
psutil = pytest.importorskip("psutil")

LIMITED = pytest.mark.skipif(sys.platform != "linux", reason="the limits are those of Linux")


def files_in(folder: Path) -> dict[str, Path]:
    """Mesh files of all kinds, by name."""
    pytest.importorskip("PIL.Image").new("RGB", (8, 8), (255, 0, 0)).save(folder / "a.png")
    (folder / "a.mtl").write_text("newmtl red\nKd 1 0 0\nmap_Kd a.png\n")
    data, told = pictured_glb((64, 64))
    ball = trimesh.creation.icosphere(2)
    ball.visual.vertex_colors = np.random.default_rng(0).integers(0, 255, (len(ball.vertices), 4))
    content = {
        "painted.obj": f"mtllib a.mtl\n{TRIANGLE}vt 0 0\nvt 1 0\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3\n".encode(),
        "a.dae": dae(),
        "several.glb": one_glb(nodes=3),
        "pictured.glb": written_glb(data, **told),
        "coloured.glb": trimesh.Scene(ball).export(file_type="glb"),
        "a.stl": ball.export(file_type="stl"),
        "a.ply": ball.export(file_type="ply"),
    }
    for name, text in content.items():
        (folder / name).write_bytes(text)
    return {name: folder / name for name in content}


def write_long(path: Path) -> None:
    """Write 32 MB that take ten seconds and more."""
    path.write_text(TRIANGLE + "f 1 2 3\n" * 4_000_000)


def large_picture() -> bytes:
    """260 kB that become 256 MiB, and as many again on their way out of the process."""
    data, told = pictured_glb((2**13, 2**13), mode="RGBA")
    return written_glb(data, **told)


def look_of(part: Any) -> tuple[Any, ...]:
    material = getattr(part.visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    uv = getattr(part.visual, "uv", None)
    colours = part.visual.vertex_colors if part.visual.kind == "vertex" else ()
    return (
        part.visual.kind,
        image and (image.mode, image.size, image.tobytes()),
        np.asarray(uv).tolist() if uv is not None else None,
        np.asarray(colours).tolist(),
        material and material.main_color.tolist(),
    )


def test_a_process_reads_the_same(tmp_path: Path) -> None:
    with MeshReader(Budget(2**24)) as reader:
        for path in files_in(tmp_path).values():
            for far, near in zip(reader.read(path), mesh_parts(path), strict=True):
                assert np.array_equal(far.vertices, near.vertices)
                assert np.array_equal(far.faces, near.faces)
                assert look_of(far) == look_of(near)


def test_what_the_process_has_read_counts(tmp_path: Path) -> None:
    path = files_in(tmp_path)["several.glb"]
    size = path.stat().st_size
    with MeshReader(Budget(2 * size)) as reader:
        assert len(reader.read(path)) == 3
        assert reader.budget.bytes_left == size
        assert len(reader.read(path)) == 3
        with pytest.raises(InvalidRobot, match="too large together"):
            reader.read(path)


def test_no_process_starts_for_what_needs_none_and_none_is_left(tmp_path: Path) -> None:
    files, before = files_in(tmp_path), set(psutil.Process().children())
    with MeshReader(Budget(2**24)) as reader:
        reader.read(files["a.stl"])
        reader.read(files["a.ply"])
        assert set(psutil.Process().children()) <= before
    with MeshReader(Budget(2**24), looks=False) as reader:
        assert reader.read(files["painted.obj"])[0].visual.kind is None
        assert set(psutil.Process().children()) <= before
        reader.read(files["a.dae"])
        assert len(set(psutil.Process().children()) - before) == 1
    assert set(psutil.Process().children()) <= before


def test_words_of_the_author_stay_in_the_process(tmp_path: Path) -> None:
    """They took forty times as many bytes here as the process had sent and counted: gigabytes for the meshes of a robot."""
    (tmp_path / "a.glb").write_bytes(noted_glb({"name": "a", "extras": {"b": [{}] * 1000}}, nodes=3))
    with MeshReader(Budget(2**24)) as reader:
        assert [dict(part.metadata) for part in reader.read(tmp_path / "a.glb")] == [{}] * 3
        assert reader.budget.unpacked_left > limits.MOST_UNPACKED - 6000


@LIMITED
def test_the_process_ends_when_its_time_is_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "MOST_SECONDS", 4)
    files = files_in(tmp_path)
    write_long(tmp_path / "long.obj")
    with MeshReader(Budget(2**26)) as reader:
        assert len(reader.read(files["a.dae"])) == 1
        with pytest.raises(InvalidRobot, match=r"long\.obj' cannot be read: .* ended at .* may take 4 s and"):
            reader.read(tmp_path / "long.obj")
        with pytest.raises(InvalidRobot, match=r"a\.dae' is not read: .* ended at .*long\.obj"):
            reader.read(files["a.dae"])
        assert len(reader.read(files["a.stl"])) == 1


@LIMITED
def test_the_process_refuses_what_takes_more_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "MOST_MEMORY", 2**29)
    files = files_in(tmp_path)
    (tmp_path / "large.glb").write_bytes(large_picture())
    with MeshReader(Budget(2**26)) as reader:
        with pytest.raises(InvalidRobot, match=r"large\.glb' cannot be read"):
            reader.read(tmp_path / "large.glb")
        assert len(reader.read(files["a.dae"])) == 1
        # What fits into the process may still be too much for all meshes together.
        reader.budget.unpacked_left = 100
        with pytest.raises(
            InvalidRobot, match="bytes of bodies with their images and names, expected at most 100"
        ):
            reader.read(files["a.dae"])


def test_a_robot_with_such_a_mesh_is_shown_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from kinseek.viewer.meshes import meshes_of

    monkeypatch.setattr(workers, "PROGRAM", "raise SystemExit(1)")
    files_in(tmp_path)
    names = [f'<mesh filename="{each}"/>' for each in ("a.stl", "a.dae", "several.glb")]
    found = meshes_of(kinseek.load(robot_of(tmp_path, *names)).chain)
    assert len(found.links[0].parts) == 1
    assert "a.dae' cannot be read: the process that reads meshes ended while it imported" in found.missing[0]
    assert "several.glb' is not read: the process" in found.missing[1]
    assert capfd.readouterr().err == ""


def test_a_frozen_program_does_not_start_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    (tmp_path / "a.glb").write_bytes(one_glb())
    with MeshReader(Budget(2**26)) as reader, pytest.raises(InvalidRobot, match="is not a Python"):
        reader.read(tmp_path / "a.glb")


@pytest.mark.skipif(sys.platform == "win32", reason="file descriptors of POSIX")
def test_meshes_are_read_without_standard_error(tmp_path: Path) -> None:
    """The pipe of the answers took its number in the process, which then silenced them."""
    (tmp_path / "a.glb").write_bytes(one_glb())
    program = "import os, sys; os.close(2); from kinseek.collision import Mesh; print(len(Mesh.read('a.glb').faces))"
    found = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, check=False)
    assert found.stdout.split() == [b"1"]


@pytest.mark.parametrize(("option", "named"), [("-P", ""), ("-I", "robot")], ids=["empty entry", "isolated"])
def test_the_process_runs_no_code_from_the_folder_of_a_robot(option: str, named: str, tmp_path: Path) -> None:
    """PYTHONPATH with an empty entry meant the working folder of now to it, not the one in which Python had started."""
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "a.glb").write_bytes(one_glb())
    for name in ("pickle", "sitecustomize"):
        (folder / f"{name}.py").write_text("open('code_ran', 'w').close()")
    program = "import os; from kinseek.collision import Mesh; os.chdir('robot'); print(len(Mesh.read('a.glb').faces))"
    path = str(tmp_path / named) if named else f"{os.pathsep}{tmp_path / 'none'}"
    found = subprocess.run(
        [sys.executable, option, "-c", program],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        check=False,
    )
    assert found.stdout.split() == [b"1"], found.stderr
    assert not (folder / "code_ran").exists()


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="signals of POSIX")
def test_what_a_signal_handler_raises_ends_the_process(tmp_path: Path) -> None:
    """A TimeoutError is an OSError, which a pipe raises, too."""
    write_long(tmp_path / "long.obj")

    def interrupt(*_: Any) -> None:
        raise TimeoutError("the user's own")

    before = set(psutil.Process().children())
    old = signal.signal(signal.SIGALRM, interrupt)
    try:
        with MeshReader(Budget(2**26)) as reader:
            signal.setitimer(signal.ITIMER_REAL, 2.0)
            began = time.perf_counter()
            with pytest.raises(TimeoutError, match="the user's own"):
                reader.read(tmp_path / "long.obj")
            assert time.perf_counter() - began < 10.0
            with pytest.raises(InvalidRobot, match="was interrupted"):
                reader.read(tmp_path / "long.obj")
    finally:
        signal.signal(signal.SIGALRM, old)
    assert set(psutil.Process().children()) <= before
