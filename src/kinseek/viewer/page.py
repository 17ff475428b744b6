"""One open page: it solves the current goal at once, and runs slower computations in other threads."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.result import Branches
from kinseek.collision import Box, Scene
from kinseek.collision.surfaces import drawn_bodies
from kinseek.errors import InvalidScene, KinseekError
from kinseek.paths.tracker import Step, TrackStatus
from kinseek.printable import printable
from kinseek.support.transforms import transform
from kinseek.timing.trajectory import Trajectory
from kinseek.trace import Trace

from . import clouds, words
from .meshes import Meshes
from .options import ViewerOptions, read_selection
from .panel import Panel
from .searches import DEFAULT, takes_seconds
from .session import GoalResult, Planned, Posture, Proof, Session, nearest_of
from .view import CLOUD, MOST_GHOSTS, REACHED, SEARCH, View, is_at, matrix_of
from .workers import Newest, Queue, Turns

Array = NDArray[np.float64]

QUIET = 0.12
"""Time that a goal must rest before slower computations begin [s]."""

NARROW = 0.7
"""Ratio of a window's width to its height below which it is treated as an upright telephone."""

FRAME = 1.0 / 30.0
"""Time from one picture of a played motion to the next [s]."""

LONGEST_FRAME = 0.2
"""Time that a tracker catches up after a longer pause [s]."""

MOST_ADDED = 50
"""Maximum number of bodies that a page adds to its scene: anyone who opens it can."""

BOX = 0.15
"""Edge length of a new box, relative to the arm's reach."""

ON_MOTION = "The arm is shown on its motion."
"""The status while it is."""

_UNSEARCHED = (ON_MOTION, str(TrackStatus.TRACKING))
"""The status of what was not searched for, so that it has no passes."""

_SOLVES, _SEARCHES, _PROOFS, _CLOUDS, _PLANS = (Turns() for _ in range(5))
"""The turns of all pages for each kind of work that takes time."""

PASS, SHOW = 0.9, 12.0
"""Time for which a pass is shown during playback, and maximum time of the whole playback [s]."""


