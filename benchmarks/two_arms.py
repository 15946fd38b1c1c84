"""Random feasible queries on two RR1 that share a table, both arms moving at once.

    python benchmarks/two_arms.py [--count 100]

Requirements are those of `rr1_queries.py`: solved, certified, replayed without contact, tracked.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from queries import add_options, answer_queries, draw_queries, tell
from shared import make_parser, pin_to_core


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser("Random queries on two RR1", "two_arms")
    add_options(parser, 100, 600)
    parser.add_argument("--scene", default="rr1_pair", help="a scene with several RR1")
    args = parser.parse_args(argv)
    pin_to_core(args.core)
    queries = draw_queries([args.scene], args.count, args.seed, args.nodes)
    return tell(args, "two_arms", "Random queries on two RR1", answer_queries(args, queries))


if __name__ == "__main__":
    sys.exit(main())
