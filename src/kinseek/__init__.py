"""Inverse kinematics of serial robot arms by search.

>>> import kinseek
>>> arm = kinseek.load("panda")
>>> target = kinseek.pose([0.4, 0.1, 0.5], rpy=[3.14, 0.0, 0.0])
>>> solution = arm.ik(target)
>>> solution.q, solution.success, solution.position_error  # doctest: +SKIP
"""

from .arm import Arm, load
from .branches.result import Branches, BranchesBatch
from .collision import Scene
from .errors import (
    FailedKinematics,
    InvalidExport,
    InvalidGoal,
    InvalidMap,
    InvalidProblem,
    InvalidRobot,
    InvalidScene,
    InvalidSolver,
    InvalidUse,
    KinseekError,
    MapInterrupted,
    MissingExtra,
    NotReached,
    PathInterrupted,
    RepairWarning,
    UnitWarning,
)
from .goal import Goal
from .paths.path import Path, PathStatus
from .paths.tracker import TrackStatus
from .poses import pose
from .problem import Problem
from .proof.certificate import Certificate, Verdict
from .solution import Solution, Status
from .solvers import (
    ALL_SOLVERS,
    Atlas,
    BlindSearch,
    BruteForce,
    CoordinateDescent,
    DivideAndConquer,
    Polished,
    SeparateChains,
    Solver,
)
from .trace import Trace

__version__ = "0.1.0"

__all__ = [
    "ALL_SOLVERS",
    "Arm",
    "Atlas",
    "BlindSearch",
    "Branches",
    "BranchesBatch",
    "BruteForce",
    "Certificate",
    "CoordinateDescent",
    "DivideAndConquer",
    "FailedKinematics",
    "Goal",
    "InvalidExport",
    "InvalidGoal",
    "InvalidMap",
    "InvalidProblem",
    "InvalidRobot",
    "InvalidScene",
    "InvalidSolver",
    "InvalidUse",
    "KinseekError",
    "MapInterrupted",
    "MissingExtra",
    "NotReached",
    "Path",
    "PathInterrupted",
    "PathStatus",
    "Polished",
    "Problem",
    "RepairWarning",
    "Scene",
    "SeparateChains",
    "Solution",
    "Solver",
    "Status",
    "Trace",
    "TrackStatus",
    "UnitWarning",
    "Verdict",
    "load",
    "pose",
]