class Page:
    """One person's page. Any thread may report a change by `change`; the page responds in threads of its own."""

    def __init__(
        self, client: Any, session: Session, meshes: Meshes, trajectory: Trajectory | None = None
    ) -> None:
        """Lay out the view and the panel with the options stored in this browser, and solve the first goal."""
        self._client, self._session, self.arm = client, session.visit(), session.arm
        self._given_motion = trajectory
        self.trajectory: Trajectory | None = None
        """The motion that is drawn and can be played: the one planned last, or the one given."""
        self.planning = False
        """Is a motion to every goal planned?"""
        self._start = self._session.begin.q
        """Where it starts, (n,)."""
        self._lock = threading.RLock()
        self.options = read_selection(self._fetch(), session.begin)
        self.result = GoalResult(self.options, self.options.q)
        self._refusal = ""
        """Why the last change of the goal or the scene was refused, if no other followed; shown in place of the result."""
        self.proof: Proof | None = None
        self.branches: Branches | str | None = None
        self._branches_for = self.options
        """The options with the goal of these branches."""
        self.trace: Trace | None = None
        self._reached: clouds.Reached | None = None
        self._reached_for = self.options
        self._chosen_time, self._chosen_pass = 0.0, 0
        """The time of the motion that was chosen last [s]."""
        self._motions = 0
        """How often the arm was shown on a motion: goals that were set before are not shown after that."""
        self._drives = False
        """Is the goal to drive the arm?"""
        self._servoing = False
        """Does a tracker move the arm? Then goals are not solved."""
        self._new_goals = np.random.default_rng(client.client_id)
        self.view = View(
            client.scene, self.arm, meshes, lambda name: self.edit(partial(self.select_body, name))
        )
        self._given = [] if session.scene is None else drawn_bodies(session.scene)
        """The bodies before this visitor changed them."""
        self._bodies = {body.name: body for body in self._given}
        self._selected = ""
        """Name of the body that is edited."""
        self.view.bodies.take(self._given)
        self.panel = Panel(client.gui, self, meshes)
        name = f"kinseek page {id(self):x}"
        self._solver = Newest(
            self._solve,
            f"{name}: solutions",
            turn=lambda: _SEARCHES if takes_seconds(self.options.search) else _SOLVES,
            period=FRAME,
        )
        self._prover = Newest(self._prove, f"{name}: proofs", QUIET, lambda: _PROOFS)
        self._clouder = Newest(self._cloud, f"{name}: clouds", QUIET, lambda: _CLOUDS)
        self._planner = Newest(self._plan, f"{name}: plans", QUIET, lambda: _PLANS)
        self._player = Newest(self._play, f"{name}: motions")
        self._storer = Newest(self._store, f"{name}: options", QUIET)
        self._editor = Queue[Callable[[], object]](self._do_edit, f"{name}: bodies")
        self._workers = (
            self._solver,
            self._prover,
            self._clouder,
            self._planner,
            self._player,
            self._storer,
            self._editor,
        )
        try:
            self._begin()
        except BaseException:  # The client left at once: nothing else would close the threads.
            self.close()
            raise

    def _begin(self) -> None:
        client, options = self._client, self.options
        self.view.show_goal(options.target)
        self._apply_appearance(options)
        if options.camera is not None:
            client.camera.position, client.camera.look_at = options.camera
        elif client.camera.aspect < NARROW:  # The panel is below: the arm goes above it.
            eye, at = client.camera.position, client.camera.look_at
            away = 0.9 * (eye - at) / client.camera.aspect
            client.camera.position = at + away  # Also moves the target of the camera.
            client.camera.look_at = at - [0.0, 0.0, 0.22 * float(np.linalg.norm(away))]

        async def dragged(event: Any) -> None:
            wxyz, position = event.target.wxyz, event.target.position
            self.edit(lambda: self.change(target=matrix_of(wxyz, position), drawn=True), "goal")

        async def looked(camera: Any) -> None:
            with self._lock:
                eye, at = (tuple(map(float, point)) for point in (camera.position, camera.look_at))
                self.options = self.options.but(camera=(eye, at))
            self._storer.give("keep")

        async def dragged_body(event: Any) -> None:
            with contextlib.suppress(KinseekError):  # Not a pose that a page sends.
                pose = matrix_of(event.target.wxyz, event.target.position)
                self.edit(partial(self.place_body, pose), "drag")

        self.view.goal.on_update(dragged)
        self.view.body.on_update(dragged_body)
        client.camera.on_update(looked)
        self.view.on_ghost(self.pick)
        self._show_bodies()
        if self._given_motion is not None:
            self._planner.give("again")
        self._ask()

    @property
    def idle(self) -> bool:
        """Return whether all requested work is done."""
        return all(worker.idle for worker in self._workers)

    def change(self, drawn: bool = False, **changes: Any) -> None:
        """Change `ViewerOptions` by name; a target (4, 4) moves the goal, unless it is drawn there already.

        Raises:
            KinseekError: A target that is not a pose.
        """
        with self._lock:
            after = self.options = self.options.but(**changes)
            self._refusal = ""
        if changes.keys() - {"target", "q", "camera"}:
            self.panel.show_options(after)
        if {"ghosts", "meshes", "swept", "dark", "free"} & changes.keys():
            self._apply_appearance(after)
        if "target" in changes and not drawn and not is_at(self.view.goal, after.target):
            self.view.show_goal(after.target)
        if {"target", "free", "search", "parameters", "follow"} & changes.keys() and not self._servoing:
            self._again()
        else:
            if "free" in changes:  # Another goal needs another tracker.
                self._track()
            self._clouder.give("again")
        self._storer.give("keep")

    def _again(self) -> None:
        """Solve the goal, or track it with another tracker."""
        if self._servoing:
            self._track()
        else:
            self._stop()
            self._ask()

    def _stop(self) -> None:
        """End what is played."""
        if not self._player.idle:
            self._player.give("stop")

    def _ask(self, picked: Array | None = None) -> None:
        """Solve the goal, or show one of its branches, unless the arm is shown on a motion before that is done."""
        self._refusal = ""
        self._solver.give((self._motions, picked))

    def pick(self, number: int) -> None:
        """Show one of the branches, by its index."""
        known = self.branches
        if isinstance(known, Branches) and 0 <= number < len(known):
            if not self._servoing:
                self._stop()
            self._ask(known.q[number])

    def show_pass(self, number: int) -> None:
        """Show one pass of the search, by its index from 0; an index out of range changes nothing.

        This takes up to 2,000 evaluations of FK, so it is never done in the server's loop.
        """
        trace = self.trace
        if trace is None or not self.panel.passes.value or not 0 <= number < len(trace):
            return
        one = trace[number]
        visited = clouds.visited(self.arm, one)
        with self._lock:
            # Otherwise another goal has been solved meanwhile, or passes are no longer wanted.
            if self.trace is trace and self.panel.passes.value:
                self.view.show_pass(one.q, visited)
                self.panel.pass_text.content = words.pass_html(trace, number)
                self.panel.joints.content = words.joints_html(self.arm, self.result.q, one)

    def choose_pass(self, number: int) -> None:
        """Stop, and show one pass of the search, by its index from 0; an index out of range changes nothing."""
        trace = self.trace
        if trace is None or not 0 <= number < len(trace):
            return
        self._chosen_pass = number
        self.panel.show_number(number, len(trace))
        self._player.give("pass")

    def show_time(self, t: float) -> None:
        """Show the trajectory at a time [s]; the next goal is solved near the joint values shown then."""
        trajectory = self.trajectory
        if trajectory is None:
            return
        t = min(t, trajectory.duration)
        q = trajectory.q(t)
        posture = self._session.posture(q)
        with self._lock, self._client.atomic():
            if self._player.follows("stop"):  # A goal is solved, and may be shown already.
                return
            self._motions += 1
            self.options = self.options.but(q=q)
            # No proof about the goal changes what is shown.
            self.result, self.proof = (
                GoalResult(self.options, q, refused=ON_MOTION),
                None,
            )
            self._show_posture(posture, self.options.target, True)
            self.view.show_ghosts(np.zeros((0, self.arm.dof)), -1)
            self.panel.motion.content = words.motion_html(trajectory, t)
            self._show_result(words.note_html(ON_MOTION))
            self.panel.branches.content = self.panel.call.content = ""
            self.panel.time.value = t
            if self.trace is not None:
                self._hide_passes()

    def _show_result(self, content: str) -> None:
        """Show what is known about the goal, unless the last change was refused."""
        self.panel.result.content = words.refused_html(self._refusal) if self._refusal else content

    def _show_posture(self, posture: Posture, target: Array, reached: bool) -> None:
        """Show the arm, with what touches.

        The caller has computed the posture before it took the lock: that may take long, and the server's loop waits for the
        lock.
        """
        self.view.show_arm(posture, target, reached)
        self.panel.hits.content = words.contacts_html(posture.contacts)
        self.panel.joints.content = words.joints_html(self.arm, posture.q)

    def play_passes(self) -> None:
        """Show one pass after another."""
        self._player.give("play")

    def play_motion(self, on: bool) -> None:
        """Play a motion from the time that is shown, or stop."""
        self._refusal = ""
        self._player.give("motion" if on else "stop")

    def choose_time(self, t: float) -> None:
        """Stop, and show a motion at a time [s]."""
        self._chosen_time, self._refusal = t, ""
        self._player.give("time")

    def servo(self, on: bool) -> None:
        """Let the goal drive a tracker from now on, or solve it again."""
        self._drives, self._refusal = on, ""
        self._servoing = self._servoing or on
        self._track()

    def _track(self) -> None:
        """Track the goal by a new tracker, or solve it again if it is no longer to drive the arm."""
        self._player.give("servo" if self._drives else "solve")

    def change_limits(self) -> None:
        """Track, and plan motions, within other limits from now on."""
        self._refusal = ""
        if self._servoing:
            self._track()
        if self.planning:
            self._planner.give("again")

    def end(self) -> None:
        """Let all threads end after what they do now."""
        for worker in self._workers:
            worker.end()

    def close(self) -> None:
        """End the threads after the page was closed."""
        self.end()  # All at once.
        for worker in self._workers:
            worker.close()

    # The scene, which every visitor edits alone.

    @property
    def scene(self) -> Scene | None:
        """The scene as this visitor has it."""
        return self._session.scene

    def edit(self, change: Callable[[], object], name: str = "") -> None:
        """Call one of this page's methods in the thread for changes of the scene and of the goal.

        Where it takes longer than the next change of the same name comes, it is skipped. The server's loop never waits for
        it: with many bodies a change takes some hundredths of a second, and even a goal takes up to 10 ms there while other
        threads compute, as NumPy passes Python on to them and gets it back milliseconds later.
        """
        self._editor.give((name, change))

    def _do_edit(self, named: tuple[str, Callable[[], object]]) -> None:
        try:
            named[1]()
        except KinseekError as error:
            with self._lock:
                self._refusal = str(error)
                self._show_result("")
                self._show_bodies()
            self._storer.give("keep")  # The numbers are those of the body and of the goal again.

    def select_body(self, name: str) -> None:
        """Edit the body of this name, if it stands by itself; otherwise none."""
        with self._lock:
            self._refusal, body = "", self._bodies.get(name)
            self._selected = name if body is not None and body.alone else ""
            self._show_bodies()

    def add_box(self) -> None:
        """Add a box beside the goal, and edit it.

        Raises:
            InvalidScene: There are enough.
        """
        if len(self._bodies) >= len(self._given) + MOST_ADDED:
            raise InvalidScene(f"a page adds at most {MOST_ADDED} boxes; remove one, or make them in Python")
        # Not that of a body that was removed: what it may touch would count for this one in the program that is shown.
        names = {*self._bodies, *(body.name for body in self._given)}
        name = next(name for i in count(1) if (name := f"box {i}") not in names)
        size = float(f"{BOX * self.view.size:.1g}")
        place = self.options.target[:3, 3] + [0.0, 0.0, -2.0 * size]

        def add(scene: Scene) -> None:
            # Not added at its place: the server would print a `UnitWarning` if that is far away.
            scene.add_box(name, [size] * 3)
            scene._place(name, transform(np.eye(3), place))

        self._edit(name, add)

    def remove_body(self) -> None:
        """Remove the body that is edited."""
        if name := self._selected:
            self._edit("", lambda scene: scene.remove(name))

    def place_body(self, pose: Array) -> None:
        """Move the body that is edited to a pose, (4, 4).

        Raises:
            KinseekError: It is no pose, or too far away.
        """
        if name := self._selected:
            self._edit(name, lambda scene: scene._place(name, pose))

    def resize_box(self, size: Sequence[float]) -> None:
        """Give the box that is edited other edge lengths, (3,) [m].

        Raises:
            InvalidScene: They are invalid.
        """
        body = self._bodies.get(self._selected)
        if body is not None and body.is_box:
            box, pose = Box(size), body.frame.pose
            self._edit(body.name, lambda scene: scene.add(body.name, box, pose, replace=True))

    def _edit(self, selected: str, change: Callable[[Scene], object]) -> None:
        """Change the scene, and solve the goal in it; after an error everything is as it was."""
        scene = self._session.edited(change)
        bodies = drawn_bodies(scene, self._bodies)
        changes = words.code_html(*words.changes_of(self._given, bodies))
        with self._lock, self._client.atomic():
            self._refusal = ""
            self._session.scene = scene
            self._bodies, self._selected = {body.name: body for body in bodies}, selected
            self.view.bodies.take(bodies)
            self._show_bodies()
            self.panel.changes.content = changes
        self._again()
        if self.trajectory is not None:  # It may hit something now.
            self._planner.give("again")

    def _show_bodies(self) -> None:
        body = self._bodies.get(self._selected)
        self.view.show_body(None if body is None else body.frame.pose)
        self.panel.show_bodies([name for name, one in self._bodies.items() if one.alone], body)

    # Motions around the bodies of the scene.

    def plan(self, on: bool) -> None:
        """Plan a motion to every goal from now on, from where the arm is shown, or no longer."""
        self.planning = on
        self._apply_appearance(self.options)
        self.start_here()

    def start_here(self) -> None:
        """Let planned motions start where the arm is shown."""
        self._start = self.options.q
        self._planner.give("again")

    def _plan(self, _: str) -> None:
        if not self.planning or self._servoing:  # No plan belongs to a goal that moves.
            self.panel.plan.content = ""
            self._show_motion(self._given_motion, None)
            return
        self.panel.plan.content = words.note_html("Planning …")
        acceleration = self.panel.limits["acceleration"]
        planned = self._session.plan(self.options, self._start, acceleration, self._planner.stale)
        if not self._planner.stale():
            self.panel.plan.content = words.plan_html(planned)
            self._show_motion(planned.motion, self._start)

    def _show_motion(self, motion: Trajectory | None, start: Array | None) -> None:
        """Draw what a motion passes, and offer to play it."""
        proved = motion is not self._given_motion
        swept = None if motion is None else self._session.swept(motion, proved, self._planner.stale)
        with self._lock, self._client.atomic():
            is_other, self.trajectory = motion is not self.trajectory, motion
            self.view.show_motion(swept, start)
            if is_other:
                self.panel.show_motion(motion)
            if swept is not None and swept.hit:
                self.panel.plan.content = words.plan_html(
                    Planned(f"The motion hits {', '.join(swept.hit)}.", "bad")
                )
            is_on_motion = is_other and self.result.refused == ON_MOTION and self._solver.idle
        self._client.flush()
        if is_on_motion and motion is None:
            self._ask()
        elif is_on_motion:  # On the one before.
            self.choose_time(0.0)

    # Fast responses.

    def _solve(self, asked: tuple[int, Array | None]) -> None:
        motions, picked = asked
        options = self.options
        if not options.has_goal_of(self._branches_for):
            picked = None  # It is a branch of an earlier goal; the new one has not been solved.
        result = self._session.solve(options) if picked is None else self._session.picked(options, picked)
        posture = self._session.posture(result.q)
        missed = not (result.reached or result.refused)
        with self._lock, self._client.atomic():
            if self._servoing:
                return
            if self._motions != motions:  # What else belongs to the goal is shown.
                self.trace = None
                self._follow_up()
                return
            self.options = self.options.but(q=result.q)
            self.result, self.proof, self.trace = result, None, result.trace
            self._show_posture(posture, options.target, result.reached)
            self._show_result(words.result_html(result, None, missed and options.search == DEFAULT))
            self.panel.motion.content = ""
        self._client.flush()
        if self._solver.stale():
            return
        if picked is None or self.branches is None:
            self.branches, self._branches_for = self._session.branches(options), options
        self._show_branches(result)
        self._prover.give("again")
        self._follow_up()

    def _follow_up(self) -> None:
        """Begin slower computations for the goal."""
        self._clouder.give("again")
        if self.planning:
            self._planner.give("again")

    def _show_branches(self, result: GoalResult) -> None:
        """Show the branches of the goal of a result, if it is still the one shown, and the call in Python."""
        known, scene, free, shown = self.branches, self.scene, None, -1
        q = known.q if isinstance(known, Branches) else np.zeros((0, self.arm.dof))
        if isinstance(known, Branches) and (result.reached or result.blocked):
            shown = nearest_of(known, result.q)
        if scene is not None and len(q):
            free = np.asarray(scene.free(q, self._session.clearance), dtype=np.bool_)
        drawn, free_ones = min(len(q), MOST_GHOSTS), None if free is None else int(free.sum())
        with self._lock, self._client.atomic():
            if self.result is result:
                self.view.show_ghosts(q, shown, free)
                self.panel.branches.content = words.branches_html(known, shown, drawn, free_ones)
                self.panel.call.content = words.code_html(result.call)

    def step_branch(self, step: int) -> None:
        """Show the branch at this offset from the current one."""
        known = self.branches
        if isinstance(known, Branches) and len(known):
            self.pick((nearest_of(known, self.result.q) + step) % len(known))

    def goal_to_arm(self) -> None:
        """Move the goal to the tip of the arm; not in the server's loop, because the FK of an arm may take long."""
        target = self.arm.fk(self.options.q)
        if np.isfinite(target).all():
            self.change(target=target)

    def another_goal(self) -> None:
        """Choose another goal that the arm reaches; not in the server's loop, as `goal_to_arm`."""
        target = self.arm.fk(self.arm.sample(1, int(self._new_goals.integers(2**31)))[0])
        if np.isfinite(target).all():
            self.change(target=target)

    def _apply_appearance(self, options: ViewerOptions) -> None:
        self.view.see(options.ghosts and not self.planning, options.meshes, options.swept)
        self.view.limit_gizmo(not set(options.free) >= {"rx", "ry", "rz"})
        self._client.gui.configure_theme(dark_mode=options.dark, show_logo=False, show_share_button=False)

    # Slower computations.

    def _prove(self, _: str) -> None:
        result = self.result
        if result.reached or result.refused:
            return
        if result.blocked:
            self._prove_blocked(result)
            return
        for proof in self._session.proofs(result.options, self._prover.stale):
            if self._prover.stale() or not self._report_once(result, proof, looking=True):
                return
        if not self._report_once(result, self.proof, looking=False):
            return
        last, solution = self.proof, result.solution
        if last is None or last.certificate is None or solution is None or result.options.search != DEFAULT:
            return
        if last.certificate.upper_bound < float(solution.weighted_error) * (1.0 - 1e-3):
            self._nearer(result, last)

    def _prove_blocked(self, result: GoalResult) -> None:
        """Report whether it is proved that every solution hits something; another one may be free after all."""
        after = self._session.blocked(result)
        posture = self._session.posture(after.q)
        with self._lock:
            if self.result is not result:
                return
            self.options, self.result = self.options.but(q=after.q), after
            self._show_posture(posture, after.options.target, after.reached)
            self._show_result(words.result_html(after, None, False))
        self._show_branches(after)

    def _report_once(self, result: GoalResult, proof: Proof | None, looking: bool) -> bool:
        """Report what is proved about a solution; return False, and report nothing, if it is no longer the one shown."""
        with self._lock:  # A newer solution waits for the lock, and overwrites.
            if self.result is not result:
                return False
            self.proof = proof
            self._show_result(words.result_html(result, proof, looking))
            return True

    def _nearer(self, result: GoalResult, proof: Proof) -> None:
        """Show the pose that a proof found, which is nearer than that of the search."""
        after = self._session.nearer(result, proof)
        posture = self._session.posture(after.q)
        with self._lock, self._client.atomic():
            if self.result is not result:
                return
            self.options, self.result = self.options.but(q=after.q), after
            self._show_posture(posture, after.options.target, after.reached)
            self._show_result(words.result_html(after, proof, False))
        self._show_branches(after)

    def _cloud(self, _: str) -> None:
        options, result, view = self.options, self.result, self.view
        searched = result.refused not in _UNSEARCHED
        if searched and self.trace is None and self.panel.passes.value:
            self._find_trace(result)
        with self._lock:
            if self.result is result:  # Otherwise another one is shown meanwhile, which may have none.
                wanted = searched and self.panel.passes.value
                self.panel.pass_text.content = words.pass_html(self.trace, 0) if wanted else ""
        last = len(self.trace) - 1 if self.trace else 0
        self.panel.show_number(last, last + 1)
        self.show_pass(last)
        with self._lock:
            if self.trace is None:  # Those drawn are of a search before.
                self.view.show_pass(None, None)
        view.show_cloud(
            "samples", clouds.samples_around(self.arm, options) if options.samples else None, CLOUD
        )
        self.panel.examined.visible = options.boxes
        said = []
        if options.boxes:
            said.append(self._boxes(options, result))
        else:
            view.show_cloud("boxes", None, SEARCH)
        self.panel.seen.content = words.note_html(*said)
        self._reach(options)

    def _find_trace(self, result: GoalResult) -> None:
        """Compute the trace of a search; if a newer solution has arrived, it has its own trace."""
        trace = self._session.traced(result)
        with self._lock:
            if self.result is result:
                self.trace = trace

    def _boxes(self, options: ViewerOptions, result: GoalResult) -> str:
        examined = clouds.BOXES[self.panel.boxes_choice - 1]
        left: clouds.Cloud | str = "The goal is reached: there is nothing to exclude."
        if not result.reached:
            left = clouds.boxes_left(self.arm, options, result.q, examined)
        self.view.show_cloud("boxes", None if isinstance(left, str) else left, SEARCH)
        if isinstance(left, str):
            return left
        return f"{len(left.points):,} boxes are left after {examined:,} tests; the palest have the smallest bound."

    def _reach(self, options: ViewerOptions) -> None:
        if not options.reach or not clouds.same_question(options, self._reached_for):
            self._reached = None
            self.view.show_cloud("reach", None, REACHED)
        self.panel.progress.visible = options.reach
        if not options.reach:
            return
        self._reached_for = options
        try:
            for known in clouds.reachable(self.arm, options, self._clouder.stale, self._reached):
                self._reached = known
                shade = np.zeros(len(known.points))
                self.view.show_cloud("reach", clouds.Cloud(known.points, shade), REACHED)
                self.panel.progress.value = 100.0 * known.tried / known.total
        except KinseekError as error:
            self.panel.seen.content = words.note_html(str(error))

    def show_passes(self, on: bool) -> None:
        """Show the passes of a search, or not."""
        if not on:
            self.view.show_pass(None, None)
            self.panel.show_number(0, 0)
            self.panel.joints.content = words.joints_html(self.arm, self.options.q)
        self._clouder.give("again")

    def _hide_passes(self) -> None:
        """Hide the passes of a goal that is no longer shown; the caller has the lock."""
        self.trace = None
        self.view.show_pass(None, None)
        self.panel.show_number(0, 0)
        self.panel.pass_text.content = ""

    def _play(self, what: str) -> None:
        if self._servoing and what != "servo":
            self._servoing = self._drives = self.panel.servo.value = False
            self.panel.shares.content = ""
            if what not in ("motion", "time") or self.trajectory is None:
                self._ask()
            elif self.planning:  # It has waited.
                self._planner.give("again")
        if what == "motion":
            self._play_motion()
        elif what == "time":
            self.show_time(self._chosen_time)
            self._client.flush()
        elif what == "pass":
            self.show_pass(self._chosen_pass)
        elif what == "play":
            self._play_passes()
        elif what == "servo":
            self._servoing = True
            self._play_servo()

    def _play_servo(self) -> None:
        """Let a tracker follow the goal in real time, from where the arm is shown."""
        while not (self._solver.idle or self._player.stale()):  # It may still draw its last solution.
            self._player.wait(FRAME)
        with self._lock:  # No proof and no branches belong to a goal that moves.
            options = self.options
            self.result = GoalResult(options, options.q, refused=str(TrackStatus.TRACKING))
            self.proof, self.branches = None, None
            self._hide_passes()
        self._clouder.give("again")
        try:
            tracker = self._session.track(options, self.panel.limits)
        except KinseekError:
            self._player.give("solve")  # Which says why.
            return
        if self.planning:
            self._planner.give("again")
        self.view.show_ghosts(np.zeros((0, self.arm.dof)), -1)
        self.panel.branches.content, self.panel.motion.content, self.panel.servo.value = "", "", True
        self.panel.call.content = ""  # That of the last solution.
        limits, before = np.array([tracker.velocity, tracker.acceleration]), time.monotonic()
        while not self._player.stale():
            target, shares = self.options.target, np.zeros((2, self.arm.dof))
            before = max(before, time.monotonic() - LONGEST_FRAME)
            for _ in range(max(1, int((time.monotonic() - before) / tracker.period))):
                step = tracker.step(target)
                shares = np.maximum(shares, np.abs([step.velocity, step.acceleration]) / limits)
                before += tracker.period
            self._show_step(step, shares, target)
            self._player.wait(FRAME)

    def _show_step(self, step: Step, shares: Array, target: Array) -> None:
        posture = self._session.posture(step.q)
        with self._lock, self._client.atomic():
            self.options = self.options.but(q=step.q)
            self._show_posture(posture, target, step.status is TrackStatus.TRACKING)
            self._show_result(words.servo_html(step))
            self.panel.shares.content = words.shares_html(self.arm, shares)
        self._client.flush()

    def _play_motion(self) -> None:
        """Play the trajectory in real time from the time that is shown, or from its begin if that is the end."""
        trajectory = self.trajectory
        if trajectory is None:
            return
        shown = float(self.panel.time.value)
        begin = time.monotonic() - (shown if shown < trajectory.duration else 0.0)
        t = 0.0
        while t < trajectory.duration and not self._player.stale():
            t = min(time.monotonic() - begin, trajectory.duration)
            self.show_time(t)
            self._client.flush()
            self._player.wait(FRAME)

    def _play_passes(self) -> None:
        trace = self.trace
        for number in range(len(trace or ())):
            if trace is not self.trace or self._player.stale():
                return
            self.panel.show_number(number, len(trace or ()))
            self.show_pass(number)
            self._player.wait(min(PASS, SHOW / len(trace or ())))

    # State stored in the browser, so that closing the page loses nothing.

    @property
    def _key(self) -> str:
        return printable(f"kinseek {self.arm.name} {self.arm.dof} {self.arm.base} {self.arm.tip}")

    def _fetch(self) -> str | None:
        try:
            stored: str | None = self._client.local_storage.get_item(self._key, timeout=3.0)
        except (RuntimeError, TimeoutError):  # A browser without storage, or one that has left.
            stored = None
        if self._client.client_id not in self._client._viser_server.get_clients():
            raise ConnectionError("the client has left")
        return stored

    def _store(self, _: str) -> None:
        """Store the options, and show the numbers of the goal; both while nobody drags or types."""
        if not self._editor.idle:  # It may be about to read other numbers.
            self._storer.give("keep")
            return
        self.panel.show_target(self.options)
        self._client.local_storage.set_item(self._key, self.options.to_json())
