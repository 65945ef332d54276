"""What the maker states of a UR5e and its controller, in one place."""

import numpy as np

from breastscan.servo import Servo

PERIOD = 0.002
"""Of control and of the RTDE stream of an e-Series controller [s] [UR-rtde-guide]."""
ANGLE_LIMIT = np.deg2rad(360.0)
"""Of every joint, either way [rad] [UR-limits]."""
SPEED_LIMIT = np.deg2rad(180.0)
"""Of every joint [rad/s] [UR-limits]."""
SERVO = Servo(lookahead_time=0.03, gain=2000.0, transport=0.004)
"""servoj as it is called here: the shortest look-ahead time that the manual allows, so the least
lag, and the highest gain [UR-script]; two periods of transport, one until the program reads a
target and one until its effect is told [UR-lag]."""
RTDE_PORT, DASHBOARD_PORT = 30004, 29999
"""Fixed by the controller [UR-rtde-guide]."""
MODEL = "UR5"
"""What a UR5e's dashboard calls itself; its software tells it from the older UR5."""
OLDEST_SOFTWARE = 5
"""First major version of the e-Series."""
WITHOUT_DASHBOARD = 10
"""First major version that has no dashboard server."""
RUNNING = 2
"""`runtime_state` of a controller whose program runs [UR-rtde-guide]."""
PROTECTIVE_BIT = 2
SAFEGUARD_BIT = 4
SYSTEM_EMERGENCY_BIT = 5
ROBOT_EMERGENCY_BIT = 6
EMERGENCY_BIT = 7
"""Of `safety_status_bits` [UR-rtde-guide]."""
VIOLATION_BIT, FAULT_BIT = 8, 9
"""The others of them that end a motion."""
