"""Robots and scenes made for the collision tests: small, odd, and not from any file."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.limits import Limits
from rr1plan.robot import Geometry, Joint, Link, Mimic, Robot
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from rr1plan.transforms import pose


def _limits(n):
    return Limits(np.full(n, -3.2), np.full(n, 3.2), *(np.ones(n) for _ in range(4)))


def _pairs(*names):
    return frozenset(frozenset(p) for p in names)


def _wedge():
    points = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.1, 0], [0, 0, 0.12], [0.15, 0.08, 0.02]], dtype=float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return Mesh(points, faces, convex=True)


def _planar():
    """Two capsules in a plane."""
    rod = Geometry("rod", Capsule(0.02, 0.4), pose([0.25, 0, 0], rpy=[0, np.pi / 2, 0]))
    links = (Link("base"), Link("upper", collisions=(rod,)), Link("lower", collisions=(rod,)))
    joints = (
        Joint("shoulder", "revolute", "base", "upper"),
        Joint("elbow", "revolute", "upper", "lower", pose([0.5, 0, 0])),
    )
    names = ("shoulder", "elbow")
    return Robot(
        "planar", links, joints, names, _limits(2), {"home": np.zeros(2)}, {}, _pairs(("upper", "lower")), "lower"
    )


def _odd():
    """Revolute, prismatic, continuous, mimic and held joints, and every shape a link may have."""
    links = (
        Link("base", collisions=(Geometry("b", Box((0.2, 0.2, 0.1)), pose([0, 0, 0.05])),)),
        Link("slide", collisions=(Geometry("s", Cylinder(0.06, 0.3), pose([0, 0, 0.25])),)),
        Link(
            "arm",
            collisions=(
                Geometry("a", Capsule(0.05, 0.3), pose([0.2, 0, 0], rpy=[0, np.pi / 2, 0])),
                Geometry("knob", Sphere(0.08), pose([0.1, 0.05, 0])),
            ),
        ),
        Link("wrist", collisions=(Geometry("w", _wedge(), pose([0.02, 0, 0], rpy=[0.3, 0.2, 0.1])),)),
        Link("left", collisions=(Geometry("l", Box((0.02, 0.02, 0.1)), pose([0, 0, 0.05])),)),
        Link("right", collisions=(Geometry("r", Box((0.02, 0.02, 0.1)), pose([0, 0, 0.05])),)),
        Link("flap", collisions=(Geometry("f", Box((0.1, 0.04, 0.01)), pose([0.05, 0, 0])),)),
    )
    y = np.array([0.0, 1.0, 0.0])
    tilted = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    joints = (
        Joint("lift", "prismatic", "base", "slide", pose([0, 0, 0.1]), lower=-1, upper=1),
        Joint("turn", "continuous", "slide", "arm", pose([0, 0, 0.45])),
        Joint("bend", "revolute", "arm", "wrist", pose([0.4, 0, 0], rpy=[0.1, 0.4, 0]), tilted),
        Joint("grip", "prismatic", "wrist", "left", pose([0.15, 0.03, 0]), y, lower=0, upper=0.05),
        Joint("grip2", "prismatic", "wrist", "right", pose([0.15, -0.03, 0]), y, mimic=Mimic("grip", -1.0)),
        Joint("fold", "revolute", "wrist", "flap", pose([0, 0.1, 0.1]), y, mimic=Mimic("bend", -0.5, 0.3)),
    )
    never = _pairs(
        *[("base", "slide"), ("slide", "arm"), ("arm", "wrist"), ("wrist", "left"), ("wrist", "right")],
        *[("wrist", "flap"), ("left", "right")],
    )
    names = ("lift", "turn", "bend")
    home = {"home": np.array([0.0, 0.3, 0.2])}
    return Robot("odd", links, joints, names, _limits(3), home, {"grip": 0.02}, never, "wrist")


def _six():
    """A six-joint arm of capsules, cylinders and boxes."""
    axes = {"z": [0.0, 0.0, 1.0], "y": [0.0, 1.0, 0.0], "x": [1.0, 0.0, 0.0]}
    plan = [("z", 0.15), ("y", 0.15), ("y", 0.3), ("z", 0.25), ("y", 0.1), ("x", 0.1)]
    links, joints = [Link("l0", collisions=(Geometry("g", Cylinder(0.08, 0.1), pose([0, 0, 0.05])),))], []
    shapes = [Capsule(0.05, 0.08), Capsule(0.05, 0.2), Cylinder(0.045, 0.24), Box((0.07, 0.08, 0.12))]
    shapes += [Sphere(0.05), Box((0.03, 0.1, 0.08))]
    heights = [0.06, 0.15, 0.12, 0.06, 0.04, 0.06]
    for i, ((axis, reach), shape, height) in enumerate(zip(plan, shapes, heights, strict=True)):
        links.append(Link(f"l{i + 1}", collisions=(Geometry("g", shape, pose([0, 0, height])),)))
        joints.append(Joint(f"j{i}", "revolute", f"l{i}", f"l{i + 1}", pose([0, 0, reach]), np.array(axes[axis])))
    never = _pairs(*[(f"l{i}", f"l{j}") for i in range(7) for j in range(i + 1, min(i + 3, 7))])
    names = tuple(j.name for j in joints)
    home = {"home": np.array([0.0, 0.4, 0.8, 0.0, 0.5, 0.0])}
    return Robot("six", tuple(links), tuple(joints), names, _limits(6), home, {}, never, "l6")


@pytest.fixture(scope="session")
def planar():
    return _planar()


@pytest.fixture(scope="session")
def odd():
    return _odd()


@pytest.fixture(scope="session")
def six():
    return _six()


@pytest.fixture(scope="session")
def wedge():
    return _wedge()


@pytest.fixture(scope="session")
def cluttered(six):
    """The six-joint arm among all kinds of obstacles."""
    rng = np.random.default_rng(5)
    scene = Scene().with_arm("arm", six).with_obstacle("box", Box((0.3, 0.2, 0.5)), pose([0.6, 0, 0.2]))
    scene = scene.with_obstacle("ball", Sphere(0.12), [0.1, 0.55, 0.6])
    scene = scene.with_obstacle("post", Cylinder(0.05, 0.9), pose([-0.35, -0.35, 0.45], rpy=[0.1, 0.1, 0]))
    scene = scene.with_obstacle("bar", Capsule(0.03, 0.6), pose([0.0, -0.5, 0.7], rpy=[np.pi / 2, 0.5, 0]))
    return scene.with_obstacle("wedge", _wedge(), pose([-0.5, 0.3, 0.4], rpy=rng.normal(size=3)))
