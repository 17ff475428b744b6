"""Other arms in a scene: obstacles at joint values of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import forward_many
from kinseek.robots.chain import Frame, SerialChain

from .bodies import Body

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OtherArm:
    """An arm that is an obstacle in the scene of another one."""

    name: str
    chain: SerialChain
    base: Array
    """Pose of its base in the base of the scene's arm, (4, 4)."""
    bodies: list[Body]
    """Its bodies in its own scene."""

    @property
    def names(self) -> list[str]:
        """Names of its bodies in the other scene."""
        return [f"{self.name}/{body.name}" for body in self.bodies]

    def at(self, q: Array) -> list[Body]:
        """Return its bodies in the other scene at q, (m,)."""
        carrying = {body.frame.joints for body in self.bodies}
        poses = {
            k: self.base @ forward_many(self.chain.arrays_to(Frame(k, np.eye(4))), q[None])[0]
            for k in carrying
        }
        return [
            replace(
                body,
                name=name,
                frame=Frame(0, poses[body.frame.joints] @ body.frame.pose),
                is_link=False,
                is_attached=False,
            )
            for name, body in zip(self.names, self.bodies, strict=True)
        ]
