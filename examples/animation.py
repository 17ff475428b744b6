"""Make the animation of the README: a UR5e and its solutions, a planned motion, the paper's search, a goal out of reach.

Run: python examples/animation.py [PICTURE.gif]

Every frame is a real run. Every time is measured while the frame is drawn: the median of some calls, on this machine.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import plots
from kinseek.support.shapes import Pose

Array = NDArray[np.float64]

INCHES, DPI, SECONDS_A_FRAME = (8.0, 4.5), 100, 0.07
INK, GREY, PALE, PAPER = "#24292f", "#8c959f", "#e0e3e6", "#fbfbfa"
FLOOR = -0.35
BLUE, RED, GREEN, *_ = plots.COLOURS
DOWN = [np.pi, 0.0, 0.0]
CIRCLE, MOVING, STEPS_OUT, HOLD = 40, 40, 14, 20
GAP = 0.01
BARS = "all six joints, between their limits"
HOME = [-0.5, -2.1, 2.4, -1.9, -1.6, -2.1]
"""Near here the arm begins: elbow up, and on the side of the wrist on which it reaches farthest."""

arm = kinseek.load("ur5e")


def circle(share: float) -> Pose:
    """A pose on the path of the goal, its hand down."""
    a = np.pi + 2 * np.pi * share
    return kinseek.pose([0.42 + 0.14 * np.cos(a), 0.3 * np.sin(a), 0.3 + 0.08 * np.sin(2 * a)], rpy=DOWN)


def median(call: Callable[[], object], times: int = 201) -> float:
    """Seconds that a call takes."""
    taken = []
    for _ in range(times):
        began = perf_counter()
        call()
        taken.append(perf_counter() - began)
    return float(np.median(taken))


def short(seconds: float) -> str:
    """A time in two digits."""
    told = float(f"{seconds:.2g}")
    return f"{told * 1e6:g} µs" if told < 1e-3 else f"{told * 1e3:g} ms"


class Stage:
    """The arm on the left, a panel on the right, words above and below."""

    def __init__(self) -> None:
        from matplotlib.figure import Figure

        self.figure: Any = Figure(figsize=INCHES, dpi=DPI, facecolor=PAPER)
        self.frames: list[Any] = []

    def clear(self, title: str, about: str, *lines: str) -> tuple[Any, Any]:
        """Begin a frame: its title, what the panel is about, and lines below it."""
        self.figure.clear()
        space = self.figure.add_axes((-0.11, -0.16, 0.8, 1.22), projection="3d", facecolor=PAPER)
        self.frame(space)
        space.set_box_aspect((1.65, 1.2, 0.75 - FLOOR), zoom=1.22)
        space.view_init(16, -62)
        space.set_axis_off()
        for x in np.linspace(-0.6, 0.9, 6).tolist():
            plots.draw_line(space, [[x, -0.6, FLOOR], [x, 0.6, FLOOR]], color=PALE, linewidth=0.8)
        for y in np.linspace(-0.6, 0.6, 5).tolist():
            plots.draw_line(space, [[-0.6, y, FLOOR], [0.9, y, FLOOR]], color=PALE, linewidth=0.8)
        plots.draw_line(space, np.array([[0, 0, FLOOR], [0, 0, 0]]), color="#b6bcc2", linewidth=9, zorder=2)
        self.figure.text(0.03, 0.92, title, fontsize=15.5, weight="bold", color=INK)
        self.figure.text(0.655, 0.855, about, fontsize=10.5, color=INK)
        for i, line in enumerate(lines):
            self.figure.text(0.655, 0.245 - 0.08 * i, line, fontsize=13, color=INK)
        panel = self.figure.add_axes((0.71, 0.41, 0.26, 0.42), facecolor=PAPER)
        panel.tick_params(labelsize=9.5, colors=INK)
        return space, panel

    @staticmethod
    def frame(space: Any) -> None:
        """Show the same part of space in every frame."""
        space.set(xlim=(-0.6, 1.05), ylim=(-0.6, 0.6), zlim=(FLOOR, 0.75))

    def keep(self, times: int = 1) -> None:
        """End a frame, shown so many times as long."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from PIL import Image

        canvas: Any = FigureCanvasAgg(self.figure)
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        self.frames += [picture] * times

    def save(self, path: Path) -> None:
        """Write all frames with one palette, without dithering: what stands still takes no bytes."""
        from PIL import Image

        some = self.frames[:: max(1, len(self.frames) // 8)]
        strip = Image.new("RGB", (some[0].width, some[0].height * len(some)))
        for i, frame in enumerate(some):
            strip.paste(frame, (0, i * frame.height))
        palette = strip.quantize(240)
        first, *others = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in self.frames]
        first.save(
            path, save_all=True, append_images=others, duration=SECONDS_A_FRAME * 1000, loop=0, optimize=True
        )


def draw(space: Any, q: Array, color: str = BLUE, shadow: bool = True, **look: Any) -> None:
    """An arm with its shadow on the floor."""
    from kinseek.robots.chain import joint_points

    if shadow:
        points = joint_points(arm.chain, q)
        points[:, 2] = FLOOR
        plots.draw_line(space, points, color="#d5d9dd", linewidth=4, solid_capstyle="round", zorder=1)
    plots.draw_arm(space, arm, q, color, **({"linewidth": 5.5, "zorder": 5} | look))


def bars(panel: Any, q: Array, *others: Array) -> None:
    """Joint values between their limits."""
    rows = np.arange(arm.dof)
    panel.barh(rows, arm.upper - arm.lower, left=arm.lower, height=0.62, color="#e6e9ec")
    for ghost in others:
        panel.plot(ghost, rows, "|", color=GREY, markersize=10, alpha=0.7)
    panel.plot(q, rows, "o", color=BLUE, markersize=7)
    panel.set(ylim=(arm.dof - 0.5, -0.5), xlim=(-6.6, 6.6), xlabel="[rad]", yticks=rows)
    panel.set_yticklabels([f"q{k + 1}" for k in rows])
    for side in panel.spines.values():
        side.set_visible(False)


def follow(stage: Stage) -> None:
    """The goal travels, all answers move with it."""
    T = circle(0.1)
    one, every = median(lambda: arm.ik(T)), median(lambda: arm.branches(T))
    q = arm.ik(circle(0.0), near=HOME).q
    path = np.array([circle(share)[:3, 3] for share in np.linspace(0, 1, 101)])
    for i in range(CIRCLE):
        T = circle(i / CIRCLE)
        q = arm.ik(T, near=q).require().q
        found = arm.branches(T)
        space, panel = stage.clear(
            "A pose in, every solution out",
            BARS,
            f"{len(found)} solutions, no guess",
            f"one in {short(one)}, all in {short(every)}",
        )
        plots.draw_line(space, path, color=GREY, linewidth=1.2, linestyle=":")
        for ghost in found:
            if np.abs(ghost - q).max() > 1e-3:
                draw(space, ghost, GREY, shadow=False, linewidth=2.4, alpha=0.45, zorder=3)
        draw(space, q)
        plots.draw_frame(space, T, 0.13)
        bars(panel, q, *found)
        stage.keep()


def around(stage: Stage) -> None:
    """Between a wall and a beam: a plan in a scene, and its trajectory against the limits of the joints."""
    from kinseek.plots.scenes import draw_scene, draw_way

    scene = kinseek.Scene.of(arm, capsules=0.05)
    scene.add_box("wall", size=(0.7, 0.04, 0.6), pose=kinseek.pose([0.62, 0.0, 0.1]))
    scene.add_box("beam", size=(1.0, 0.08, 0.08), pose=kinseek.pose([0.45, 0.0, 0.7]))
    right, left = (kinseek.pose([0.5, y, 0.15], rpy=DOWN) for y in (-0.35, 0.35))
    q0 = arm.ik(right, scene=scene, near=HOME).require().q
    q1 = arm.ik(left, scene=scene, near=q0).require().q
    planned = median(lambda: scene.plan(q0, q1), 11)
    path = scene.plan(q0, q1)
    trajectory = path.timed(velocity=2.0, acceleration=8.0)
    assert path.status is kinseek.PathStatus.CONTINUOUS
    t = np.linspace(0.0, trajectory.duration, 400)
    shares = trajectory.velocity(t) / 2.0
    for moment in np.linspace(0.0, trajectory.duration, MOVING):
        space, panel = stage.clear(
            "Around obstacles, as fast as the joints can",
            "joint speeds within their limits",
            f"planned in {short(planned)}",
            "proved free at every moment",
        )
        q = trajectory.q(moment)
        draw_scene(space, arm.chain, scene, q[None], q[None])
        draw_way(space, arm.chain, trajectory, None)
        draw(space, q)
        plots.draw_frame(space, left, 0.13)
        stage.frame(space)
        for limit in (-1.0, 1.0):
            panel.axhline(limit, color=GREY, linestyle="--", linewidth=1.0)
        for column, color in zip(shares.T, plots.COLOURS, strict=False):
            panel.plot(t, column, color=color, linewidth=1.4)
        panel.axvline(moment, color=INK, linewidth=1.2)
        panel.set(xlabel="[s]", ylim=(-1.15, 1.15), yticks=(-1, 0, 1), xlim=(0.0, trajectory.duration))
        last = moment == trajectory.duration
        stage.keep(12 if last else 1)


def close_in(stage: Stage) -> None:
    """Divide and conquer, pass by pass, and the window of two of its joints."""
    T = circle(0.0)
    solution = arm.ik(T, solver=kinseek.DivideAndConquer(breadth=2), trace=True)
    x, y = 1, 2
    before: list[Array] = []
    for number, each in enumerate(solution.trace, 1):
        space, panel = stage.clear(
            "The paper's search: a grid, refined",
            "error over two joints: dark is near",
            f"pass {number}: {solution.trace.evaluations[number - 1]:,} poses tried",
            f"{each.position_error * 1e3:.3g} mm and {np.degrees(each.orientation_error):.2g}° off",
        )
        for q in before[-3:]:
            draw(space, q, GREY, shadow=False, linewidth=2.4, alpha=0.5, zorder=3)
        draw(space, each.q, RED)
        plots.draw_frame(space, T, 0.13)
        before.append(each.q)
        values = each.values(x), each.values(y)
        margin = [0.12 * (v[-1] - v[0]) for v in values]
        ends = [(v[0] - m, v[-1] + m) for v, m in zip(values, margin, strict=True)]
        plots.landscape(solution, (x, y), within=ends, points=81, ax=panel)
        for line in panel.lines:  # The answer is what is looked for.
            line.set_visible(False)
        panel.plot(*(axis.ravel() for axis in np.meshgrid(*values)), "o", color="white", markersize=4)
        panel.plot(*each.q[[x, y]], "o", color=RED, markersize=9, markeredgecolor="white")
        panel.set(xlabel="q2 [rad]", ylabel="q3 [rad]")
        panel.locator_params(nbins=3)
        stage.keep(4)


def out_of_reach(stage: Stage) -> None:
    """The goal leaves, the nearest pose follows, and the proof says why."""
    q = arm.ik(circle(0.0), near=HOME).q
    start, end = circle(0.0), kinseek.pose([0.9, 0.2, 0.5], rpy=DOWN)
    for share in np.linspace(0, 1, STEPS_OUT):
        T = start.copy()
        T[:3, 3] += share * (end - start)[:3, 3]
        solution = arm.ik(T, near=q)
        q = solution.q
        if share < 1:
            says = f"nearest pose: {solution.position_error * 100:.1f} cm off"
            _, panel = show_far(stage, T, q, BARS, "reached" if solution.success else says)
            bars(panel, q)
            stage.keep()
    certificate, nearest = arm.prove(T), arm.prove(T, gap=GAP)
    taken = median(lambda: arm.prove(T), 101)
    assert certificate.verdict is kinseek.Verdict.UNREACHABLE
    assert solution.weighted_error <= 1.001 * certificate.upper_bound
    for share in np.linspace(0, 1, HOLD):
        count = max(1, round(share**2 * certificate.boxes))
        words = [f"{count:,} {'box' if count == 1 else 'boxes'} looked at"]
        if share == 1:
            verdict, nearer = (
                f"proved unreachable in {short(taken)}",
                f"no pose comes {nearest.gap:.1%} nearer",
            )
            words = [verdict, f"{count:,} boxes, none is left", nearer]
        _, panel = show_far(stage, T, q, "blue: proved empty, red: not yet", *words)
        plots.boxes(certificate, (1, 2), most=count, ax=panel)
        panel.set(title="", xlabel="q2 [rad]", ylabel="q3 [rad]")
        stage.keep(16 if share == 1 else 1)


def show_far(stage: Stage, T: Pose, q: Array, about: str, *says: str) -> tuple[Any, Any]:
    """The arm, a goal, and what is between them."""
    space, panel = stage.clear("Out of reach: the nearest pose, and a proof", about, *says)
    draw(space, q)
    plots.draw_frame(space, T, 0.13)
    plots.draw_line(space, [arm.fk(q)[:3, 3], T[:3, 3]], color=RED, linewidth=2, linestyle=":")
    return space, panel


def main(path: Path) -> None:
    stage = Stage()
    for scene in (follow, around, close_in, out_of_reach):
        scene(stage)
    stage.save(path)
    seconds = len(stage.frames) * SECONDS_A_FRAME
    print(f"wrote {path}: {len(stage.frames)} frames, {seconds:.1f} s, {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "kinseek.gif"))
