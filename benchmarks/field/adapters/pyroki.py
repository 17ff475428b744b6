"""PyRoki: Levenberg and Marquardt's method on the pose and soft limits, compiled by JAX for the processor.

https://github.com/chungmin99/pyroki, examples/01_basic_ik.py: weights 50 and 10 of the pose, 100 of the limits, dense
Cholesky, numbers of 32 bits, from the middle of the ranges. It tells nothing of success. In the sweep 64 bits, and many
starts at once of which the best is kept, as its own benchmark does (benchmark/ik_benchmark.py). Compiled when it is made,
which takes seconds.
"""

from __future__ import annotations

import os
from functools import lru_cache
from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Refused, without_followers

NAME = "PyRoki"
PACKAGE = "pyroki"
RECOMMENDED: dict[str, Any] = {"starts": 1, "bits": 32}
SWEEP: tuple[dict[str, Any], ...] = ({"starts": 1, "bits": 64}, {"starts": 64, "bits": 64})

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.environ["JAX_PLATFORMS"] = "cpu"


class _Solver:
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        without_followers(arm)
        self._bits = settings["bits"]
        joints, self._search = _compiled(arm.urdf, arm.base, arm.tip, self._bits)
        if len(joints) != len(arm.joints):
            raise Refused(f"reads {len(joints)} joints of {len(arm.joints)}")
        self._places = [joints.index(name) for name in arm.joints]
        others = np.random.default_rng(0).uniform(
            arm.lower, arm.upper, (settings["starts"] - 1, len(arm.joints))
        )
        self._starts = self._theirs(np.vstack([arm.middle, others]))
        self.solve(arm.home, None)

    def _theirs(self, q: Any) -> Any:
        moved = np.empty(np.shape(q))
        moved[..., self._places] = q
        return moved

    def solve(self, T: Any, start: Any) -> Answer:
        starts = self._starts
        if start is not None:
            starts = np.concatenate([self._theirs(np.asarray(start, dtype=float))[None], starts[1:]])
        with _precision(self._bits):
            q = np.asarray(self._search(np.asarray(T, dtype=float), starts), dtype=float)
        return Answer(q[self._places], None)


def _precision(bits: int) -> Any:
    import jax

    return jax.enable_x64(bits == 64)


@lru_cache(maxsize=4)
def _compiled(urdf: str, base: str, tip: str, bits: int) -> tuple[list[str], Any]:
    """Names of joints, and the search, compiled when it is first called, which takes seconds, and then kept as JAX does."""
    import jax
    import yourdfpy
    from pyroki import Robot

    with _precision(bits):
        robot = Robot.from_urdf(yourdfpy.URDF.load(urdf, load_meshes=False))
        names = robot.links.names
        if (
            np.abs(
                robot.forward_kinematics(np.zeros(robot.joints.num_actuated_joints))[names.index(base), 1:]
            ).max()
            > 1e-6
        ):
            raise Refused("the base is not the root of its file")
        return list(robot.joints.actuated_names), jax.jit(_search(robot, names.index(tip)))


def _search(robot: Any, tip: int) -> Any:
    """From a pose and starts, (k, n), to the joint values with the least cost, (n,)."""
    import jax
    import jax.numpy as jnp
    import jaxlie
    import jaxls
    from pyroki import costs

    def search(T: Any, starts: Any) -> Any:
        var = robot.joint_var_cls(0)
        pose = jaxlie.SE3.from_matrix(T)
        terms = [
            costs.pose_cost_analytic_jac(robot, var, pose, jnp.int32(tip), pos_weight=50.0, ori_weight=10.0),
            costs.limit_cost(robot, var, weight=100.0),
        ]
        problem = jaxls.LeastSquaresProblem(terms, [var]).analyze()

        def one(start: Any) -> Any:
            found, summary = problem.solve(
                initial_vals=jaxls.VarValues.make([var.with_value(start)]),
                verbose=False,
                linear_solver="dense_cholesky",
                trust_region=jaxls.TrustRegionConfig(lambda_initial=1.0),
                return_summary=True,
            )
            return found[var], summary.cost_history[summary.iterations]

        q, cost = jax.vmap(one)(starts)
        return q[jnp.argmin(cost)]

    return search


load = _Solver
