"""The referee for JavaScript: `referee.wasm`, and memory for it.

Pages with a planner prove its motions with the referee's kernels, as `validate` does; these share no code with those of
the planners. `playback/viewer/page/referee.js` runs them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rr1plan.binding.memory_image import memory_image
from rr1plan.scene import Scene
from rr1plan.validation.compiled_search import TOUCH
from rr1plan.validation.moving_scene import moving_scene
from rr1plan.validation.referee import FARTHEST, MOST_SEARCHES
from rr1plan.validation.referee_kernels import LIBRARY, SOURCES, RefereeStruct


def referee_module() -> bytes:
    """The WebAssembly module; it imports `sin`, `cos` and `atan2` from "math".

    Raises:
        InstallationError: it is not built, or was built from other headers.
    """
    return LIBRARY.module("referee.wasm")


def referee_image(scene: Scene, joint_names: Sequence[str]) -> tuple[bytes, dict[str, object]]:
    """The memory image of a scene for motions of some joints, and the names of its elements.

    Roots of the image: `search`, without a motion; `limits` of the columns; `obstacle_shapes`, `obstacle_frames` and
    `obstacle_poses` of the model of all obstacles, for moving them with `rr1_fill_bodies`.

    Args:
        scene: The scene.
        joint_names: The columns of the motions: all joints of their arms.

    Returns:
        The image, and plain values that JSON can represent.

    Raises:
        InputError: shapes that cannot be compared.
    """
    moving = moving_scene(scene, tuple(joint_names))
    tables = moving.tables
    search = RefereeStruct(
        "RefereeSearch",
        column_count=len(joint_names),
        with_clearance=0,
        tolerance=1.0,
        touch=TOUCH,
        max_searches=MOST_SEARCHES,
        **moving.fields,
    )
    obstacles = tables.models[-1]
    rows, frames, poses = obstacles.placement
    image = memory_image(
        SOURCES,
        search=search,
        limits=("double", np.ascontiguousarray(moving.columns.table)),
        obstacle_model=obstacles.struct,
        obstacle_shapes=("ShapeRow", rows),
        obstacle_frames=("double", frames),
        obstacle_poses=("double", poses),
        # Rows of `search.models` are copies of these structs, so the targets of their pointers have to be named.
        **{f"model {i}": model.struct for i, model in enumerate(tables.models)},
    )
    elements = [moving.element(i)[1] for i in range(moving.first_element[-1])]
    return image, {"elements": elements, "obstacles": list(tables.obstacles), "farthest": FARTHEST}
