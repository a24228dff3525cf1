"""Send trajectory.goal.yaml to a joint_trajectory_controller, slowly by default.

    python3 ros2_follow.py trajectory.goal.yaml --action /joint_trajectory_controller/follow_joint_trajectory --pace 0.1

Needs ROS 2 with rclpy, control_msgs and sensor_msgs. Nothing is sent where the arm is not at the first point.
"""

import argparse
import sys

import rclpy
import yaml
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.wait_for_message import wait_for_message
from rosidl_runtime_py.set_message import set_message_fields
from sensor_msgs.msg import JointState

NEAR = 0.02  # [rad] of the arm from the first point
WAIT = 5.0  # [s] for the controller and for joint states


def slowed(goal, pace):
    """The same goal at `pace` times its speed; efforts are those of the full speed and are left out."""
    for point in goal["trajectory"]["points"]:
        stamp = point["time_from_start"]
        nanoseconds = round((stamp["sec"] * 10**9 + stamp["nanosec"]) / pace)
        point["time_from_start"] = {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
        point["velocities"] = [pace * x for x in point["velocities"]]
        point["accelerations"] = [pace * pace * x for x in point["accelerations"]]
        point["effort"] = []
    return goal


def distance(goal, state):
    """The largest distance of the arm's joints from the first point, rad."""
    here = dict(zip(state.name, state.position, strict=False))
    first = goal["trajectory"]["points"][0]["positions"]
    names = goal["trajectory"]["joint_names"]
    return max(abs(here.get(name, float("inf")) - x) for name, x in zip(names, first, strict=True))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("goal", metavar="trajectory.goal.yaml")
    parser.add_argument("--action", default="/joint_trajectory_controller/follow_joint_trajectory")
    parser.add_argument("--states", default="/joint_states")
    parser.add_argument("--pace", type=float, default=0.1, help="1.0 is as planned (0.1)")
    args = parser.parse_args()
    if not 0 < args.pace <= 1:
        parser.error("--pace: expected a number above 0 and at most 1")
    with open(args.goal, encoding="utf-8") as stream:
        goal = slowed(yaml.safe_load(stream), args.pace)
    rclpy.init()
    node = rclpy.create_node("energy_opt_follow")
    found, state = wait_for_message(JointState, node, args.states, time_to_wait=WAIT)
    if not found:
        sys.exit(f"no joint states on {args.states}")
    if distance(goal, state) > NEAR:
        sys.exit(f"the arm is {distance(goal, state):.3f} rad from the first point; move it there first")
    client = ActionClient(node, FollowJointTrajectory, args.action)
    if not client.wait_for_server(timeout_sec=WAIT):
        sys.exit(f"no controller at {args.action}")
    message = FollowJointTrajectory.Goal()
    set_message_fields(message, goal)
    sent = client.send_goal_async(message)
    rclpy.spin_until_future_complete(node, sent)
    handle = sent.result()
    if not handle.accepted:
        sys.exit("the controller refused the goal; its log says why")
    done = handle.get_result_async()
    rclpy.spin_until_future_complete(node, done)
    result = done.result().result
    sys.exit(0 if result.error_code == FollowJointTrajectory.Result.SUCCESSFUL else result.error_string or 1)


if __name__ == "__main__":
    main()
