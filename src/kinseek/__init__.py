"""Inverse kinematics of serial robot arms, in closed form and by search.

>>> import kinseek
>>> arm = kinseek.load("panda")
>>> target = kinseek.pose([0.4, 0.1, 0.5], rpy=[3.14, 0.0, 0.0])
>>> solution = arm.ik(target)
>>> solution.q, solution.success, solution.position_error  # doctest: +SKIP
"""

import typing

from .arm import Arm, load
from .errors import (
    FailedKinematics,
    InternalError,
    InvalidExport,
    InvalidGoal,
    InvalidMap,
    InvalidProblem,
    InvalidRobot,
    InvalidScene,
    InvalidSolver,
    InvalidUse,
    KinseekError,
    LimitWarning,
    MapInterrupted,
    MissingExtra,
    NotReached,
    PathInterrupted,
    RepairWarning,
    UnitWarning,
)
from .goal import Goal
from .interpolation import arc, interpolate
from .pose_arguments import pose
from .problem import Problem
from .proof.certificate import Certificate, Verdict
from .solution import Solution, Status
from .solvers import MODULES as _SEARCHES
from .solvers.atlas.solver import Atlas
from .solvers.base import Solver
from .support.lazy_imports import lazy_names as _lazy_names
from .trace import Trace

if typing.TYPE_CHECKING:
    from .branches.result import Branches, BranchesBatch
    from .collision import Scene
    from .paths.path import Path, PathStatus
    from .paths.tracker import TrackStatus
    from .solvers.blind_search import BlindSearch
    from .solvers.brute_force import BruteForce
    from .solvers.coordinate_descent import CoordinateDescent
    from .solvers.divide_and_conquer import DivideAndConquer
    from .solvers.every import ALL_SOLVERS
    from .solvers.polished import Polished
    from .solvers.separate_chains import SeparateChains
    from .timing.trajectory import Trajectory

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
    "InternalError",
    "InvalidExport",
    "InvalidGoal",
    "InvalidMap",
    "InvalidProblem",
    "InvalidRobot",
    "InvalidScene",
    "InvalidSolver",
    "InvalidUse",
    "KinseekError",
    "LimitWarning",
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
    "Trajectory",
    "UnitWarning",
    "Verdict",
    "arc",
    "interpolate",
    "load",
    "pose",
]

__getattr__, __dir__ = _lazy_names(
    globals(),
    {
        "ALL_SOLVERS": ".solvers.every",
        "Branches": ".branches.result",
        "BranchesBatch": ".branches.result",
        "Path": ".paths.path",
        "PathStatus": ".paths.path",
        "Scene": ".collision",
        "TrackStatus": ".paths.tracker",
        "Trajectory": ".timing.trajectory",
        "branches": ".branches",
        "collision": ".collision",
        "maps": ".maps",
        "paths": ".paths",
        "plots": ".plots",
        "viewer": ".viewer",
        **{name: f".solvers{module}" for name, module in _SEARCHES.items()},
    },
)
