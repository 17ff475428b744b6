"""The code of docs/servoing_on_a_robot.md runs on a robot that reports every command beyond a limit.

Its clock is simulated, misses periods, and moves only when the code waits or calls the robot. Each fault that a user could
make is put into the code, to see that the robot notices it.
"""

# ruff: noqa: N802  (The functions of ur_rtde are named so.)

from __future__ import annotations

import gc
import re
import sys
from collections.abc import Callable
from datetime import timedelta
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import kinseek
from kinseek.robots import catalog_path
from places import ROOT
from ros_messages import Float64MultiArray, Header, JointState, Point, Pose, PoseStamped, Quaternion

PAGE = ROOT / "docs" / "servoing_on_a_robot.md"
if not PAGE.is_file():
    pytest.skip("the documentation is not part of what is tested here", allow_module_level=True)

PERIOD = 0.002
ARM = kinseek.load("ur5e")
HAND = kinseek.pose([0.45, 0.1, 0.35], rpy=[np.pi, 0, 0])
Q0 = ARM.ik(HAND).q
ALPHABETICAL = sorted(ARM.joint_names)


class Fault(Exception):
    """What a real robot would have done badly."""


class Robot:
    """Joints that follow their commands late, and the clock of their controller."""

    def __init__(
        self, late: dict[int, float] | None = None, stops_at: float = np.inf, silent_at: float = 1.6
    ) -> None:
        """Start at rest.

        Args:
            late: By how much periods are missed [s], by the number of the command before.
            stops_at: Time of an emergency stop [s].
            silent_at: Time at which the input ends [s].
        """
        self.now, self.late, self.stops_at, self.silent_at = 100.0, late or {}, 100.0 + stops_at, silent_at
        self.limits = 1.0, 5.0, 100.0
        self.q = Q0.copy()
        self.commands: list[np.ndarray[Any, Any]] = [Q0.copy()]
        self.rates = np.zeros(6), np.zeros(6)
        """Velocity and acceleration of the last command."""
        self.times = [self.now]
        self.ended = False
        self.servo: Any = None

    @property
    def stopped(self) -> bool:
        return self.now >= self.stops_at

    def wait(self, seconds: float) -> None:
        """Let time pass; the joints approach the last command in 20 ms."""
        self.now += seconds
        if self.now > 110.0:
            raise Fault("it does not end")
        if not self.stopped:
            self.q = self.q + (1 - np.exp(-seconds / 0.02)) * (self.commands[-1] - self.q)
        if self.servo is not None:
            self.feed()

    def target(self) -> Any:
        """The pose that the input has now, or None after its end: to and fro, and after a jump at rest."""
        t = self.now - 100.0
        if t > self.silent_at:
            return None
        return HAND @ kinseek.pose([0.03 * np.sin(12 * t) if t < 0.4 else 0.08, 0.0, 0.0])

    def feed(self) -> None:
        """Do what the thread of the input does."""
        if (T := self.target()) is not None:
            self.servo.aim(T)

    def command(self, values: list[float]) -> None:
        """Take a command; the periods since the one before count."""
        if self.ended:
            raise Fault("a command after the end")
        if self.stopped and self.now > self.stops_at + 0.5:
            raise Fault("commands go on after the robot was stopped")
        if self.now > 100.0 + self.silent_at + 2.0:
            raise Fault("commands go on after the input has ended")
        q = np.array(values)
        dt = PERIOD * max(1, round((self.now - self.times[-1]) / PERIOD))
        if len(self.commands) == 1:
            dt = PERIOD
        velocity = (q - self.commands[-1]) / dt
        acceleration = (velocity - self.rates[0]) / dt
        rates = velocity, acceleration, (acceleration - self.rates[1]) / dt
        for name, rate, limit in zip(("velocity", "acceleration", "jerk"), rates, self.limits, strict=True):
            if np.abs(rate).max() > limit * (1 + 1e-6):
                raise Fault(f"{name} {np.abs(rate).max():.4g} beyond {limit}, command {len(self.commands)}")
        self.rates = velocity, acceleration
        self.commands.append(q)
        self.times.append(self.now)
        self.wait(self.late.pop(len(self.commands), 0.0))

    def end(self) -> None:
        """Stop taking commands: what moves now stops without limits."""
        if self.rates[0].any() and not self.stopped and not self.late_by_pause():
            raise Fault("the commands end in motion")
        self.ended = True

    def late_by_pause(self) -> bool:
        return self.now - self.times[-1] > 0.02


