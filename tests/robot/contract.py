"""What every `Robot` must do, be it simulated, recorded or real, as one suite.

A robot joins by a subclass, in a test file of its own, whose fixture `robot` yields it switched on
and at rest in free space:

    class TestSomeRobot(RobotContract):
        @pytest.fixture
        def robot(self): ...

The fixture may be shared by the tests of a class: each drives to `Q_START` first. `PLAYS_BACK`
marks a robot that can only repeat what it was told once, which is `stream` from `Q_START`; what
does not apply to it is skipped by name. `CLOCK_SLACK` is for a robot whose clock runs by itself.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from breastscan.errors import RobotError
from breastscan.interruptions import no_garbage_collection
from breastscan.robot.interface import Robot
from breastscan.servo import Servo
from sim.scene import HOME_Q

SPEED, ACCELERATION = 0.5, 1.0
"""Of the motions to the start [rad/s, rad/s^2]."""
STREAM_SPEED = np.array([0.1, -0.06, 0.08, 0.05, -0.1, 0.1])
"""Speed that the streamed motion comes up to [rad/s]."""
STREAM_RAMP = 0.2
"""Time in which it does [s]."""
STREAM_TIME = 0.8
"""Length of the streamed motion [s]."""


def stream(q, period):
    """Targets from rest at `q` [rad] up to `STREAM_SPEED`, a row a period."""
    t = period * np.arange(1, round(STREAM_TIME / period) + 1)
    way = np.where(t < STREAM_RAMP, 0.5 * t**2 / STREAM_RAMP, t - 0.5 * STREAM_RAMP)
    return q + way[:, None] * STREAM_SPEED


def send(robot, targets):
    """Stream targets as a scan does; the state after each."""
    states = []
    with no_garbage_collection():
        for q in targets:
            robot.servo_joint(q)
            states.append(robot.state())
    return states


class RobotContract:
    Q_START = HOME_Q
    PLAYS_BACK = False
    CLOCK_SLACK = 1e-9
    """Most by which the clock may run ahead of or behind one period a command, over a whole stream
    [s]."""
    LAG_SLACK = 0.003
    """Most by which the arm's lag may differ from what the robot says [s]."""
    SLOWED = 0.02
    """Joint speed to which the arm has come when `stop` or `move_joint` return [rad/s]: the last of
    it dies away."""
    STANDSTILL = 5e-3
    """Joint speed below which the arm rests [rad/s]."""
    ZERO_FORCE = 0.2
    """Most that the mean force may be in free space after a tare [N]."""

    @pytest.fixture
    def ready(self, robot) -> Iterator[Robot]:
        """The robot at rest at `Q_START`; left in the middle of a motion, it is stopped, before it
        is found to move without a target.
        """
        robot.move_joint(self.Q_START, SPEED, ACCELERATION)
        yield robot
        robot.stop()

    def needs_an_arm(self, what):
        if self.PLAYS_BACK:
            pytest.skip(f"does not apply to a recording: {what}")

    def test_it_is_a_robot(self, robot):
        assert isinstance(robot, Robot)

    def test_its_constants_are_a_period_a_rigid_tool_and_a_lag(self, robot):
        assert 0.001 < robot.period <= 0.01
        R_FP = robot.X_FP[:3, :3]
        np.testing.assert_allclose(R_FP @ R_FP.T, np.eye(3), atol=1e-9)
        np.testing.assert_array_equal(robot.X_FP[3], [0.0, 0.0, 0.0, 1.0])
        assert isinstance(robot.servo, Servo)
        assert robot.period <= robot.servo.lag < 0.2

    def test_a_state_is_finite_and_stands_at_the_start(self, ready):
        state = ready.state()
        assert state.q.shape == state.qd.shape == state.wrench_P.shape == (6,)
        assert np.isfinite(np.concatenate([state.q, state.qd, state.wrench_P])).all()
        np.testing.assert_allclose(state.q, self.Q_START, atol=1e-3)

    def test_a_state_once_given_does_not_change(self, ready):
        before = ready.state()
        kept = before.q.copy()
        send(ready, stream(self.Q_START, ready.period)[:50])
        np.testing.assert_array_equal(before.q, kept)

    def test_each_command_takes_one_period_of_the_robots_clock(self, ready):
        before = ready.state().time
        times = np.array([state.time for state in send(ready, stream(self.Q_START, ready.period))])
        assert (np.diff(times) > 0).all()
        assert abs(times[-1] - before - len(times) * ready.period) <= self.CLOCK_SLACK

    def test_the_sensors_count_goes_on(self, ready):
        counts = [state.sample for state in send(ready, stream(self.Q_START, ready.period))]
        assert (np.diff(counts) >= 0).all()
        assert counts[-1] > counts[0]

    def test_joints_trail_a_steady_motion_by_the_lag_that_is_said(self, ready):
        """By the robot's own clock, which may go on while a busy computer misses a period."""
        targets, before = stream(self.Q_START, ready.period), ready.state().time
        states = send(ready, targets)
        times, q = (
            np.array([state.time for state in states]),
            np.array([state.q for state in states]),
        )
        sent, ahead = np.append(before, times[:-1]) + ready.period, np.sign(STREAM_SPEED)
        steady = slice(len(targets) // 2, None)
        reached = [
            np.interp(s * at, s * aims, sent)
            for s, at, aims in zip(ahead, q[steady].T, targets.T, strict=True)
        ]
        lags = np.mean(times[steady] - reached, axis=1)
        np.testing.assert_allclose(lags, ready.servo.lag, atol=self.LAG_SLACK)

    @pytest.mark.parametrize(
        "offset", [np.nan, np.inf, 10.0, 0.5], ids=["nan", "inf", "beyond the limits", "jump"]
    )
    def test_a_target_that_no_arm_can_follow_is_refused_and_moves_nothing(self, ready, offset):
        before = ready.state().q
        with pytest.raises(RobotError):
            ready.servo_joint(self.Q_START + offset)
        np.testing.assert_allclose(ready.state().q, before, atol=1e-3)

    def test_a_motion_arrives_and_rests(self, ready):
        self.needs_an_arm("free motions are not in the log")
        q = self.Q_START + 0.05 * np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
        ready.move_joint(q, SPEED, ACCELERATION)
        state = ready.state()
        np.testing.assert_allclose(state.q, q, atol=1e-3)
        assert np.abs(state.qd).max() < self.SLOWED

    def test_a_motion_to_nowhere_is_refused(self, ready):
        with pytest.raises(RobotError):
            ready.move_joint(np.full(6, np.nan), SPEED, ACCELERATION)

    def test_tare_takes_the_wrench_to_zero(self, ready):
        self.needs_an_arm("its zero is that of the run")
        ready.tare()
        force_P = np.mean(
            [state.wrench_P[:3] for state in send(ready, [self.Q_START] * 100)], axis=0
        )
        assert np.abs(force_P).max() < self.ZERO_FORCE

    def test_stop_out_of_a_motion_rests_where_it_came_to(self, ready):
        self.needs_an_arm("nothing brakes, it stands still at its row")
        send(ready, stream(self.Q_START, ready.period))
        ready.stop()
        stopped = ready.state()
        assert np.abs(stopped.qd).max() < self.SLOWED
        later = send(ready, [stopped.q] * 100)[-1]
        np.testing.assert_allclose(later.q, stopped.q, atol=1e-3)
        assert np.abs(later.qd).max() < self.STANDSTILL
