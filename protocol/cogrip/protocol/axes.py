"""Numbers of axes of a seat."""

PLACES, POSE_AXES = 3, 6  # axes of a place, and of a pose: a place [m] and a rotation vector [rad]
GRIP_AXES = PLACES + 1  # axes of a place and the opening of a gripper with force [m]
