"""How far joints go: elbows and knees are hinges that neither overstretch nor close."""

ELBOW_HINGE = {"left": (0.0, -0.866, 0.5), "right": (0.0, 0.866, -0.5)}
"""About which the forearm bends, T-pose's axes: forwards and up, as in recorded motion. A knee
bends about +x."""
FARTHEST_BEND_RAD = 2.6
"""Of an elbow and a knee."""
