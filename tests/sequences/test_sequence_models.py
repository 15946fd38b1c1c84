"""3-D models of sequences: objects move with the hand and stay where they are placed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp

pygltflib = pytest.importorskip("pygltflib", reason="pygltflib is not installed")


def test_carried_objects_are_where_the_plan_has_them(moved: rp.SequencePlan, tmp_path: Path) -> None:
    content = pygltflib.GLTF2().load(str(rp.save_glb(tmp_path / "moved.glb", moved)))
    node = next(i for i, node in enumerate(content.nodes) if node.name == "block")
    curves = {}
    for channel in content.animations[0].channels:
        if channel.target.node == node:
            sampler = content.animations[0].samplers[channel.sampler]
            curves[channel.target.path] = [_array(content, index) for index in (sampler.input, sampler.output)]
    assert set(curves) == {"translation", "rotation"}
    times, places = curves["translation"]
    expected = moved.object_poses("block", np.minimum(times, moved.trajectory.duration))
    np.testing.assert_allclose(places, expected[:, :3, 3], atol=1e-6)
    assert np.linalg.norm(places[-1] - places[0]) > 0.1
    assert times[-1] == pytest.approx(moved.trajectory.duration, abs=1e-5)


def _array(content: pygltflib.GLTF2, index: int) -> np.ndarray:
    accessor = content.accessors[index]
    columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
    start = content.bufferViews[accessor.bufferView].byteOffset
    flat = np.frombuffer(content.binary_blob(), "<f4", accessor.count * columns, start)
    return flat if columns == 1 else flat.reshape(-1, columns)
