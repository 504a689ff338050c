"""Plan for a scene, send the motion to a joint trajectory controller, then drive the tip by twists: a node for ROS 2.

Needs ROS 2 (rclpy, trajectory_msgs, geometry_msgs) and an arm whose controller has the joints of the plan's arm.urdf::

    python examples/14_ros2_plan_and_servo.py problems/space/swan-neck-in-space.toml
    ros2 topic pub -r 50 /ccm_opt/twist geometry_msgs/msg/TwistStamped "{twist: {linear: {x: 0.02}}}"

Every tick of the servo is sent with the certified braking after it: if no further message reaches the controller, the
arm brakes along it to rest. Twists are in the frame of the problem file, in m/s; those older than STALE are left.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import rclpy
import yaml
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import TwistStamped
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import ccm_opt
from ccm_opt.robot.frames import joint_names, revolute_angles

CONTROLLER = "joint_trajectory_controller"
PERIOD = 0.02
"""Duration of a tick of the servo [s]."""
STALE = 0.1
"""Age from which a twist is not followed [s]."""


def planned_message(folder: Path) -> JointTrajectory:
    """Return the motion in an output folder as a message, with the points that ccm-opt chose for controllers."""
    plan = yaml.safe_load((folder / "trajectory.yaml").read_text())
    points = []
    for given in plan["points"]:
        point = JointTrajectoryPoint(time_from_start=Duration(**given.pop("time_from_start")))
        for field, values in given.items():
            setattr(point, field, values)
        points.append(point)
    return JointTrajectory(joint_names=plan["joint_names"], points=points)


def braking_message(servo: ccm_opt.Servo) -> JointTrajectory:
    """Return the state at the end of a servo's last tick, and the braking after it, as a message."""
    arm, motion = servo.problem.arm, servo.braking
    positions = np.hstack((motion.base_positions, revolute_angles(arm, motion.bend_angles)))
    velocities = np.hstack((motion.base_velocities, revolute_angles(arm, motion.bend_velocities)))
    points = []
    for at, position, velocity in zip(motion.time + servo.period, positions, velocities, strict=True):
        seconds, nanoseconds = divmod(round(1e9 * at), 10**9)
        points.append(
            JointTrajectoryPoint(
                positions=position.tolist(),
                velocities=velocity.tolist(),
                time_from_start=Duration(sec=seconds, nanosec=nanoseconds),
            )
        )
    return JointTrajectory(joint_names=[*arm.coordinates.base_names, *joint_names(arm)], points=points)


class PlanAndServo(Node):
    """Sends a plan, then follows twists from its end."""

    def __init__(self, file: str) -> None:
        """Plan, and send the motion."""
        super().__init__("ccm_opt")
        self.output = self.create_publisher(JointTrajectory, f"/{CONTROLLER}/joint_trajectory", 10)
        self.create_subscription(TwistStamped, "/ccm_opt/twist", self.heard, 10)
        problem = ccm_opt.load_problem(file)
        plan = ccm_opt.solve(problem)
        with tempfile.TemporaryDirectory() as folder:
            self.output.publish(planned_message(plan.save(Path(folder) / "plan")))
        end = ccm_opt.JointPose.from_configuration(plan.trajectory.positions[-1], problem.arm.coordinates)
        self.servo = ccm_opt.Servo(replace(problem, start=end), period=PERIOD)
        self.still = np.zeros(problem.dimension)
        self.twist, self.until = None, 0.0
        self.ready = self.now() + plan.trajectory.duration
        self.create_timer(PERIOD, self.tick)

    def now(self) -> float:
        """Return the time of the node's clock [s]."""
        return 1e-9 * self.get_clock().now().nanoseconds

    def heard(self, message: TwistStamped) -> None:
        """Keep a twist."""
        linear, angular = message.twist.linear, message.twist.angular
        self.twist = ccm_opt.Twist((linear.x, linear.y, linear.z), (angular.x, angular.y, angular.z))
        if self.servo.problem.dimension == 2:
            self.twist = ccm_opt.Twist((linear.x, linear.y), angular.z)
        self.until = self.now() + STALE

    def tick(self) -> None:
        """Make a tick of the servo after the last twist; without a fresh one the arm runs along the braking it has."""
        if self.now() < self.ready:
            return
        if self.twist is None or self.now() > self.until:
            if self.servo.moving:
                self.servo.step(ccm_opt.Twist(self.still))
            return
        step = self.servo.step(self.twist)
        self.output.publish(braking_message(self.servo))
        for reason in step.reasons:
            self.get_logger().info(f"{step.lost:.0%} of the velocity is lost: {reason}", throttle_duration_sec=1.0)


def main() -> None:
    """Plan, send, servo until Ctrl-C."""
    rclpy.init()
    rclpy.spin(PlanAndServo(sys.argv[1]))


if __name__ == "__main__":
    main()
