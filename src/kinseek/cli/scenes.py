"""``--scene`` and its options: the collision scene from files."""

from __future__ import annotations

from typing import Literal, NamedTuple

import click

from kinseek.arm import Arm
from kinseek.collision import Scene
from kinseek.collision.pairs import NOTHING_CHECKED
from kinseek.errors import InvalidProblem, InvalidScene

from .help import bundle, option
from .options import Robot
from .output import complain

SELF, SKIP = "self", "skip"
"""Words in place of a file: the arm alone; and in place of a folder: leave out meshes that are not found."""

GROUP = "Collisions"

MOST_NOTES = 5
"""Maximum number of notes on a scene that are printed."""

_OPTIONS = {
    "capsules=": "--capsules 0.05",
    "meshes=": "--meshes FOLDER",
    'missing="skip"': f"--meshes {SKIP}",
    "prefix=": "name the bodies of one of the files otherwise",
}
"""Terms of Python in messages, and their equivalents on the command line."""


class Cell(NamedTuple):
    """The options of a command line about the collision scene."""

    scene: tuple[str, ...]
    clearance: float
    """Minimum distance of bodies [m]."""
    capsules: float | None
    """Radius of capsules that replace links [m]."""
    meshes: tuple[str, ...]

    def of(self, arm: Arm, robot: Robot) -> Scene | None:
        """Make the scene of an arm, which was loaded from `robot`, and print its notes; None if no scene is requested.

        Raises:
            InvalidProblem: Options without --scene.
            KinseekError: As `Scene.of` and `Scene.add_file`.
        """
        if not self.scene:
            given = {"--clearance": self.clearance, "--capsules": self.capsules}
            for name, value in (given | {"--meshes": self.meshes}).items():
                if value:
                    raise InvalidProblem(
                        f"{name} needs a scene; add --scene FILE, or --scene {SELF} for the arm alone"
                    )
            return None
        folders = [folder for folder in self.meshes if folder != SKIP]
        missing: Literal["error", "skip"] = "skip" if SKIP in self.meshes else "error"
        try:
            scene = Scene.of(arm, folders, capsules=self.capsules, missing=missing)
            for name in self.scene:
                if name != SELF:
                    scene.add_file(name, meshes=folders, missing=missing, trusted=not robot.untrusted)
        except InvalidScene as error:
            said = [option for word, option in _OPTIONS.items() if word in str(error)]
            if not said:
                raise
            raise InvalidScene(f"{error}; on a command line {', '.join(said)}") from error
        # Who gives --capsules knows of them.
        notes = [note for note in scene.notes if note != NOTHING_CHECKED and not note.startswith("capsules ")]
        for note in notes[:MOST_NOTES]:
            complain(f"note: {note}")
        if len(notes) > MOST_NOTES:
            complain(f"note: {len(notes) - MOST_NOTES:,} more are in scene.notes of Python")
        if not scene.checks:
            complain(f"warning: {NOTHING_CHECKED}")
        return scene


scene_options = bundle(
    "cell",
    Cell,
    option(
        "--scene",
        metavar="FILE",
        type=click.Path(),
        multiple=True,
        group=GROUP,
        help="Obstacles in the frame of the arm's base: a .urdf or .xacro file with fixed joints, or a .scene file of "
        f"MoveIt; repeat it for each. {SELF}: only collisions of the arm with itself.",
    ),
    option(
        "--clearance",
        metavar="M",
        type=float,
        default=0.0,
        group=GROUP,
        help="Minimum distance of bodies, m.",
    ),
    option(
        "--capsules",
        metavar="M",
        type=float,
        group=GROUP,
        help="Radius of capsules that replace links, if the arm's file has no geometry, m.",
    ),
    option(
        "--meshes",
        metavar="FOLDER",
        type=click.Path(),
        multiple=True,
        group=GROUP,
        help=f"Folder of packages for package:// addresses; repeat it for each. {SKIP}: skip meshes that are not found.",
    ),
)
