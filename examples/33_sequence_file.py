"""A sequence written by hand: a TOML file lists the segments and names the scene."""

from pathlib import Path

import rr1plan as rp

scene = (
    rp.Scene(name="cell")
    .with_arm("rr1", rp.load_robot("rr1"))
    .with_obstacle("table", rp.Box((0.9, 0.9, 0.04)), [-0.2, 0, -0.02], color=(0.79, 0.73, 0.62, 1.0))
    .with_obstacle("block", rp.Box((0.04, 0.04, 0.06)), [-0.28, 0.15, 0.03], color=(0.15, 0.45, 0.85, 1.0), mass=0.15)
    .allow("rr1/base_link", "table")
)
rp.save_scene("33_cell.toml", scene)

file = Path("33_pick.toml")
file.write_text("""\
scene = "33_cell.toml"             # relative to this file, or a shipped scene

[[segments]]
pick_and_place = "block"           # eleven segments: open, above the block, approach, close, ...
place = [-0.28, -0.15, 0.03]

[[segments]]
pause = 0.2

[[segments]]                       # and once more by hand, a little way up and down again
move_gripper = { width = 0.06 }

[[segments]]
straight_line = { offset = [0, 0, 0.08], axes = "tool" }

[[segments]]
move_gripper = { around = "block" }

[[segments]]
attach = "block"

[[segments]]
straight_line = { offset = [0, 0, 0.05] }
allow = [["block", "table"]]       # pairs that may touch meanwhile

[[segments]]
straight_line = { offset = [0, 0, -0.05] }
allow = [["block", "table"]]

[[segments]]
detach = "block"

[[segments]]
move_gripper = { width = 0.06 }
allow = [["rr1", "block"]]

[[segments]]
straight_line = { offset = [0, 0, -0.08], axes = "tool" }

[[segments]]
free_motion = "home"
""")

# On the command line: rr1plan plan 33_pick.toml --output pick.json --html pick.html
plan = rp.plan_sequence(rp.load_segments(file), rng=0)
print(plan)
print(rp.simulate_sequence(plan))

# Errors are reported with their line.
file.with_stem("33_typo").write_text(file.read_text().replace('{ around = "block" }', '{ arround = "block" }'))
try:
    rp.load_segments("33_typo.toml")
except rp.FormatError as error:
    print(error)