def blocks() -> list[str]:
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)


def block(containing: str) -> str:
    (code,) = (code for code in blocks() if containing in code)
    return code


def names_of(robot: Robot, fault: tuple[str, str]) -> dict[str, Any]:
    """What the page's first blocks define, on the robot's clock."""
    names: dict[str, Any] = {}
    for part in ("class Servo:", "def run("):
        exec(faulty(block(part), fault), names)
        names["time"] = SimpleNamespace(monotonic=lambda: robot.now, sleep=robot.wait)
    return names


def faulty(code: str, fault: tuple[str, str]) -> str:
    return code.replace(*fault) if fault[0] else code


# What both interfaces are: modules by name.


def install(monkeypatch: pytest.MonkeyPatch, contents: dict[str, dict[str, Any]]) -> None:
    for name, names in contents.items():
        module = ModuleType(name)
        module.__dict__.update(names)
        monkeypatch.setitem(sys.modules, name, module)


def run_loop(monkeypatch: pytest.MonkeyPatch, robot: Robot, fault: tuple[str, str] = ("", "")) -> str:
    """The loop of the page itself."""
    names = names_of(robot, fault)
    robot.servo = servo = names["Servo"](ARM, robot.q, HAND)
    names["run"](servo, lambda: robot.q, lambda q: robot.command(q.tolist()))
    robot.end()
    return str(servo.ended)


def run_ur(monkeypatch: pytest.MonkeyPatch, robot: Robot, fault: tuple[str, str] = ("", "")) -> str:
    """The recipe for ur_rtde, whose functions take the arguments that those of version 1.6.5 take."""

    class Receive:
        def __init__(self, hostname: str, frequency: float = -1.0) -> None:
            assert frequency == pytest.approx(1 / PERIOD)

        def getActualQ(self) -> list[float]:
            return [float(value) for value in robot.q]

    class Control(Receive):
        def initPeriod(self) -> timedelta:
            robot.wait(5e-6)
            return timedelta(seconds=robot.now)

        def waitPeriod(self, began: timedelta, /) -> None:
            robot.wait(max(0.0, began.total_seconds() + PERIOD - robot.now))

        def servoJ(
            self, q: list[float], v: float, a: float, time: float, ahead: float, gain: float, /
        ) -> bool:
            assert all(type(value) is float for value in q)
            assert 0.0 <= v <= 3.14
            assert 0.0 <= a <= 40.0
            assert time == PERIOD
            assert 0.03 <= ahead <= 0.2
            assert 100 <= gain <= 2000
            if robot.stopped:
                if robot.ended:
                    raise Fault("the robot has said that it does not go on")
                robot.ended = True
                return False
            robot.command(q)
            robot.wait(2e-4)
            return True

        def servoStop(self, a: float = 10.0) -> bool:
            robot.end()
            return True

        def stopScript(self) -> None:
            assert robot.ended

    install(
        monkeypatch,
        {
            "rtde_control": {"RTDEControlInterface": Control},
            "rtde_receive": {"RTDEReceiveInterface": Receive},
        },
    )
    names = names_of(robot, fault)
    exec(faulty(block("def servo_ur("), fault), names)
    said = names["servo_ur"]("192.168.0.10", ARM, HAND, lambda servo: setattr(robot, "servo", servo))
    return str(said)


