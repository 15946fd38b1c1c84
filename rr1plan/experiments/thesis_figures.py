"""Figures of the thesis: the measurements of its experiments, and the poses of its arms.

Sources: the poses, the frames per second of many arms and the real-time factors of Gazebo with several arms are from
the thesis author's own packages (`EnviloN/rr1_*`, (c) 2023 Jan Chudy, MIT license). Labels of Table 6.6 in the printed
text are off by a column, so figures of many arms are from the raw data. The falling tower is Table 6.5 of the text. For
the static scene and the message latency (figure 6.6), the thesis has no numbers to compare with.
"""

from __future__ import annotations

# The computer on which its figures were measured.
HARDWARE = "Ryzen 7 3700X, RTX 2060 Super"

# Joints from the base to the hand [rad]; the last pose is also the first.
SEVEN_POSES: tuple[tuple[float, ...], ...] = (
    (-2.25, -0.39, 1.30, 0.05, 3.10, 1.25),
    (-0.35, -0.25, 1.15, -2.15, 1.80, -1.20),
    (1.40, 0.39, 0.95, 2.30, 2.65, -0.60),
    (-2.35, 0.32, -1.10, -1.50, 1.40, 0.50),
    (-0.80, -0.28, 0.70, 0.00, 2.10, -0.15),
    (-0.17, 0.37, -1.13, -1.14, 0.95, 1.09),
    (0.00, 0.00, 0.00, 0.00, 0.00, 0.00),
)
# Time of a move from one pose to the next [s].
MOVE_TIME = 4.0

# Real-time factor of Gazebo, which is never above 1, by the number of boats in the falling tower.
TOWER_FACTORS: dict[int, float] = {10: 1.0, 20: 0.98, 50: 0.40, 100: 0.19, 200: 0.08, 500: 0.03}

# Real-time factor of Gazebo by the number of arms; twelve were the most that could be started.
GAZEBO_FACTORS: dict[int, float] = dict(
    zip((1, 2, 3, 4, 5, 6, 8, 10, 12), (0.999, 0.999, 1.0, 0.999, 0.999, 1.0, 0.998, 0.989, 0.980), strict=True)
)

# Frames per second that Unity drew on Linux, by the number of arms.
UNITY_FRAMES: dict[int, float] = dict(
    zip(
        (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 120),
        (950, 422, 298, 232, 191, 160, 129, 98, 82, 72, 59, 52, 44, 29, 23, 19, 15, 12, 10),
        strict=True,
    )
)
