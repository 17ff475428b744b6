"""Pictures of the boxes of joint values in a proof: those proved empty, and those left."""

from __future__ import annotations

from heapq import heappop, heappush
from itertools import combinations, count
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidUse
from kinseek.kernels.proof.progress import COUNT, FOUND, STUCK
from kinseek.problem import Problem
from kinseek.proof.boxes import Run, Watch, tuning_of
from kinseek.proof.certificate import Certificate
from kinseek.proof.reduce import question, start_boxes
from kinseek.support.turns import nearest_turns

from .figures import COLOURS, drawn, given_or_new
from .shown import axis_label, count_of, two_joints

Array = NDArray[np.float64]

MOST = 2000
"""Default number of boxes that are examined for a picture."""

EMPTY, LEFT = "Blues", COLOURS[1]


class Look(NamedTuple):
    """One step of the proof: centre and half widths of a box in one row, [rad] or [m]."""

    box: Array
    """The box, (2 k,), for the k joints that are not divided out."""
    left: Array
    """The rest of it: (0, 2 k) if it is proved empty; (1, 2 k) if it was cut from its sides, or is kept because it contains
    a solution or is as small as numbers allow; (2, 2 k) if it was halved.
    """


@drawn
def boxes(
    certificate: Certificate,
    joints: tuple[int | str, int | str] | None = None,
    *,
    most: int = MOST,
    ax: Any = None,
    size: tuple[float, float] = (5.8, 5.2),
) -> Any:
    """Draw the boxes of a proof: blue is proved empty, darker after more steps; red is left.

    For more than two joints a slice is drawn, with all other joints as in the certificate's best pose. Boxes do not include
    a last joint that is divided out.

    A certificate does not store its boxes. So the proof is repeated by the same kernel, one step at a time and the widest
    box first, so that the boxes left by a budget are spread evenly. With a sufficient budget the boxes are those of the
    proof.

    Args:
        certificate: From `arm.prove`.
        joints: The two axes of the picture, by index from 0 or by name; by default those whose slice has the most boxes.
        most: Number of boxes to examine; the default of 2,000 takes about a tenth of a second.
        ax: Axes in a plane to draw on.
        size: Size of a new figure [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidUse: Not a certificate, other axes, not two joints, one that is divided out, fewer than two that are not, or a
            goal that needs no boxes because lengths and angles decide.
        MissingExtra: Matplotlib is not installed.
    """
    if not isinstance(certificate, Certificate):
        raise InvalidUse(f"expected a certificate of arm.prove, got {type(certificate).__name__}")
    problem = certificate.problem
    looks = examined_boxes(problem, count_of("most", most, 1))
    if not looks:
        raise InvalidUse("there are no boxes: lengths and angles alone prove that this goal is out of reach")
    q = _within(looks[0].box, certificate.q)
    x, y = _axes_of(problem, looks, q, joints)
    slice_ = Slice(q, x, y)
    shown = [each for each in looks if slice_.meets(each.box)]
    figure, axes = given_or_new(ax, size)
    left = _paint(axes, slice_, shown)
    whole, names, kinds = slice_.part(looks[0].box), problem.mechanism.joint_names, problem.mechanism.kinds
    axes.set(xlim=(whole[0], whole[0] + whole[2]), ylim=(whole[1], whole[1] + whole[3]))
    axes.set(xlabel=axis_label(names[x], kinds[x]), ylabel=axis_label(names[y], kinds[y]))
    axes.grid(False)
    here = f", {len(shown):,} of them in this slice" if len(shown) < len(looks) else ""
    axes.set_title(f"{len(looks):,} boxes examined{here};\nblue is proved empty, {left:,} left (red)")
    return figure