def run_ros(monkeypatch: pytest.MonkeyPatch, robot: Robot, fault: tuple[str, str] = ("", "")) -> str:
    """The node, with a controller that wants its joints, and names them in /joint_states, in orders of their own."""
    order = list(ARM.joint_names[::-1])
    said: list[str] = []

    class Node:
        parameters: ClassVar[dict[str, Any]] = {
            "robot_description": catalog_path("ur5e").read_text(),
            "joints": order,
        }

        def __init__(self, name: str) -> None:
            self.listeners: dict[str, tuple[Any, Callable[[Any], None]]] = {}
            self.timers: list[tuple[float, Callable[[], None]]] = []

        def declare_parameter(self, name: str, value: Any) -> Any:
            assert type(value) is type(self.parameters[name])
            return SimpleNamespace(value=self.parameters[name])

        def create_subscription(
            self, kind: Any, topic: str, callback: Callable[[Any], None], qos: int
        ) -> None:
            self.listeners[topic] = kind, callback

        def create_publisher(self, kind: Any, topic: str, qos: int) -> Any:
            assert kind is Float64MultiArray
            assert topic == "/forward_position_controller/commands"
            return SimpleNamespace(publish=take)

        def create_timer(self, seconds: float, callback: Callable[[], None]) -> None:
            self.timers.append((seconds, callback))

        def get_logger(self) -> Any:
            return SimpleNamespace(error=said.append, warning=warn)

    def warn(text: str, throttle_duration_sec: float) -> None:
        said.append(text)

    def take(message: Any) -> None:
        values = dict(zip(order, message.data, strict=True))
        if not robot.stopped:
            robot.command([values[name] for name in ARM.joint_names])
        elif robot.now > robot.stops_at + 0.5:
            raise Fault("commands go on after the robot was stopped")

    def send(node: Any, topic: str, message: Any) -> None:
        kind, callback = node.listeners[topic]
        assert type(message) is kind
        callback(message)

    def pose_message(T: Any) -> Any:
        turn = Quaternion(x=1.0)  # As HAND has it.
        place = Point(**dict(zip("xyz", map(float, T[:3, 3]), strict=True)))
        return PoseStamped(header=Header(frame_id="base_link"), pose=Pose(position=place, orientation=turn))

    def spin(node: Any) -> None:
        ((seconds, timer),) = node.timers
        assert seconds == PERIOD
        due = robot.now
        try:
            while True:
                values = dict(zip(ARM.joint_names, map(float, robot.q), strict=True))
                state = JointState(
                    name=[*ALPHABETICAL, "finger_joint"],
                    position=[*(values[name] for name in ALPHABETICAL), 0.04],
                )
                send(node, "/joint_states", state)
                send(node, "/joint_states", JointState(name=["finger_joint"], position=[0.04]))
                if (T := robot.target()) is not None:
                    send(node, "/target", pose_message(T))
                    broken = pose_message(T)
                    broken.pose.orientation = Quaternion()
                    send(node, "/target", broken)
                timer()
                due += PERIOD * (1 + (robot.now - due) // PERIOD)  # As timers of ROS 2 do.
                robot.wait(max(0.0, due - robot.now))
        finally:
            robot.end()

    install(
        monkeypatch,
        {
            "rclpy": {"init": lambda: None, "spin": spin},
            "rclpy.node": {"Node": Node},
            "geometry_msgs": {},
            "geometry_msgs.msg": {"PoseStamped": PoseStamped},
            "sensor_msgs": {},
            "sensor_msgs.msg": {"JointState": JointState},
            "std_msgs": {},
            "std_msgs.msg": {"Float64MultiArray": Float64MultiArray},
        },
    )
    names = names_of(robot, fault)
    with pytest.raises(SystemExit):
        exec(faulty(block("class ServoNode"), fault), names)
    assert any("zero" in one for one in said)  # The orientation that was never set.
    return said[-1]


RUNS = [run_loop, run_ur, run_ros]
LATE = {40: 0.0021, 41: 0.0021, 100: 0.0011, 150: 0.0063, 210: 0.0015}
"""Periods that are missed while the hand moves."""


@pytest.mark.slow
@pytest.mark.parametrize("run", RUNS)
def test_the_robot_follows_within_its_limits_and_rests_when_the_input_ends(
    run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = Robot(dict(LATE))
    assert run(monkeypatch, robot) == "at rest, without a target"
    assert not robot.late
    np.testing.assert_allclose(ARM.fk(robot.commands[-1]), HAND @ kinseek.pose([0.08, 0.0, 0.0]), atol=1e-6)
    assert robot.now < 100.0 + robot.silent_at + 0.2


@pytest.mark.slow
@pytest.mark.parametrize("run", RUNS)
def test_an_input_that_ends_in_motion_brakes(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot(dict(LATE), silent_at=0.3)
    assert run(monkeypatch, robot) == "at rest, without a target"
    assert 0.1 < robot.now - 100.0 - robot.silent_at < 0.6


@pytest.mark.slow
@pytest.mark.parametrize("run", RUNS)
def test_a_robot_that_is_stopped_gets_no_more_commands(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot(stops_at=0.5)
    assert run(monkeypatch, robot) in ("the robot does not follow", "the robot has stopped")


@pytest.mark.slow
@pytest.mark.parametrize("run", RUNS)
def test_after_a_long_pause_nothing_is_sent(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot({170: 0.5})
    assert re.fullmatch(r"no command for 0\.5\d\d s", run(monkeypatch, robot))
    assert len(robot.commands) == 170


STOPPED: dict[str, Any] = {"stops_at": 0.5}
STOPPING = "self.step.status is kinseek.TrackStatus.STOPPING"
FAULTS: dict[str, tuple[Any, str, str, dict[str, Any]]] = {
    "one period for every step": (run_loop, "dt=dt)", "dt=PERIOD)", {}),
    "one period for every step of ur_rtde": (run_ur, "servo.next(dt,", "servo.next(PERIOD,", {}),
    "one period for every step of the node": (run_ros, "whole_periods(now - self.before)", "PERIOD", {}),
    "the jitter of the clock": (run_ur, "dt = whole_periods(", "dt = max(PERIOD, ", {}),
    "commands against the order of the arm": (run_ur, "q.tolist()", "q[::-1].tolist()", {}),
    "commands in the order of the arm": (run_ros, "in self.order]", "in self.arm.joint_names]", {}),
    "states in the order of the message": (run_ros, "in self.arm.joint_names])", "in positions][:6])", {}),
    "a target for ever": (run_loop, "None if lost else T", "T", {}),
    "a status that is ignored": (run_ur, STOPPING, "False", {}),
    "a status that the node ignores": (run_ros, STOPPING, "False", {}),
    "an end in motion": (run_ur, " and not self.step.velocity.any()", "", {"silent_at": 0.3}),
    "a reply that is ignored": (
        run_ur,
        "if q is None or not control.servoJ(",
        "if q is None or 0 * control.servoJ(",
        STOPPED,
    ),
    "a robot that nobody looks at": (run_ros, "np.abs(q - self.tracker.q).max() > BEHIND", "False", STOPPED),
    "a step for a long pause": (run_loop, "if dt > PAUSE:", "if False:", {"late": {170: 0.5}}),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_the_robot_notices(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    run, code, changed, conditions = FAULTS[fault]
    assert code in PAGE.read_text()
    given: dict[str, Any] = {"late": dict(LATE), **conditions}
    with pytest.raises((Fault, ValueError)):
        run(monkeypatch, Robot(**given), (code, changed))


def test_a_start_that_would_surprise_is_refused() -> None:
    servo = names_of(Robot(), ("", ""))["Servo"]
    for T in (
        HAND @ kinseek.pose([0.11, 0.0, 0.0]),
        HAND @ kinseek.pose([0.0, 0.0, 0.0], rpy=[0.0, 0.31, 0.0]),
    ):
        with pytest.raises(ValueError, match="too far"):
            servo(ARM, Q0, T)
    with pytest.raises(ValueError, match="outside its limits"):
        servo(ARM, Q0 + 2 * np.pi * np.eye(6)[2], HAND)
    servo(ARM, Q0, HAND @ kinseek.pose([0.09, 0.0, 0.0], rpy=[0.0, 0.29, 0.0]))


def test_the_operator_stops_it_and_what_is_no_pose_stays_with_the_input() -> None:
    robot = Robot()
    names = names_of(robot, ("", ""))
    robot.servo = servo = names["Servo"](ARM, Q0, HAND)
    for T in (np.full((4, 4), np.nan), 2 * np.eye(4)):
        with pytest.raises(kinseek.InvalidGoal):
            servo.aim(T)

    def send(q: Any) -> None:
        robot.command(q.tolist())
        if len(robot.commands) == 150:
            assert robot.rates[0].any()
            servo.stop()

    names["run"](servo, lambda: robot.q, send)
    robot.end()
    assert servo.ended == "at rest, without a target"
    assert robot.now < 100.6


def test_a_step_leaves_no_cycles() -> None:
    """So the garbage collector can be switched off."""
    tracker = ARM.track(Q0, PERIOD, velocity=1.0, acceleration=5.0, jerk=100.0, recover=False)
    tracker.step(HAND)

    def left() -> int:
        """Objects in cycles after 3,000 steps."""
        gc.collect()
        for k in range(3000):
            tracker.step(HAND @ kinseek.pose([0.0002 * k, 0.0, 0.0]) if k % 50 else None)
        return gc.collect()

    gc.disable()
    try:
        # Other threads of the test runner may leave some at any time, but the steps would leave theirs each time.
        assert min(left() for _ in range(3)) < 1000
    finally:
        gc.enable()
