"""Random feasible queries on one RR1, over every scene that ships with one.

    python benchmarks/rr1_queries.py [--count 1000]

Each has to be solved (or proven to have no valid end), certified by the referee, and replayed in MuJoCo
without contact and with a tracking error below 0.005 rad under the `sim` limits, 0.001 rad under `hardware`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from queries import add_options, answer_queries, draw_queries, tell
from shared import make_parser, pin_to_core

import rr1plan as rp


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser("Random queries on one RR1", "rr1_queries")
    add_options(parser, 1000, 600)
    parser.add_argument("--scenes", nargs="+", default=_single_arm_scenes(), help="the scenes to draw from")
    args = parser.parse_args(argv)
    pin_to_core(args.core)
    queries = draw_queries(args.scenes, args.count, args.seed, args.nodes)
    return tell(args, "rr1_queries", "Random queries on one RR1", answer_queries(args, queries))


def _single_arm_scenes() -> list[str]:
    scenes = {name: rp.load_scene(name) for name in rp.scene_names() if name.startswith("rr1_")}
    return [name for name, scene in scenes.items() if len(scene.arms) == 1]


if __name__ == "__main__":
    sys.exit(main())