def examined_boxes(problem: Problem, most: int = MOST) -> list[Look]:
    """Examine boxes as `Arm.prove` does, one at a time, widest first, until none is left or `most` are examined.

    Args:
        problem: One target without ranges.
        most: Maximum number of steps.
    """
    reduction = question(problem)
    tuning = tuning_of(problem, most + 1, 0)  # No steps towards a solution: only boxes are needed.
    looks: list[Look] = []
    waiting: list[tuple[float, int, Array]] = []
    number = count()  # Boxes of the same size are ordered by their creation.

    def put(boxes: Array) -> None:
        for box in boxes:
            heappush(waiting, (-float(np.prod(box[len(box) // 2 :])), next(number), box))

    put(start_boxes(problem.chain, reduction[2].present))
    while waiting and len(looks) < most:
        box = heappop(waiting)[2]
        run = Run(problem, reduction, box[None].copy(), np.zeros(problem.chain.dof), tuning)
        found = run.go(1, Watch()) == FOUND
        if run.seen == 0:  # Lengths and angles alone decide.
            return []
        undecided = found or run.figures[STUCK] > 0.0  # Contains a solution, or cannot be halved.
        looks.append(Look(box, box[None] if undecided else run.boxes[: run.counts[COUNT]].copy()))
        if not undecided:
            put(looks[-1].left)
    return looks


class Slice(NamedTuple):
    """A plane of two joints through joint values."""

    q: Array
    """Joint values, (k,), of the joints that are not divided out."""
    x: int
    y: int

    def meets(self, box: Array) -> bool:
        """Return whether it intersects a box, (2 k,)."""
        k = len(self.q)
        others = np.delete(np.arange(k), [self.x, self.y])
        return bool((np.abs(self.q - box[:k]) <= box[k:])[others].all())

    def part(self, box: Array) -> tuple[float, float, float, float]:
        """Return left, lower end, width and height of a box in it."""
        c, h = box[: len(self.q)], box[len(self.q) :]
        x, y = self.x, self.y
        return float(c[x] - h[x]), float(c[y] - h[y]), float(2 * h[x]), float(2 * h[y])


def _within(whole: Array, q: Array) -> Array:
    """Shift joint values that are not divided out, (k,), into the box of all by whole turns."""
    k = len(whole) // 2
    gap = q[:k] - whole[:k]
    return np.where(np.abs(gap) > whole[k:], q[:k] - nearest_turns(gap), q[:k])


def _axes_of(problem: Problem, looks: list[Look], q: Array, joints: object) -> tuple[int, int]:
    """Return the two joints of the picture."""
    names, k = problem.mechanism.joint_names, len(q)
    if k < 2:
        raise InvalidUse(
            f"the boxes of this proof are of joint {names[0]!r} alone; a picture needs two joints"
        )
    if joints is not None:
        x, y = two_joints(names, joints)
        if max(x, y) >= k:
            raise InvalidUse(
                f"joint {names[k]!r} is divided out and not part of the boxes; valid: {', '.join(names[:k])}"
            )
        return x, y
    boxes = np.array([each.box for each in looks])
    missed = np.abs(q - boxes[:, :k]) > boxes[:, k:]
    pairs = list(combinations(range(k), 2))
    met = [int((missed.sum(axis=1) == missed[:, pair].sum(axis=1)).sum()) for pair in pairs]
    return pairs[int(np.argmax(met))]


def _paint(axes: Any, slice_: Slice, looks: list[Look]) -> int:
    """Paint boxes over the boxes that they are parts of; return the number of boxes left."""
    from matplotlib import colormaps
    from matplotlib.patches import Rectangle

    def paint(box: Array, **look: Any) -> None:
        left, below, wide, high = slice_.part(box)
        axes.add_patch(Rectangle((left, below), wide, high, **look))

    depth = {looks[0].box.tobytes(): 0}
    deepest, left = 1, dict[bytes, Array]()
    for each in looks:
        key = each.box.tobytes()
        left.pop(key, None)
        for child in each.left:
            depth[child.tobytes()] = depth.get(key, 0) + 1
            deepest = max(deepest, depth[child.tobytes()])
            if slice_.meets(child):
                left[child.tobytes()] = child
    for each in looks:
        shade = 0.12 + 0.6 * depth.get(each.box.tobytes(), 0) / deepest
        paint(each.box, facecolor=colormaps[EMPTY](shade), edgecolor="white", linewidth=0.5)
    for box in left.values():
        paint(box, facecolor=LEFT, edgecolor=LEFT, linewidth=1.2)
        left_edge, below, wide, high = slice_.part(box)  # Most are too small to be seen.
        axes.plot(left_edge + wide / 2, below + high / 2, "s", color=LEFT, markersize=4)
    return len(left)
