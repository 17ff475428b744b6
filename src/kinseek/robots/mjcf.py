"""Read a serial arm from a MuJoCo XML file (MJCF).

MuJoCo itself reads the bodies, so defaults, frames, angle units and automatic limits have their MuJoCo meaning. Everything
with a size or a surface is removed before MuJoCo reads the file (`mjcf_xml`), so meshes and textures need not exist. Bodies
and sites are the frames; a body takes precedence over a site of the same name.

Joint values are MuJoCo's ``qpos``: a joint's ``ref`` is its value in the pose of the file. Equality constraints are ignored:
each joint of the file is a separate variable.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from kinseek.errors import InvalidRobot, MissingExtra
from kinseek.support.forks import importing
from kinseek.support.interrupts import raise_of_handler
from kinseek.support.transforms import rotation, transform
from kinseek.support.units import warn_of_joints

from .chain import Array, Frame, SerialChain
from .files import MOST_JOINTS, require_few
from .joints import Joint, Segment, joined, serial_chain
from .mechanism import CONTINUOUS, PRISMATIC, REVOLUTE
from .tree import frame_path

_SAFE_PATH = "PYTHONSAFEPATH"
"""Environment variable with which Python does not look for modules in the working folder."""


def read_mjcf(path: str | Path, base: str | None = None, tip: str | None = None) -> SerialChain:
    """Read the arm between two frames of an MJCF file.

    Args:
        path: The file.
        base: Name of the base body or site; the default is ``world``.
        tip: Name of the body or site whose pose is computed; the default is the only body without a child.

    Raises:
        InvalidRobot: MuJoCo rejects the file, or a joint between base and tip cannot be used.
        MissingExtra: MuJoCo is not installed.
    """
    path = Path(path)
    return read_model(_compile(path), base, tip, where=str(path), name=path.stem)


def read_model(
    model: Any, base: str | None = None, tip: str | None = None, *, where: str, name: str = "robot"
) -> SerialChain:
    """Read the arm between two frames of a compiled MuJoCo model, a ``mujoco.MjModel``.

    Args:
        model: The model.
        base: As in `read_mjcf`.
        tip: As in `read_mjcf`.
        where: Source of the model, for messages.
        name: Name of the arm, if the model has none.

    Raises:
        InvalidRobot: A joint between base and tip cannot be used.
    """
    with np.errstate(all="ignore"):  # Overflowing numbers are rejected when the chain is built.
        chain = _read(model, base, tip, where, name)
    warn_of_joints(
        chain.joint_names, chain.kinds, chain.lower, chain.upper, where, 'leave out angle="radian"'
    )
    return chain


def _read(model: Any, base: str | None, tip: str | None, where: str, called: str) -> SerialChain:
    bodies = _names(model, model.name_bodyadr, "body")
    above: dict[str, str | None] = {
        name: bodies[model.body_parentid[i]] if i else None for i, name in enumerate(bodies)
    }
    leaves = above.keys() - set(above.values())
    moved = {name for i, name in enumerate(bodies) if model.body_jntnum[i]}
    sites = {}
    table = bytes(model.names)
    for i in range(model.nsite):
        name = _string(table, int(model.name_siteadr[i]))
        if name and name not in above:
            sites[name] = i
            above[name] = bodies[model.site_bodyid[i]]

    if tip is None and base in sites:  # A site has no children: the tip is below its body.
        tip = frame_path(above, above[base], None, ends=leaves, noun="body or site", moving=moved).down[-1]
    path = frame_path(above, base, tip, ends=leaves, noun="body or site", moving=moved)
    joints = _names(model, model.name_jntadr, "joint")
    index = {name: i for i, name in enumerate(bodies)}
    passed = [*path.up[1:], *path.down[1:]]
    count = sum(int(model.body_jntnum[index[frame]]) for frame in passed if frame in index)
    require_few(count, "moving joints between base and tip", MOST_JOINTS, where)

    def segment(frames: list[str]) -> Segment:
        pose, moving = np.eye(4), list[Joint]()
        links = [(frames[0], Frame(0, pose))]
        for frame in frames[1:]:
            if frame in sites:
                pose = pose @ _pose(model.site_pos[sites[frame]], model.site_quat[sites[frame]])
                links.append((frame, Frame(len(moving), pose)))
                continue
            body = index[frame]
            pose = pose @ _pose(model.body_pos[body], model.body_quat[body])
            first = model.body_jntadr[body]
            for joint in range(first, first + model.body_jntnum[body]):
                moving.append(_moving_joint(model, joint, joints[joint], pose, frame))
                # The joint rotates about a point of the body: translate to it, rotate, and translate back.
                pose = transform(np.eye(3), -model.jnt_pos[joint])
            links.append((frame, Frame(len(moving), pose)))
        return Segment(moving, pose, links)

    moving, end, links = joined(segment(path.up), segment(path.down))
    return serial_chain(
        moving,
        end,
        name=_name(model, called),
        base=path.names[0],
        tip=path.names[-1],
        source=where,
        links=links,
    )


def _compile(path: Path) -> Any:
    mujoco = _import_mujoco()
    from .mjcf_xml import reduced  # xml.sax imports many modules for HTTP.

    model = reduced(path)
    try:
        with warnings.catch_warnings():
            # Warnings about masses and inertias are ignored, since these are placeholders.
            warnings.simplefilter("ignore")
            spec = mujoco.MjSpec.from_string(model.text, include=model.attached)
            # A body without a joint is still a frame that a user may refer to.
            spec.compiler.fusestatic = False
            for body in spec.bodies[1:]:
                # The bodies' masses came from their geoms, which are removed; kinematics does not use masses.
                body.explicitinertial = True
                body.mass, body.inertia, body.fullinertia = 1.0, np.ones(3), np.full(6, np.nan)
            return spec.compile()
    except Exception as error:  # MuJoCo raises plain ValueError and its own FatalError.
        raise_of_handler(error)
        raise InvalidRobot(f"{path}: MuJoCo says: {error}") from None


def _import_mujoco() -> Any:
    """Import MuJoCo away from the working folder, whose files may have come with the robot.

    MuJoCo imports glfw, which on Linux starts Python for each version of its library. That Python would look for modules in
    the working folder first, and so run a file `ctypes.py` there.

    Raises:
        MissingExtra: MuJoCo is not installed.
    """
    with importing:
        before = os.environ.get(_SAFE_PATH)
        try:
            os.environ[_SAFE_PATH] = "1"
            import mujoco
        except ImportError as error:
            raise MissingExtra("reading MJCF", "mjcf") from error
        finally:
            if before is None:
                os.environ.pop(_SAFE_PATH, None)
            else:
                os.environ[_SAFE_PATH] = before
    return mujoco


def _names(model: Any, addresses: Any, noun: str) -> list[str]:
    """Return the names of all elements of a kind; an element without a name is called by its index, made unique."""
    table = bytes(model.names)
    names = [_string(table, int(address)) for address in addresses]
    taken = set(names)
    for i, name in enumerate(names):
        if not name:
            own = f"{noun} {i}"
            while own in taken:
                own = f"{own}'"
            names[i] = own
            taken.add(own)
    return names


def _string(table: bytes, address: int) -> str:
    return table[address : table.index(b"\0", address)].decode(errors="replace")


def _moving_joint(model: Any, joint: int, name: str, body_pose: Array, body: str) -> Joint:
    from mujoco import mjtJoint

    kind = mjtJoint(model.jnt_type[joint])
    if kind not in (mjtJoint.mjJNT_HINGE, mjtJoint.mjJNT_SLIDE):
        what = {mjtJoint.mjJNT_FREE: "free", mjtJoint.mjJNT_BALL: "ball"}[kind]
        raise InvalidRobot(
            f"joint {name!r} is a {what} joint: between base and tip only hinge and slide joints can be "
            f"used. Choose base={body!r} to leave it out"
        )
    axis = model.jnt_axis[joint].copy()
    hinge, limited = kind == mjtJoint.mjJNT_HINGE, bool(model.jnt_limited[joint])
    if not hinge and not limited:
        raise InvalidRobot(f"slide joint {name!r} has no range, but a search needs one")
    ref = float(model.qpos0[model.jnt_qposadr[joint]])
    back = transform(rotation(axis, -ref), np.zeros(3)) if hinge else transform(np.eye(3), -ref * axis)
    lower, upper = (float(bound) for bound in model.jnt_range[joint])
    return Joint(
        name=name,
        kind=PRISMATIC if not hinge else REVOLUTE if limited else CONTINUOUS,
        origin=body_pose @ transform(np.eye(3), model.jnt_pos[joint]) @ back,
        axis=axis,
        lower=lower,
        upper=upper,
    )


def _pose(position: Array, quaternion: Array) -> Array:
    """Return a pose, (4, 4), from a position [m], (3,), and a quaternion (w, x, y, z), (4,)."""
    w, vector = quaternion[0], quaternion[1:]
    sine = float(np.linalg.norm(vector))
    if sine == 0.0:
        return transform(np.eye(3), position)
    return transform(rotation(vector / sine, 2 * float(np.arctan2(sine, w))), position)


def _name(model: Any, called: str) -> str:
    """Return the model's name: the first string of MuJoCo's name table."""
    name = _string(bytes(model.names), 0)
    return name if name and name != "MuJoCo Model" else called
