"""A bar is handed from one arm to another: both hold it for a moment, then the other one puts it down."""

import numpy as np

import rr1plan as rp

OPEN, BY, UP = 0.06, 0.06, [0, 0, 0.08]  # finger opening, distance from the middle of the bar, height above it [m]

robot = rp.load_robot("rr1")
scene = (
    rp.Scene(name="hand-over")
    .with_arm("left", robot, q="raised")
    .with_arm("right", robot, rp.transforms.pose([-0.74, 0, 0], rpy=[0, 0, np.pi]), q="raised")
    .with_obstacle("table", rp.Box((1.4, 0.9, 0.04)), [-0.37, 0, -0.02], color=(0.79, 0.73, 0.62, 1.0))
    .with_obstacle("bar", rp.Box((0.2, 0.03, 0.03)), [-0.33, 0.16, 0.015], color=(0.95, 0.7, 0.15, 1.0), mass=0.1)
    .allow("left/base_link", "table")
    .allow("right/base_link", "table")
)
meet = rp.transforms.pose([-0.37, 0.0, 0.16])
place = rp.transforms.pose([-0.41, -0.16, 0.015])


def above(scene: rp.Scene, arm: str, by: float) -> list[rp.PoseGoal]:
    """Poses of the tool above the bar, at a signed distance `by` from its middle [m]."""
    shift = by * scene.obstacles["bar"].pose[:3, 0] + UP
    return [rp.PoseGoal(g.frame, g.position + shift, g.quaternion) for g in rp.top_grasps(scene, "bar", arm=arm)]


def take(scene: rp.Scene, arm: str, by: float) -> list:
    return [
        rp.MoveGripper(width=OPEN, arm=arm),
        rp.FreeMotion(above(scene, arm, by), arm=arm),
        rp.StraightLine(offset=UP, axes="tool", arm=arm),
        rp.MoveGripper(around="bar", arm=arm),
    ]


def let_go(arm: str) -> list:
    release = rp.MoveGripper(width=OPEN, arm=arm, allow=[(arm, "bar")])
    return [release, rp.StraightLine(offset=UP, arm=arm), rp.FreeMotion("raised", arm=arm)]


on_table = [("bar", "table")]
segments = [
    *take(scene, "left", BY),
    rp.Attach("bar", arm="left"),
    rp.StraightLine(offset=UP, arm="left", allow=on_table),
    rp.FreeMotion(rp.PoseGoal("bar", meet), arm="left"),
    *take(scene.with_obstacle_at("bar", meet), "right", -BY),
    rp.Detach("bar"),
    rp.Attach("bar", arm="right"),
    *let_go("left"),
    rp.FreeMotion(rp.PoseGoal("bar", place @ rp.transforms.pose(UP)), arm="right"),
    rp.StraightLine(rp.PoseGoal("bar", place), arm="right", allow=on_table),
    rp.Detach("bar"),
    *let_go("right"),
]
plan = rp.plan_sequence(rp.Sequence(scene, segments), rng=0)
print(plan)
for event in plan.events:
    print(f"at {event.begin:.2f} s: {event.label}")
print(rp.simulate_sequence(plan))
page = plan.save_html("28_hand_over.html", options=rp.ViewOptions(title="A bar from one arm to the other"))
print(page, plan.save("28_hand_over.json"))
