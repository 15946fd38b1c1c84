"""Files of paths alone, as earlier versions wrote them."""

from __future__ import annotations

import json
from pathlib import Path as FilePath

from rr1plan.export.plan_files import save_motion
from rr1plan.path import Path
from rr1plan.scene import Scene


def save_path(file: FilePath, path: Path, scene: Scene) -> FilePath:
    """Write a path and its scene; their entries are those of a motion without a trajectory."""
    data = json.loads(save_motion(file, scene, path=path).read_text())
    file.write_text(json.dumps(data | {"kind": "path"}))
    return file
