"""The judge: what pinocchio reads of an arm's file, and where it says the tip goes. No solver here judges itself."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.targets import pose_errors
from kinseek.robots import catalog_entry
from kinseek.robots.catalog import catalog_path

from .protocol import Arm, Array

STRICT = 1e-6
"""Within which an answer counts as exact [m], [rad]."""

LOOSE, LOOSE_TURN = 1e-3, 1e-2
"""Within which an answer counts for a robot at work [m], [rad]: what claims success and is farther off is false."""

SLACK = 1e-6
"""How far outside a limit is rounding, [rad] or [m]: as much as a pose may be off, for some keep limits in 32 bits."""

ARMS = (
    *("ur5e", "panda", "iiwa14", "irb120", "kr6r900", "puma560"),
    *("gen3", "xarm7", "ur10e", "jaco2_6", "ur5", "lite6", "wx250s", "piper", "yumi_left", "rizon4"),
    *("pr2_left", "baxter_left", "mh180", "iiwa14_srs", "ur10e_calibrated", "ur10e_rail", "mpx3500"),
    *("irb5400", "atlas_arm", "atlas_torso_arm", "so101", "m430ia2f", "scara_synth", "planar5"),
)
"""The thirty bundled arms that are measured: a short run takes the first few, the table of the README the first six."""


class Verdict(NamedTuple):
    """What the judge finds of k answers; NaN where there is none."""

    position_error: Array
    """(k,), [m]"""
    orientation_error: Array
    """(k,), [rad]"""
    outside: Array
    """How far the worst joint lies outside its limits, (k,), [rad] or [m]; 0 inside."""


class Judge:
    """One arm by pinocchio."""

    def __init__(self, path: Path, base: str, tip: str) -> None:
        """Read a URDF file; joints that follow others do so as the file says."""
        import pinocchio as pin

        self._pin: Any = pin
        self._model = model = pin.buildModelFromUrdf(str(path))
        self._data = model.createData()
        self._base, self._tip = (model.getFrameId(link, pin.FrameType.BODY) for link in (base, tip))
        parents = [set(model.supports[model.frames[frame].parentJoint]) for frame in (self._base, self._tip)]
        followers = _followers(path)
        between = [model.names[joint] for joint in sorted(parents[1] - parents[0])]
        joints = tuple(name for name in between if name not in followers)
        self._number = {name: model.joints[model.getJointId(name)] for name in between}
        self._leads = {name: followers[name] for name in between if name in followers}
        kinds = tuple(self._kind(name) for name in joints)
        ends = np.array([self._limits(name, kind) for name, kind in zip(joints, kinds, strict=True)]).T
        self._ends = np.where([kind == "continuous" for kind in kinds], [[-np.inf], [np.inf]], ends)
        narrowed = _soft_limits(path)
        soft = np.array([narrowed.get(name, (-np.inf, np.inf)) for name in joints]).T
        ends = np.stack([np.maximum(ends[0], soft[0]), np.minimum(ends[1], soft[1])])
        self._joints = joints
        home = self.fk(np.zeros((1, len(joints))))[0]
        self._stations = np.array([*(self._origin(name) for name in between), home[:3, 3]])
        axes, points = zip(
            *(self._axis(name, kind) for name, kind in zip(joints, kinds, strict=True)), strict=True
        )
        self.arm = Arm(
            *(path.stem, str(path), base, tip, joints, kinds),
            *(ends[0], ends[1], np.array(axes), np.array(points), home, bool(self._leads)),
        )

    def fk(self, q: Array) -> Array:
        """Poses of the tip in the base, (k, n) -> (k, 4, 4)."""
        poses = np.empty((len(q), 4, 4))
        for row, values in enumerate(q):
            self._place(values)
            poses[row] = self._data.oMf[self._base].actInv(self._data.oMf[self._tip]).homogeneous
        return poses

    def judge(self, q: Array, targets: Array) -> Verdict:
        """Compare answers, (k, n), with targets, (k, 4, 4)."""
        nothing = ~np.asarray(np.isfinite(q).all(axis=1))
        poses = self.fk(np.where(nothing[:, None], 0.0, q))
        away, angle = pose_errors(poses, targets)
        outside = np.maximum(self._ends[0] - q, q - self._ends[1]).max(axis=1, initial=0.0)
        return Verdict(*(np.where(nothing, np.nan, each) for each in (away, angle, outside)))

    def least_singular(self, q: Array) -> Array:
        """Least singular value of the Jacobian, lengths taken in parts of the reach, (k, n) -> (k,)."""
        values = np.empty(len(q))
        for row, each in enumerate(q):
            J = self._jacobian(each)
            values[row] = np.linalg.svd(J / np.repeat([self.reach, 1.0], 3)[:, None], compute_uv=False)[-1]
        return values

    @cached_property
    def reach(self) -> float:
        """No less than what the tip can be away from the base [m]: all links in a row, all slides drawn out."""
        stations = np.vstack([np.zeros(3), self._stations])
        slides = np.array([kind == "prismatic" for kind in self.arm.kinds])
        drawn = np.maximum(np.abs(self.arm.lower), np.abs(self.arm.upper))[slides].sum()
        return float(np.linalg.norm(np.diff(stations, axis=0), axis=1).sum() + drawn)

    def _place(self, values: Array) -> None:
        led = dict(zip(self._joints, values, strict=True))
        for name, (leader, factor, offset) in self._leads.items():
            led[name] = factor * led[leader] + offset
        full = self._pin.neutral(self._model)
        for name, value in led.items():
            joint = self._number[name]
            full[joint.idx_q : joint.idx_q + joint.nq] = (
                [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            )
        self._pin.framesForwardKinematics(self._model, self._data, full)
        self._full = full

    def _jacobian(self, values: Array) -> Array:
        self._place(values)
        frame = self._pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        J = self._pin.computeFrameJacobian(self._model, self._data, self._full, self._tip, frame)
        return np.stack([J[:, self._number[name].idx_v] for name in self._joints], axis=1)

    def _kind(self, name: str) -> str:
        joint = self._number[name]
        if joint.nq == 2:
            return "continuous"
        return "prismatic" if joint.shortname().startswith("JointModelP") else "revolute"

    def _limits(self, name: str, kind: str) -> tuple[float, float]:
        if kind == "continuous":
            return -np.pi, np.pi
        index, model = self._number[name].idx_q, self._model
        return float(model.lowerPositionLimit[index]), float(model.upperPositionLimit[index])

    def _axis(self, name: str, kind: str) -> tuple[Array, Array]:
        """Axis and a point on it in the base; the joints stand where `_place` has put them last."""
        pin, data = self._pin, self._data
        J = pin.computeJointJacobians(self._model, data, self._full)[:, self._number[name].idx_v]
        root = data.oMf[self._base]
        axis = root.rotation.T @ (J[:3] if kind == "prismatic" else J[3:])
        return axis, self._origin(name)

    def _origin(self, name: str) -> Array:
        """Where a joint is in the base, as the joints stand, (3,), [m]."""
        place: Array = (
            self._data.oMf[self._base].actInv(self._data.oMi[self._model.getJointId(name)]).translation
        )
        return place


def _followers(path: Path) -> dict[str, tuple[str, float, float]]:
    """Joints that follow: leader, factor, offset. Pinocchio takes them for joints of their own, as most do."""
    found = {}
    for joint in ElementTree.parse(path).getroot().iter("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            factor, offset = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
            found[joint.get("name", "")] = mimic.get("joint", ""), factor, offset
    return found


def _soft_limits(path: Path) -> dict[str, tuple[float, float]]:
    """Soft limits of joints. MoveIt and kinseek keep them, other solvers do not, so targets lie within them."""
    found = {}
    for joint in ElementTree.parse(path).getroot().iter("joint"):
        safety = joint.find("safety_controller")
        if safety is not None:
            lower, upper = (float(safety.get(f"soft_{end}_limit", "0")) for end in ("lower", "upper"))
            found[joint.get("name", "")] = (lower, upper) if lower < upper else (-np.inf, np.inf)
    return found


def bundled(name: str) -> Judge:
    """The judge of a bundled arm."""
    entry = catalog_entry(name)
    return Judge(catalog_path(name), entry.base, entry.tip)


def good(verdict: Verdict, place: float, turn: float) -> NDArray[np.bool_]:
    """Which answers are within some errors, and inside the limits but for rounding, (k,)."""
    inside = verdict.outside <= SLACK
    return np.asarray(inside & (verdict.position_error <= place) & (verdict.orientation_error <= turn))
