"""The panel beside the 3D view: the solution on top, below it the goal, the search, the scene and what is seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinseek.collision import Box
from kinseek.collision.surfaces import DrawnBody
from kinseek.errors import KinseekError
from kinseek.pose_arguments import pose
from kinseek.poses import rpy_of
from kinseek.printable import printable
from kinseek.ranges import AXES
from kinseek.timing.trajectory import Trajectory

from .meshes import Meshes
from .options import CHOSEN, COUNTS, ViewerOptions
from .searches import HINTS, PARAMETERS, SEARCHES, TREES, parameters_of
from .words import joints_html, note_html, refused_html

if TYPE_CHECKING:
    from .page import Page

Array = NDArray[np.float64]

SERVO_LIMITS = {
    "acceleration": ("Acceleration [rad/s²]", 40.0, 10.0),
    "jerk": ("Jerk [rad/s³]", 2000.0, 500.0),
}
"""Limits of a tracker that can be set: label, greatest and first value. For prismatic joints, read m for rad."""

NOTHING = "none"
"""Choice of no body."""

MOST_LABEL = 100
"""Maximum length of the name of a body in a list: a page may send a text of twice as many characters."""

MOMENTS = 200
"""Number of times at least that the slider of a motion can show."""


class Panel:
    """One person's panel; `gui` is that of their connection alone."""

    def __init__(
        self,
        gui: Any,
        page: Page,
        meshes: Meshes,
    ) -> None:
        """Lay out the panel of a page."""
        self._gui, self._arm, self._do, options = gui, page.arm, page, page.options
        self.result = gui.add_html("")
        self.hits = gui.add_html("")
        self.branches = gui.add_html("")
        step = gui.add_button_group("Branch", ("previous", "next"))
        self._on(step, lambda value: page.step_branch(-1 if value == "previous" else 1), click=True)
        self.joints = gui.add_html(joints_html(page.arm, options.q))
        self._motion()
        tabs = gui.add_tab_group()
        with tabs.add_tab("Goal"):
            self._goal(options)
        with tabs.add_tab("Search"):
            self._search(options)
        with tabs.add_tab("Servo"):
            self._servo()
        if page.scene is not None:
            with tabs.add_tab("Scene"):
                self._scene()
        with tabs.add_tab("See"):
            self._see(options, meshes)

    def _motion(self) -> None:
        self.time = self._gui.add_slider("Time [s]", 0.0, 1.0, 1.0, 0.0, visible=False)
        self._on(self.time, lambda t: self._do.choose_time(float(t)))
        self.playing = self._gui.add_button_group("Motion", ("play", "stop"), visible=False)
        self._on(self.playing, lambda value: self._do.play_motion(value == "play"), click=True)
        self.motion = self._gui.add_html("")
        self.plan = self._gui.add_html("")

    def show_motion(self, motion: Trajectory | None) -> None:
        """Offer to play a motion, if there is one."""
        self.time.visible = self.playing.visible = motion is not None
        self.motion.content = ""
        if motion is not None:
            step = 10.0 ** np.floor(np.log10(motion.duration / MOMENTS))
            self.time.step, self.time.max = step, step * np.ceil(motion.duration / step)
            self.time.precision = max(0, -int(np.log10(step)))
            self.time.value = 0.0

    def _goal(self, options: ViewerOptions) -> None:
        gui, page, change = self._gui, self._do, self._do.change
        self.counts = gui.add_dropdown(
            "Counts", (*COUNTS, CHOSEN), initial_value=options.counts, hint="What of the goal must be met."
        )
        self._on(self.counts, lambda name: change(free=COUNTS[name]) if name in COUNTS else None)
        with gui.add_folder("Free axes of the goal", expand_by_default=False):
            self.free = {
                axis: gui.add_checkbox(
                    axis, axis in options.free, hint=f"Any deviation {about} its {axis[-1]} axis will do."
                )
                for axis, about in zip(AXES, ["along"] * 3 + ["about"] * 3, strict=True)
            }
        for box in self.free.values():
            self._on(box, lambda _: change(free=[axis for axis, each in self.free.items() if each.value]))
        self.place = gui.add_vector3("Position [m]", (0.0, 0.0, 0.0), step=0.001)
        self.turn = gui.add_vector3("Roll, pitch, yaw [°]", (0.0, 0.0, 0.0), step=0.1)
        self.show_target(options)
        for each in (self.place, self.turn):
            self._on(each, lambda _: self._type_goal())
        self.follow = gui.add_checkbox(
            "Stay near the arm", options.follow, hint="near=q: a drag stays on its branch where it can."
        )
        self._on(self.follow, lambda value: change(follow=value))
        to_arm, another = (
            gui.add_button("Goal to the tip of the arm"),
            gui.add_button("Another reachable goal"),
        )
        self._on(to_arm, lambda _: page.edit(page.goal_to_arm, "goal"), click=True)
        self._on(another, lambda _: page.edit(page.another_goal, "goal"), click=True)
        self.call = gui.add_html("")

    def _search(self, options: ViewerOptions) -> None:
        gui, do = self._gui, self._do
        self.search = gui.add_dropdown("Search", tuple(SEARCHES), initial_value=options.search)
        self._on(self.search, lambda name: do.change(search=name))
        own = options.parameters or parameters_of(options.search)
        self.parameters: dict[str, Any] = {}
        for name, label in PARAMETERS.items():
            shown, value = name in own, own.get(name, "")
            self.parameters[name] = (
                gui.add_dropdown(
                    label, TREES, initial_value=value or TREES[0], hint=HINTS[name], visible=shown
                )
                if name == "tree"
                else gui.add_text(label, value, hint=HINTS[name], visible=shown)
            )
            self._on(self.parameters[name], lambda _: do.change(parameters=self._parameters()))
        self.passes = gui.add_checkbox(
            "Pass by pass", False, hint="Where each pass of the search looked, and the best it knew after it."
        )
        self._on(self.passes, do.show_passes)
        self.number = gui.add_slider("Pass", 1, 2, 1, 1, visible=False)
        self._on(self.number, lambda value: do.choose_pass(int(value) - 1))
        self.stepping = gui.add_button_group("Passes", ("back", "step", "play"), visible=False)
        self._on(self.stepping, self._stepped, click=True)
        self.pass_text = gui.add_html("")

    def _stepped(self, value: str) -> None:
        if value == "play":
            self._do.play_passes()
            return
        self._do.choose_pass(int(self.number.value) - 1 + (1 if value == "step" else -1))

    def _parameters(self) -> dict[str, str]:
        return {name: str(each.value) for name, each in self.parameters.items() if each.visible}

    def _servo(self) -> None:
        gui = self._gui
        self.servo = gui.add_checkbox(
            "The goal drives the arm",
            False,
            hint="arm.track follows the goal in real time, within limits of the joints.",
            disabled=self._arm.axes is None,
        )
        self._on(self.servo, lambda on: self._do.servo(bool(on)))
        self.limits = {name: first for name, (_, _, first) in SERVO_LIMITS.items()}
        """Limits of a tracker, as `Session.track` takes them; sliders may have an unchecked value from a page."""
        for name, (label, most, first) in SERVO_LIMITS.items():
            slider = gui.add_slider(label, most / 40, most, most / 40, first)
            self._on(slider, partial(self._choose_limit, name))
        self.shares = gui.add_html("")

    def _choose_limit(self, name: str, value: float) -> None:
        self.limits[name] = float(value)
        self._do.change_limits()

    def _scene(self) -> None:
        gui, page = self._gui, self._do
        self.body = gui.add_dropdown(
            "Body", (NOTHING,), hint="What is moved and resized; a click on it selects it too."
        )
        self._labels: dict[str, str] = {}
        """Names of bodies by their labels."""
        self._on(self.body, lambda label: page.edit(partial(page.select_body, self._labels.get(label, ""))))
        edit = gui.add_button_group("Edit", ("add a box", "remove"))
        edits = {"add a box": page.add_box, "remove": page.remove_body}
        self._on(edit, lambda value: page.edit(edits[value]), click=True)
        self.box_size = gui.add_vector3("Size [m]", (1.0, 1.0, 1.0), step=0.01, visible=False)
        self.body_place = gui.add_vector3("Position [m]", (0.0, 0.0, 0.0), step=0.01, visible=False)
        self.body_turn = gui.add_vector3("Roll, pitch, yaw [°]", (0.0, 0.0, 0.0), step=0.1, visible=False)
        self._on(self.box_size, lambda size: page.edit(partial(page.resize_box, size), "size"))
        for each in (self.body_place, self.body_turn):
            self._on(each, lambda _: self._place_body())
        self.changes = gui.add_html("")
        plan = gui.add_checkbox(
            "Plan a motion",
            False,
            hint="scene.plan: from where the arm is now, around the bodies, to every new goal.",
        )
        self._on(plan, lambda on: page.plan(bool(on)))
        self._on(gui.add_button("Start where the arm is"), lambda _: page.start_here(), click=True)

    def _place_body(self) -> None:
        pose = _pose_of(self.body_place.value, self.body_turn.value)
        self._do.edit(partial(self._do.place_body, pose), "place")

    def show_bodies(self, names: Sequence[str], selected: DrawnBody | None) -> None:
        """Offer these bodies to be edited, and show the measures of the one that is."""
        if self._do.scene is None:
            return
        if list(names) != list(self._labels.values()):
            self._labels = {}
            for name in names:
                label = printable(name)[:MOST_LABEL]
                there = label == NOTHING or label in self._labels
                self._labels[f"{label} ({len(self._labels)})" if there else label] = name
            self.body.options = (NOTHING, *self._labels)
        chosen = "" if selected is None else selected.name
        self.body.value = next((label for label, name in self._labels.items() if name == chosen), NOTHING)
        self.body_place.visible = self.body_turn.visible = selected is not None
        self.box_size.visible = selected is not None and selected.is_box
        if selected is None:
            return
        _show_pose(self.body_place, self.body_turn, selected.frame.pose)
        if selected.is_box:
            shape = selected.parts[0].shape
            assert isinstance(shape, Box)
            self.box_size.value = tuple(round(float(v), 6) for v in np.asarray(shape.size))

    def _see(self, options: ViewerOptions, meshes: Meshes) -> None:
        gui, axes, missing = self._gui, self._arm.axes is not None, meshes.report()
        self.see = {
            name: gui.add_checkbox(label, getattr(options, name), hint=hint, disabled=not there)
            for name, label, hint, there in (
                ("ghosts", "Every branch", "All solutions, transparent; click one to select it.", axes),
                (
                    "samples",
                    "Atlas's samples",
                    "Tips of the samples nearest to the goal; pale ones lean away.",
                    True,
                ),
                (
                    "reach",
                    "Reachable like this",
                    "Places that the tip reaches in the goal's orientation.",
                    True,
                ),
                (
                    "boxes",
                    "A proof's boxes",
                    "Out of reach: tips of the middles of the boxes that are left.",
                    axes,
                ),
                ("swept", "Swept way", "Postures along a motion.", axes),
                ("meshes", "Meshes", "Draw the arm by the meshes of its file.", bool(meshes.links)),
                ("dark", "Dark", "", True),
            )
        }
        for name, box in self.see.items():
            self._on(box, self._setter(name))
        self.examined = gui.add_slider("Boxes examined", 1, 7, 1, 4, visible=False)
        self.boxes_choice = int(self.examined.value)
        """Index into the numbers of boxes. It is kept because `examined` may have an unchecked value from a page."""
        self._on(self.examined, self._choose_boxes)
        self.progress = gui.add_progress_bar(0.0, visible=False)
        self.seen = gui.add_html("")
        notes = (
            []
            if axes
            else [
                "This arm has black-box kinematics: the positions of its links are unknown. Only its tip is shown, "
                "and nothing can be proved."
            ]
        )
        if boxed := self._do.view.bodies.boxed:
            notes.append(
                f"Their meshes have too many triangles, and are drawn as boxes: {', '.join(boxed[:5])}."
            )
        if notes or missing:
            gui.add_html(note_html(*notes, *missing))

    def _type_goal(self) -> None:
        place, turn = (
            self.place.value,
            self.turn.value,
        )  # Now: the page may show other numbers before it reads them.
        self._do.edit(lambda: self._do.change(target=_pose_of(place, turn)), "goal")

    def _choose_boxes(self, value: float) -> None:
        self.boxes_choice = int(value)
        self._do.change()

    def _setter(self, name: str) -> Callable[[Any], object]:
        return lambda value: self._do.change(**{name: value})

    def show_options(self, options: ViewerOptions) -> None:
        """Set the inputs to the current options after a change from elsewhere."""
        self.counts.value, self.follow.value, self.search.value = (
            options.counts,
            options.follow,
            options.search,
        )
        for name, box in self.see.items():
            box.value = getattr(options, name)
        for axis, box in self.free.items():
            box.value = axis in options.free
        own = options.parameters or parameters_of(options.search)
        for name, each in self.parameters.items():
            each.visible = name in own
            if name in own:
                each.value = own[name]

    def show_target(self, options: ViewerOptions) -> None:
        """Set the numbers of the goal to its current pose."""
        _show_pose(self.place, self.turn, options.target)

    def show_number(self, number: int, count: int) -> None:
        """Set the slider of passes to index `number` of `count`."""
        on = count > 1 and self.passes.value
        self.number.visible = self.stepping.visible = on
        if on:
            self.number.max = count
            self.number.value = number + 1

    def _on(self, handle: Any, do: Callable[[Any], object], click: bool = False) -> None:
        """Call `do` for values set by a person, not by the page itself; in order, because it runs in the server's own loop.

        A value that the input does not offer was not sent by a page; the input is then reset to its last value.
        """
        known = handle.value

        async def report(event: Any) -> None:
            nonlocal known
            if event.client is None:
                return
            if not is_offered(event.target):
                event.target.value = known
                return
            known = event.target.value
            try:
                do(event.target.value)
            except KinseekError as error:  # The typed values may not be a pose.
                self.result.content = refused_html(str(error))

        (handle.on_click if click else handle.on_update)(report)


def is_offered(handle: Any) -> bool:
    """Return whether the value of an input is one that it offers: one of its options, in its range, of the right length."""
    value = handle.value
    if options := getattr(handle, "options", ()):
        return value in options
    if isinstance(value, tuple):
        return len(value) == 3
    if isinstance(value, int | float) and not isinstance(value, bool):
        return bool(handle.min <= value <= handle.max)
    return True


def _show_pose(place: Any, turn: Any, T: Array) -> None:
    """Set the numbers of two inputs to a pose, (4, 4)."""
    place.value = tuple(round(float(v), 6) for v in T[:3, 3])
    turn.value = tuple(round(float(v), 4) for v in np.degrees(rpy_of(T[:3, :3])))


def _pose_of(place: Any, turn: Any) -> Array:
    """Return the pose of the numbers of two inputs, [m] and [°], (4, 4)."""
    return np.asarray(pose(place, rpy=turn, degrees=True))
