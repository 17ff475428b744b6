"""Read a serial arm from a model of the pinocchio library.

Bodies and operational frames are the frames; a body takes precedence over a frame of the same name. A model that was built
joint by joint may have no bodies: a joint without a frame of its own is then a frame.

Joint values are one number per joint, as in all of kinseek. pinocchio uses the same values, except for a continuous joint,
where it uses a cosine and a sine.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kinseek.errors import InvalidRobot

from .chain import Array, Frame, SerialChain
from .files import MOST_JOINTS, require_few
from .joints import Joint, Segment, joined, serial_chain
from .mechanism import CONTINUOUS, PRISMATIC, REVOLUTE
from .tree import frame_path

_UNLIMITED = 1e30
"""Limit that counts as none: pinocchio uses the largest float for a joint without limits."""


def read_pinocchio(model: Any, base: str | None = None, tip: str | None = None) -> SerialChain:
    """Read the arm between two frames of a ``pinocchio.Model``.

    Args:
        model: The model.
        base: Name of the base frame; the default is the root.
        tip: Name of the frame whose pose is computed; the default is the only body without another body distal to it.

    Raises:
        InvalidRobot: A frame is unknown or not connected, or a joint between base and tip is neither revolute nor prismatic.
    """
    if model.njoints < 2:  # The universe counts as one.
        raise InvalidRobot("the pinocchio model has no joints")
    parents, places, ends = _frames(model)
    carried = {name: str(model.names[joint]) for name, (joint, _) in places.items()}
    moved = {name for name, above in parents.items() if above is not None and carried[name] != carried[above]}
    path = frame_path(parents, base, tip, ends=ends, noun="frame", moving=moved)
    ways = [_joints_to(model, places[frames[-1]][0]) for frames in path]
    shared = sum(1 for one, other in zip(*ways, strict=False) if one == other)
    """Number of joints that carry both the base and the tip."""
    count = sum(len(way) - shared for way in ways)
    require_few(count, "moving joints between base and tip", MOST_JOINTS, "the pinocchio model")

    def segment(way: list[int], frames: list[str]) -> Segment:
        number = {joint: i for i, joint in enumerate(way[shared - 1 :])}
        joints = [
            _moving_joint(model, joint, model.jointPlacements[joint].homogeneous) for joint in way[shared:]
        ]
        links = [
            (name, Frame(number[joint], pose))
            for name, (joint, pose) in ((name, places[name]) for name in frames)
            if joint in number
        ]
        return Segment(joints, places[frames[-1]][1], links)

    moving, end, links = joined(*map(segment, ways, path))
    return serial_chain(
        moving,
        end,
        name=str(model.name) or "robot",
        base=path.names[0],
        tip=path.names[-1],
        source="the pinocchio model",
        links=links,
    )


def _joints_to(model: Any, joint: int) -> list[int]:
    """Return the numbers of the joints that carry what a joint moves, from the root, which counts as joint 0."""
    way = [joint]
    while way[-1]:
        way.append(int(model.parents[way[-1]]))
    return way[::-1]


def _frames(model: Any) -> tuple[dict[str, str | None], dict[str, tuple[int, Array]], set[str]]:
    """Return for each frame its parent, and its joint and its pose in that joint's frame; and the frames at the ends."""
    frames, joints = list(model.frames), [str(name) for name in model.names]
    root = str(frames[0].name)
    names = {0: root}
    for kind in ("BODY", "OP_FRAME"):
        for i, frame in enumerate(frames):
            if str(frame.type) == kind and frame.name not in names.values():
                names[i] = str(frame.name)
    places = {
        name: (int(frames[i].parentJoint), frames[i].placement.homogeneous) for i, name in names.items()
    }
    drawn = {str(frame.name) for frame in frames if str(frame.type) == "JOINT"}
    bare = {i: name for i, name in enumerate(joints) if i and name not in drawn and name not in places}
    places |= {name: (i, np.eye(4)) for i, name in bare.items()}

    def above(i: int) -> str:
        joint = int(frames[i].parentJoint)
        while i := int(frames[i].parentFrame):
            if i in names:
                return names[i]
        return bare.get(joint, root)

    parents: dict[str, str | None] = {root: None}
    parents |= {name: above(i) for i, name in names.items() if i}
    parents |= {name: bare.get(int(model.parents[i]), root) for i, name in bare.items()}
    top = [name for name, parent in parents.items() if parent == root]
    if (
        len(top) == 1 and places[top[0]][0] == 0
    ):  # The root link of a robot, and nothing else, is attached to the universe.
        del parents[root]
        parents[top[0]] = None
    solid = {name for i, name in names.items() if str(frames[i].type) == "BODY"} | set(bare.values())
    return parents, places, solid - {parents[name] for name in solid if name in parents}


def _moving_joint(model: Any, joint: int, origin: Array) -> Joint:
    kind, name = model.joints[joint], str(model.names[joint])
    follows, subspace = str(kind.shortname()) == "JointModelMimic", np.zeros((6, 0))
    if kind.nv == 1 or follows:
        # Kinds of joints store their axis in different ways; the subspace of the motion has it for all of them.
        data = kind.createData()
        kind.calc(data, _start(model))
        subspace = np.asarray(data.S).reshape(6, -1)
    slide, turn = subspace[:3], subspace[3:]
    if subspace.shape[1] != 1 or slide.any() == turn.any():
        raise InvalidRobot(
            f"joint {name!r} is a {kind.shortname()}: between base and tip only joints that turn about an axis or slide "
            f"along one can be used. Choose base= to leave it out"
        )
    axis = (slide if slide.any() else turn)[:, 0]
    if follows:
        law = kind.extract()
        if not law.scaling:
            raise InvalidRobot(
                f"joint {name!r} mimics another with multiplier 0: it does not move, and should be fixed"
            )
        leader = next(i for i, other in enumerate(model.joints) if other.nq and other.idx_q == kind.idx_q)
        return Joint(
            name,
            PRISMATIC if slide.any() else REVOLUTE,
            origin,
            # The subspace of a mimic joint contains the factor already.
            axis / law.scaling,
            -np.inf,
            np.inf,
            str(model.names[leader]),
            float(law.scaling),
            float(law.offset),
        )
    lower, upper = -np.inf, np.inf
    if kind.nq == 1:
        lower = float(model.lowerPositionLimit[kind.idx_q])
        upper = float(model.upperPositionLimit[kind.idx_q])
    fastest = float(model.velocityLimit[kind.idx_v])
    velocity = fastest if 0 < fastest < _UNLIMITED else np.nan
    endless = min(-lower, upper) >= _UNLIMITED
    moves = PRISMATIC if slide.any() else CONTINUOUS if endless else REVOLUTE
    return Joint(name, moves, origin, axis, lower, upper, rates=(velocity, np.nan, np.nan))


def _start(model: Any) -> Array:
    """Return the model's configuration with every joint at 0; a continuous joint has a cosine of 1 and a sine of 0."""
    q = np.zeros(model.nq)
    for kind in model.joints:
        if kind.nq == 2:
            q[kind.idx_q] = 1.0
    return q
