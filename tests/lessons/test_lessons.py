"""Lessons: their steps, figures and pages, teachers' own arms, and numbers in their texts."""

from __future__ import annotations

import copy
import re
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from lift_arm import lift_scene
from PIL import Image

import rr1plan as rp
from rr1plan.lessons import planning_lesson
from rr1plan.lessons.configuration_space_lesson import ConfigurationSpaceLesson
from rr1plan.lessons.edge_intervals import advance_edge, halve_edge
from rr1plan.lessons.no_path_lesson import NoPathLesson
from rr1plan.lessons.planar_outlines import planar_data
from rr1plan.lessons.torus_picture import torus_image
from rr1plan.lessons.two_arms_lesson import TwoArmsLesson
from rr1plan.lessons.workspace_lesson import WorkspaceLesson, solution_counts
from rr1plan.retiming.path_blends import clean

NAMES = rp.lesson_names()


@pytest.fixture(scope="module")
def lessons() -> dict[str, rp.Lesson]:
    return {name: rp.lesson(name) for name in NAMES}


def own_scene(joints: str = "RR") -> rp.Scene:
    """What a teacher writes."""
    arm = rp.planar_arm(joints, lengths=(0.8, 0.6), name="mine")
    scene = rp.Scene(name="own").with_arm("arm", arm)
    return scene.with_obstacle("wedge", rp.polygon_prism([(0.5, 0.5), (0.75, 0.45), (0.6, 0.8)]))


@pytest.mark.parametrize("name", NAMES)
def test_a_lesson_has_steps_with_well_formed_text(name: str, lessons: dict[str, rp.Lesson]) -> None:
    lesson = lessons[name]
    assert lesson.name == name
    assert len(lesson.steps) >= 4
    assert len({step.name for step in lesson.steps}) == len(lesson.steps)
    for step in lesson.steps:
        page = ElementTree.fromstring(f"<div>{step.text}</div>")
        words = "".join(page.itertext()).split()
        assert 15 <= len(words) <= 150, f"{step.name} has {len(words)} words"
        assert page.find("p") is not None
        assert step.q is None or len(step.q) == len(lesson.scene.joint_names())


@pytest.mark.parametrize("name", NAMES)
def test_a_lesson_draws_a_figure_for_slides(name: str, lessons: dict[str, rp.Lesson], tmp_path: Path) -> None:
    picture = np.asarray(Image.open(lessons[name].save_png(tmp_path / "a.png")).convert("RGB"))
    assert picture.shape[1] == 1950
    assert len(np.unique(picture @ [65536, 256, 1])) > 50


def test_the_name_of_a_dark_obstacle_is_light(lessons: dict[str, rp.Lesson]) -> None:
    figure = lessons["continuous_checking"].figure()
    names = {text.get_text(): text.get_color() for axes in figure.axes for text in axes.texts}
    assert names["post"] == "white"
    assert names["plate"] != "white"


def test_the_legend_of_the_workspace_is_striped_in_all_formats(lessons: dict[str, rp.Lesson]) -> None:
    (legend,) = lessons["workspace"].figure().legends
    (striped,) = [patch for patch in legend.get_patches() if patch.get_hatch()]
    assert striped.get_edgecolor()[3] == 1.0  # PDFs omit stripes of patches without a color of the edge


def test_a_figure_has_a_width_that_can_be_drawn_and_the_ending_of_its_format(
    lessons: dict[str, rp.Lesson], tmp_path: Path
) -> None:
    drawn = lessons["workspace"]
    assert drawn.figure(width=6.0).get_figwidth() == 6.0
    with pytest.raises(rp.InputError, match=r"ends in \.svg"):
        drawn.save_svg(tmp_path / "a.png")
    with pytest.raises(rp.InputError, match="at most 100"):
        drawn.figure(width=101)


def test_the_ending_of_a_file_says_what_of_a_lesson_is_saved(lessons: dict[str, rp.Lesson], tmp_path: Path) -> None:
    drawn = lessons["workspace"]
    assert drawn.save(tmp_path / "a.pdf").read_bytes() == drawn.save_pdf(tmp_path / "b.PDF").read_bytes()
    assert drawn.save(tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
    assert "data-step" in drawn.save(tmp_path / "a.html").read_text()
    with pytest.raises(rp.InputError, match=r"ends in \.png or \.svg or \.pdf or \.html"):
        drawn.save(tmp_path / "a.txt")


@pytest.mark.parametrize("name", NAMES)
def test_a_page_holds_every_step_and_loads_nothing(name: str, lessons: dict[str, rp.Lesson], tmp_path: Path) -> None:
    text = lessons[name].save_html(tmp_path / "lesson.html").read_text()
    for step in lessons[name].steps:
        assert f'data-step="{step.name}"' in text
        assert step.text in text
    assert f"<title>{lessons[name].title}</title>" in text
    assert "connect-src &#x27;none&#x27;" in text


def test_a_live_page_is_served(lessons: dict[str, rp.Lesson]) -> None:
    with lessons["workspace"].show(options=rp.ViewOptions(quiet=True)) as viewer:
        assert viewer.url.startswith("http")


# ---- a teacher's own -----------------------------------------------------------------------------


# The script of the configuration space draws the other arms.
@pytest.mark.parametrize(
    ("name", "joints"), [*(("workspace", joints) for joints in ("RR", "RP", "PR", "PP")), ("configuration_space", "PR")]
)
def test_lessons_take_arms_that_turn_and_slide(name: str, joints: str, tmp_path: Path) -> None:
    lesson = rp.lesson(name, own_scene(joints))
    assert lesson.scene.name == "own"
    assert lesson.save_png(tmp_path / "a.png").stat().st_size > 10_000
    assert lesson.save_html(tmp_path / "a.html").stat().st_size > 10_000


@pytest.mark.parametrize("limits", [None, [(-3.0, 3.0), (-3.0, 3.0)]], ids=["torus", "limits"])
def test_texts_speak_of_the_torus_of_joints_without_limits_alone(limits: list[tuple[float, float]] | None) -> None:
    arm = rp.planar_arm("RR", lengths=(1.0, 0.7), limits=limits)
    scene = rp.Scene(name="walls").with_arm("arm", arm)
    for name, sign in (("left", -1.0), ("right", 1.0)):
        wall = [(sign * 0.5, -0.1), (sign * 0.9, -0.1), (sign * 0.9, 0.1), (sign * 0.5, 0.1)]
        scene = scene.with_obstacle(name, rp.polygon_prism(wall))
    problem = rp.Problem(scene, [-1.6, 0.0], [1.6, 0.0])
    assert ("torus" in str(rp.lesson("no_path", scene, problem).steps)) == (limits is None)


def test_a_star_searches_a_torus_where_joints_have_no_limits(lessons: dict[str, rp.Lesson]) -> None:
    lesson: Any = copy.copy(lessons["planning"])
    assert "here on the torus" in str(planning_lesson._steps(lesson))
    lesson.picture = replace(lesson.picture, grid=replace(lesson.picture.grid, periodic=(False, False)))
    assert "torus" not in str(planning_lesson._steps(lesson))


def test_names_in_texts_stay_text(lessons: dict[str, rp.Lesson], planar2r: rp.Robot) -> None:
    lesson: Any = copy.copy(lessons["planning"])
    scene = rp.Scene(name="named").with_arm("<img src=x>", planar2r)
    lesson.problem = rp.Problem(scene, [0.0, 0.0], [0.5, 0.5])
    text = planning_lesson._steps(lesson)[0].text
    assert "&lt;img src=x&gt;/joint1" in text
    assert "<img" not in text


def test_a_lesson_about_a_query_takes_one_without_a_path(tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR", (1.0, 0.7)))
    wall = rp.Cylinder(0.15, 0.2)
    scene = scene.with_obstacle("left", wall, (0.0, 0.6, 0.0)).with_obstacle("right", wall, (0.0, -0.6, 0.0))
    lesson = rp.lesson("no_path", problem=rp.Problem(scene, [0.0, 0.3], rp.JointGoal([3.0, 0.3])))
    assert isinstance(lesson, NoPathLesson)
    assert lesson.cells.proves_no_path
    assert str(lesson.cells.resolution) in lesson.steps[-1].text
    with pytest.raises(rp.InputError, match=r"free ends that no path joins, .* same component"):
        rp.lesson("no_path", problem=rp.Problem(scene, [0.0, 0.3], rp.JointGoal([0.4, 0.3])))
    with pytest.raises(rp.InputError, match="free ends"):
        rp.lesson("no_path", problem=rp.Problem(scene, [np.pi / 2, 0.3], rp.JointGoal([0.4, 0.3])))


def test_planners_of_a_query_without_a_path_say_so_in_place_of_plots() -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR", (1.0, 0.7)))
    wall = rp.Cylinder(0.15, 0.2)
    scene = scene.with_obstacle("left", wall, (0.0, 0.6, 0.0)).with_obstacle("right", wall, (0.0, -0.6, 0.0))
    lesson: Any = rp.lesson("planning", problem=rp.Problem(scene, [0.0, 0.3], rp.JointGoal([3.0, 0.3])))
    texts = {step.name: step.text for step in lesson.steps}
    assert all("No planner found a path. No path exists: " in texts[name] for name in ("question", "race"))
    race, effect = lesson.figure().axes[-2:]
    assert "No planner found a path. No path exists: " in race.texts[0].get_text().replace("\n", " ")
    assert "RRT found no path" in effect.texts[0].get_text()
    assert "effect" not in vars(lesson)  # 120 searches that use all their samples
    with pytest.raises(rp.InputError, match=r"'motion' finds no path; .* No path exists: .* proven by certified cells"):
        rp.lesson("motion", problem=lesson.problem)


def test_planners_that_are_at_their_goal_check_no_edges() -> None:
    lesson = rp.lesson("planning", problem=rp.Problem(own_scene(), [0.1, 0.1], rp.JointGoal([0.1, 0.1])))
    assert "the start is the goal" in lesson.figure().axes[-1].texts[0].get_text().replace("\n", " ")


def two_arms(first: str, second: str) -> rp.Scene:
    """Two arms that face each other."""
    scene = rp.Scene(name="own")
    for name, joints, base in (("one", first, rp.transforms.pose([-1.1, 0, 0])), ("two", second, FACING)):
        limits = [(-2.8, 2.8) if kind == "R" else (0.0, 0.5) for kind in joints]
        scene = scene.with_arm(name, rp.planar_arm(joints, (1.0, 0.7), limits=limits), base=base)
    return scene.with_obstacle("disc", rp.Cylinder(0.15, 0.2), (0.0, -1.4, 0.0))


def test_scripts_of_lessons_hide_no_class_of_the_viewer() -> None:
    package = Path(rp.__file__).parent
    viewer, lesson = (
        {
            name
            for file in (package / folder).glob("*.js")
            for name in re.findall(r"^class (\w+)", file.read_text(), re.M)
        }
        for folder in ("playback/viewer/page", "lessons/page")
    )
    assert "Kinematics" in viewer
    assert not viewer & lesson


FACING = rp.transforms.pose([1.1, 0.1, 0.0], rpy=[0.0, 0.0, np.pi])


@pytest.mark.parametrize(
    ("joints", "goals", "names"),
    [
        # Far from each other, one after the other, and past each other only if both are planned together.
        (("RR", "RR"), {"one": [2.0, 0.5], "two": [2.0, 0.5]}, ["at_once"]),
        (("RR", "RP"), {"one": [-1.3, 0.9], "two": [-1.2, 0.3]}, ["at_once", "two_first", "joint"]),
        (("RR", "RR"), {"one": [-0.8, 0.3], "two": [-0.8, 0.3]}, ["at_once", "joint"]),
    ],
)
def test_two_arms_of_ones_own_get_paths_and_schedules(
    joints: tuple[str, str], goals: dict[str, list[float]], names: list[str], tmp_path: Path
) -> None:
    scene = two_arms(*joints)
    apart = names == ["at_once"]
    starts = {name: [1.5, 0.5] if apart else [0.8, 0.2] for name in scene.arms}
    lesson = rp.lesson("two_arms", problem=rp.Problem(scene, starts, goals))
    assert isinstance(lesson, TwoArmsLesson)
    pair, schedules = lesson.pairs["own"], lesson.schedules["own"]
    assert [schedule.name for schedule in schedules] == names
    checker = rp.CollisionChecker(scene)
    for schedule in schedules:
        times = np.linspace(0.0, schedule.duration, 1000)
        curve = schedule.curve
        if curve is not None:
            assert pair.is_blocked(curve) == (schedule.tone == "bad")
            places = np.column_stack([np.interp(times, curve.times, curve.places[:, k]) for k in range(2)])
            q = np.hstack(pair.at(places))
        else:
            q = np.column_stack([np.interp(times, schedule.times, column) for column in schedule.joint.T])
        np.testing.assert_allclose(q[0], [*starts["one"], *starts["two"]], atol=1e-9)
        np.testing.assert_allclose(q[-1], [*goals["one"], *goals["two"]], atol=1e-9)
        assert all(map(checker.is_free, q)) == (schedule.tone == "good")
        assert schedule.title in lesson.steps[-1].text
    figure = lesson.figure()
    slides = joints[1] == "RP"
    assert figure.axes[2].get_ylabel() == ("d₂ [m]" if slides else "θ₂ [rad]")
    assert figure.axes[3].get_xlabel() == "path of one [rad]"
    assert figure.axes[3].get_ylabel() == ("path of two" if slides else "path of two [rad]")
    assert lesson.save_png(tmp_path / "a.png").stat().st_size > 10_000


def test_a_path_of_two_arms_is_drawn_across_the_seam() -> None:
    scene = rp.Scene()
    for name, x in (("one", 0.0), ("two", 5.0)):
        scene = scene.with_arm(name, rp.planar_arm("RR", (1.0, 0.7)), base=rp.transforms.pose([x, 0.0, 0.0]))
    starts, goals = {"one": [2.5, 0.5], "two": [0.5, 0.5]}, {"one": [4.5, 0.5], "two": [0.8, 0.5]}
    axes = rp.lesson("two_arms", problem=rp.Problem(scene, starts, goals)).figure().axes[1]
    assert np.abs([axes.get_xlim(), axes.get_ylim()]).max() == pytest.approx(np.pi)
    points = np.vstack([line.get_xydata() for line in axes.lines])
    assert np.abs(points).max() <= np.pi + 1e-9


def test_two_arms_that_the_lesson_cannot_be_about_are_refused() -> None:
    scene = two_arms("RR", "RR")
    starts = {name: [0.8, 0.2] for name in scene.arms}
    with pytest.raises(rp.InputError, match="is about a query of two arms"):
        rp.lesson("two_arms", scene)
    with pytest.raises(rp.InputError, match="2 arms, 2 of them such, and 1 with a goal"):
        rp.lesson("two_arms", problem=rp.Problem(scene, None, {"one": [0.1, 0.0]}))
    alone = rp.Scene().with_arm("one", scene.arms["one"].robot)
    with pytest.raises(rp.InputError, match="this one has 1 arm, 1 of them such, and 1 with a goal"):
        rp.lesson("two_arms", problem=rp.Problem(alone, None, [0.1, 0.0]))
    with pytest.raises(rp.InputError, match="2 arms, 0 of them such"):
        rp.lesson("two_arms", problem=rp.load_problems("rr1_pair")["change_places"])
    with pytest.raises(rp.InputError, match="cannot be at both goals: 'one/link1' and 'two/link2' overlap"):
        rp.lesson("two_arms", problem=rp.Problem(scene, starts, {"one": [0.0, 0.0], "two": [0.08, 0.0]}))
    with pytest.raises(rp.InputError, match="arm 'one' is at its goal, expected paths of both"):
        rp.lesson("two_arms", problem=rp.Problem(scene, starts, {"one": starts["one"], "two": [-0.8, 0.3]}))
    with pytest.raises(rp.InputError, match=r"arm 'one' gets no path, .* 'one/link2' and 'disc' overlap"):
        rp.lesson("two_arms", problem=rp.Problem(scene, starts, {"one": [-0.9, 0.0], "two": [0.8, 0.0]}))


def test_a_lesson_about_distances_needs_an_obstacle() -> None:
    alone = rp.Scene().with_arm("arm", rp.planar_arm("RR"))
    with pytest.raises(rp.InputError, match="'continuous_checking' is about distances; add an obstacle"):
        rp.lesson("continuous_checking", problem=rp.Problem(alone, [0.0, 0.3], [0.4, 0.3]))
    for decide in (halve_edge, advance_edge):
        with pytest.raises(rp.InputError, match="no distances; add an obstacle"):
            decide(rp.CollisionChecker(alone), [0.0, 0.3], [0.4, 0.3])


def test_a_lesson_about_distances_takes_polygons_and_refuses_what_is_not_flat() -> None:
    corners = [(0.5, 0.5), (0.8, 0.4), (0.6, 0.9)]
    alone = rp.Scene().with_arm("arm", rp.planar_arm("RR"))
    wedge = alone.with_obstacle("wedge", rp.polygon_prism(corners))
    (outline,) = planar_data(rp.CollisionChecker(wedge))["outlines"]["wedge"]
    assert {tuple(np.round(point, 9)) for point in outline["points"]} == set(corners)
    lesson = rp.lesson("continuous_checking", problem=rp.Problem(wedge, [0.0, 0.3], [0.4, 0.3]))
    assert "wedge" in str(lesson.page_content()[1].panels)
    corner = rp.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    tilted = rp.transforms.pose([2.0, 2.0, 0.0], rpy=(0.2, 0.0, 0.0))
    for shape in (rp.HalfSpace((0.0, 1.0, 0.0), -3.0), corner, rp.polygon_prism(corners)):
        scene = alone.with_obstacle("odd", shape, tilted)
        with pytest.raises(rp.InputError, match=r"'odd' has a .*, expected spheres"):
            rp.lesson("continuous_checking", problem=rp.Problem(scene, [0.0, 0.3], [0.4, 0.3]))


@pytest.mark.parametrize("name", ["planning", "potential_fields", "motion", "continuous_checking"])
def test_an_arm_of_one_joint_is_refused(name: str) -> None:
    robot = rp.load_robot("planar2r", joints=rp.load_robot("planar2r").joint_names[:1])
    problem = rp.Problem(rp.Scene().with_arm("arm", robot), [0.1], [0.2])
    with pytest.raises(rp.InputError, match=r"has 1 joint\b"):
        rp.lesson(name, problem=problem)


def test_wrong_questions_are_refused() -> None:
    scene = own_scene()
    problem = rp.Problem(scene, [0.0, 0.0], rp.JointGoal([0.1, 0.0]))
    with pytest.raises(rp.UnknownNameError, match="Did you mean 'workspace'"):
        rp.lesson("work_space")
    with pytest.raises(rp.InputError, match="arm of two joints in a horizontal plane, and arm 'rr1' is none"):
        rp.lesson("workspace", rp.load_scene("rr1_table"))
    with pytest.raises(rp.InputError, match="'workspace' has no query"):
        rp.lesson("workspace", problem=problem)
    with pytest.raises(rp.InputError, match="is about a query"):
        rp.lesson("no_path", scene)
    with pytest.raises(rp.InputError, match=r"pass it as lesson\('planning', problem=\.\.\.\)"):
        rp.lesson("planning", *list[Any]([problem]))
    moved = scene.with_obstacle_at("wedge", [0.1, 0.0, 0.0])
    with pytest.raises(rp.InputError, match=r"problem is for another scene, .*'wedge' moved by 100 mm; give its own"):
        rp.lesson("workspace", moved, problem)
    with pytest.raises(rp.InputError, match="'workspace' has no query"):
        rp.lesson("workspace", own_scene(), problem)  # equal content is no other scene


# ---- the numbers ---------------------------------------------------------------------------------


def elbows(lengths: tuple[float, float], point: np.ndarray) -> list[np.ndarray]:
    """Both configurations of a 2R arm by the intersection of two circles."""
    a, c = lengths
    far = np.linalg.norm(point)
    along = (a**2 - c**2 + far**2) / (2 * far)
    if a**2 < along**2:
        return []
    fore, up = point / far, np.array([-point[1], point[0]]) / far
    found = []
    for side in (1.0, -1.0):
        elbow = along * fore + side * np.sqrt(a**2 - along**2) * up
        first, second = np.arctan2(elbow[1], elbow[0]), np.arctan2(*(point - elbow)[::-1])
        found.append(np.array([first, (second - first + np.pi) % (2 * np.pi) - np.pi]))
    return found


def test_an_arm_without_limits_is_not_told_to_leave_them(lessons: dict[str, rp.Lesson]) -> None:
    turning = rp.lesson("workspace", rp.Scene().with_arm("arm", rp.planar_arm("RR")))
    for lesson, limited in ((lessons["workspace"], True), (turning, False)):
        text = next(step.text for step in lesson.steps if step.name == "limits")
        assert ("would leave its limits" in text) == limited


def test_counted_solutions_are_those_of_circles_and_coal(lessons: dict[str, rp.Lesson]) -> None:
    lesson = lessons["workspace"]
    assert isinstance(lesson, WorkspaceLesson)
    grid, checker = lesson.picture.grid, rp.CollisionChecker(lesson.scene)
    steps = [float(axis[1] - axis[0]) for axis in grid.axes]
    points = np.random.default_rng(3).uniform(-1.75, 1.75, (700, 2))
    counts = solution_counts(lesson.picture, lesson.arm, points)
    seen = []
    for point, count in zip(points, counts, strict=True):
        solutions = elbows((1.0, 0.7), point)
        around = [q + np.array([i, j]) * steps for q in solutions for i in (-1, 0, 1) for j in (-1, 0, 1)]
        free = [checker.within_limits(q) and checker.is_free(q) for q in around]
        if any(len(set(free[k : k + 9])) > 1 for k in range(0, len(free), 9)):
            continue  # the boundary of an image crosses the cell
        assert count == sum(free[::9])
        seen.append(count)
    assert len(seen) > 600
    assert min(np.bincount(seen, minlength=3)) > 50


def test_layers_that_are_ignored_do_not_count(lessons: dict[str, rp.Lesson]) -> None:
    lesson = lessons["workspace"]
    assert isinstance(lesson, WorkspaceLesson)
    names = tuple(lesson.picture.grid.layers)
    points = np.random.default_rng(0).uniform(-1.8, 1.8, (2000, 2))
    everything = solution_counts(lesson.picture, lesson.arm, points, names)
    far = np.linalg.norm(points, axis=1)
    np.testing.assert_array_equal(everything, np.where((far > 0.3) & (far < 1.7), 2, 0))
    limited = solution_counts(lesson.picture, lesson.arm, points, ("disc", "plate"))
    assert (limited <= everything).all()
    assert (solution_counts(lesson.picture, lesson.arm, points) <= limited).all()
    # The inner rim under the limit of the second joint, by the law of cosines.
    inner = np.sqrt(1.0 + 0.49 + 2 * 0.7 * np.cos(2.3))
    assert far[limited > 0].min() == pytest.approx(inner, abs=0.03)


def test_the_motion_of_sliding_joints_is_in_meters() -> None:
    arm = rp.planar_arm("PP", (0.6, 0.8), limits=((0.0, 1.5), (0.1, 0.8)))
    scene = rp.Scene(name="gantry").with_arm("arm", arm, q=(0.2, 0.2))
    scene = scene.with_obstacle("disc", rp.Cylinder(0.1, 0.1), (0.7, 0.3, 0.0))
    lesson = rp.lesson("motion", scene, rp.Problem(scene, [0.2, 0.2], rp.JointGoal([1.4, 0.3])))
    texts = {step.name: " ".join(step.text.split()) for step in lesson.steps}
    assert f"{lesson.unit} long, and has no time" in texts["path"]
    assert "at 10 m/s³" in texts["cost"]
    figure = lesson.figure()
    labels = {part for axes in figure.axes for part in (axes.get_xlabel(), axes.get_ylabel(), axes.get_title("left"))}
    assert {"s [m]", "ṡ [m/s]", "velocity [m/s]", "jerk limit [m/s³]"} <= labels
    assert not any("rad" in text for text in (*texts.values(), *labels))


def test_phases_that_do_not_occur_have_no_number() -> None:
    # On 0.8 mm, neither the speed nor the acceleration gets to its limit.
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PP", (2e-3, 1.6e-3)), q=(1e-4, 1e-4))
    figure = rp.lesson("motion", problem=rp.Problem(scene, [1e-4, 1e-4], rp.JointGoal([1.7e-3, 1e-3]))).figure()
    position = figure.axes[3]
    assert [text.get_text() for text in position.texts] == ["1", "3", "5", "7"]
    assert len({patch.get_facecolor() for patch in position.patches}) == 2


def test_texts_on_kinematics_are_about_the_arm_shown(tmp_path: Path) -> None:
    texts = {
        kinds: {step.name: " ".join(step.text.split()) for step in rp.lesson("kinematics", own_scene(kinds)).steps}
        for kinds in ("RR", "RP", "PR", "PP")
    }
    assert "sin θ" in texts["RR"]["singularities"]
    assert "1 rad/s: perpendicular to the line" in texts["RR"]["jacobian"]
    assert "that of the prismatic one is its axis" in texts["RP"]["jacobian"]
    assert "right angle to the rail" in texts["PR"]["singularities"]
    assert "no singularities" in texts["PP"]["singularities"]
    assert "+ -" not in texts["PR"]["dh"]
    # The elbow of the shipped arm is straight at zero; that of this arm is not.
    text = Path(rp.load_robot("planar2r").source).read_text()
    assert '<origin xyz="1 0 0"/>' in text
    (tmp_path / "turned.urdf").write_text(text.replace('<origin xyz="1 0 0"/>', '<origin xyz="1 0 0" rpy="0 0 0.5"/>'))
    lesson: Any = rp.lesson("kinematics", rp.Scene().with_arm("arm", rp.load_robot(tmp_path / "turned.urdf")))
    assert "sin θ" not in str(lesson.steps)
    assert lesson.determinant(np.array(lesson.steps[-1].q)) == pytest.approx(0.7 * np.sin(0.02), abs=1e-6)


@pytest.mark.parametrize(("lower", "shown"), [(-1.0, True), (0.1, False)])
def test_texts_speak_of_dashed_lines_of_singularities_that_are_drawn(lower: float, shown: bool) -> None:
    arm = rp.planar_arm("RR", (1.0, 0.8), limits=[(-2.0, 1.0), (lower, 2.3)])
    lesson = rp.lesson("kinematics", rp.Scene().with_arm("arm", arm, q=(0.3, 0.5)))
    assert ("dashed lines" in lesson.steps[-1].text) == shown
    assert ("limits of this arm exclude" in lesson.steps[-1].text) != shown


@pytest.mark.parametrize("kinds", ["RR", "PP"])
@pytest.mark.parametrize("size", [0.1, 10.0])
def test_ellipses_and_frames_grow_with_the_arm(size: float, kinds: str) -> None:
    lesson: Any = rp.lesson("kinematics", rp.Scene().with_arm("arm", rp.planar_arm(kinds, (size, 0.7 * size))))
    figure = lesson.figure()
    ellipses = [patch for patch in figure.axes[0].patches if hasattr(patch, "width") and patch.get_label() is not None]
    wide = max(patch.width for patch in ellipses if patch.get_label() == "velocity ellipse")
    reach = {"RR": 1.7, "PP": 0.6}[kinds] * size
    assert 0.2 < wide / reach < 0.6
    arrows = [text for text in figure.axes[0].texts if getattr(text, "arrowprops", None)]
    assert max(np.linalg.norm(np.subtract(arrow.xy, arrow.xyann)) for arrow in arrows) / reach == pytest.approx(
        0.165, 0.1
    )


@pytest.mark.parametrize(
    ("kinds", "q", "shown"),
    # A rod that slides backward through its sleeve, carriages on the other side of the tool, and a gantry.
    [("RP", (0.6, 0.3), False), ("PR", (0.1, 0.8), False), ("PR", (0.1, 1.2), True), ("PP", (0.2, 0.2), False)],
)
def test_the_figure_shows_another_solution_within_the_limits(kinds: str, q: tuple[float, float], shown: bool) -> None:
    lesson = rp.lesson("kinematics", rp.Scene().with_arm("arm", rp.planar_arm(kinds, (0.8, 0.6)), q=q))
    axes = lesson.figure().axes[0]
    assert ("the other solution" in [line.get_label() for line in axes.lines]) == shown
    assert ("both solutions" in axes.get_title("left")) == shown


def test_the_figure_of_a_gantry_shows_its_range() -> None:
    lesson: Any = rp.lesson("kinematics", rp.Scene().with_arm("arm", rp.planar_arm("PP", (1.0, 0.5))))
    low, high = lesson.figure().axes[0].get_xlim()
    assert low < 0.0
    assert 1.0 < high < 1.5


def test_the_figure_on_six_joints_has_meters_for_a_sliding_one(tmp_path: Path) -> None:
    lesson: Any = rp.lesson("six_joints", lift_scene(tmp_path))
    axes = lesson.figure().axes
    assert (axes[0].get_xlabel(), axes[0].get_ylabel()) == ("d₁ [m]", "θ₃ [rad]")
    assert lesson.share.share < 0.5
    assert axes[5].get_ylim() == (0.0, 1.0)


def test_the_text_on_solutions_counts_one_as_well_as_many() -> None:
    lesson = rp.lesson("six_joints", rp.load_scene("rr1_table"))
    text = next(step.text for step in lesson.steps if step.name == "solutions")
    assert "4 solutions: 1 within the joint limits, 1 also free of contact." in " ".join(text.split())


def test_texts_on_limits_fit_the_number_of_solutions() -> None:
    def limits(kinds: str, ranges: Any = None) -> str:
        scene = rp.Scene().with_arm("arm", rp.planar_arm(kinds, limits=ranges))
        return next(step.text for step in rp.lesson("workspace", scene).steps if step.name == "limits")

    both = [(-2.0, 2.0), (-2.0, 2.0)]
    assert "<b>once</b>" in limits("RR", both)
    assert "once" not in limits("RP", [(-2.0, 2.0), (0.2, 0.8)])
    assert "gray" not in limits("RR")


def test_the_whole_interval_of_the_free_share_is_drawn() -> None:
    lesson: Any = rp.lesson("six_joints", rp.load_scene("rr1_window"))
    axes = lesson.figure().axes[5]
    (interval,) = axes.collections
    lowest = interval.get_datalim(axes.transData).ymin
    assert lowest < 0.5 < lesson.share.share
    assert axes.get_ylim()[0] <= lowest


@pytest.mark.parametrize("name", ["planning", "motion"])
def test_maps_of_joints_with_different_units_are_square(name: str) -> None:
    # 1 rad is not 1 m: with equal scales the map of this arm would be a strip.
    problem = rp.Problem(own_scene("PR"), [0.1, 0.1], rp.JointGoal([0.2, 0.1]))
    figure = rp.lesson(name, problem=problem).figure()
    figure.draw_without_rendering()
    box = figure.axes[0].get_window_extent()
    assert box.width == pytest.approx(box.height)


def test_labels_of_counts_do_not_overlap() -> None:
    # Some planners check a few edges, others more than a thousand.
    problem = rp.Problem(own_scene(), [0.1, 0.1], rp.JointGoal([0.0, 0.2]))
    race = rp.lesson("planning", problem=problem).figure(width=13.0)
    race.draw_without_rendering()
    for axes in race.axes[-2:]:
        boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
        low, high = axes.get_window_extent().x0 - 20.0, axes.get_window_extent().x1 + 20.0
        shown = [box for box in boxes if low < box.x0 and box.x1 < high]
        assert len(shown) >= 3
        assert all(one.x1 < two.x0 for one, two in pairwise(shown))


@pytest.mark.parametrize(("joints", "step"), [("RR", "12°"), ("PR", "0.21"), ("PP", "0.168 m")])
def test_titles_on_checking_have_the_unit_of_the_joints(joints: str, step: str) -> None:
    problem = rp.Problem(own_scene(joints), [0.05, 0.05], rp.JointGoal([0.7, 0.5]))
    figure = rp.lesson("continuous_checking", problem=problem).figure()
    figure.draw_without_rendering()
    samples, halving = (axes.get_title("left") for axes in figure.axes)
    assert samples.startswith(f"steps of at most {step}: ")
    assert "1 distances" not in halving
    assert "1 intervals" not in halving
    assert all(axes.get_tightbbox().x1 <= figure.bbox.x1 for axes in figure.axes)


def test_obstacles_far_away_do_not_make_the_arm_small() -> None:
    scene = own_scene().with_obstacle("far", rp.Cylinder(0.1, 0.1), (9.0, 0.0, 0.0))
    problem = rp.Problem(scene, [0.05, 0.05], rp.JointGoal([0.7, 0.5]))
    axes = rp.lesson("continuous_checking", problem=problem).figure().axes[0]
    assert axes.get_xlim()[1] < 2.0
    assert [text.get_text() for text in axes.texts] == ["wedge"]


@pytest.mark.parametrize("name", ["workspace", "configuration_space", "continuous_checking"])
@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_names_of_obstacles_are_on_the_picture_and_do_not_overlap(name: str, size: float) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR", (0.4 * size, 1.9 * size)), q=(0.3, 0.5))
    box = rp.Box(size * np.array([0.3, 0.4, 0.2]))
    for k, title in enumerate(("a long name of a box beside another", "touching it")):
        scene = scene.with_obstacle(title, box, [size * (0.3 * k - 1.0), 0.8 * size, 0.0])
    scene = scene.with_obstacle("bar", rp.Box(size * np.array([0.8, 0.02, 0.2])), [size, -size, 0.0])
    scene = scene.with_obstacle("top", rp.Box(size * np.array([0.8, 0.02, 0.2])), [size, 2.2 * size, 0.0])
    problem = rp.Problem(scene, [0.3, 0.5], rp.JointGoal([-0.1, 0.9]))
    lesson = rp.lesson(name, problem=problem) if name == "continuous_checking" else rp.lesson(name, scene)
    figure = lesson.figure()
    figure.draw_without_rendering()
    axes = figure.axes[0]
    named = {text.get_text(): text.get_window_extent() for text in axes.texts}
    assert {"bar", "top"} <= set(named)
    for one, two in combinations(named.values(), 2):
        assert not one.overlaps(two)
    inside = axes.get_window_extent().padded(1.0)
    assert all(inside.contains(b.x0, b.y0) and inside.contains(b.x1, b.y1) for b in named.values())


@pytest.mark.parametrize("name", ["configuration_space", "kinematics"])
@pytest.mark.parametrize(("joints", "lengths"), [("RR", (0.1, 0.08)), ("PR", (0.8, 0.6)), ("PP", (0.04, 0.03))])
def test_labels_of_axes_do_not_overlap(name: str, joints: str, lengths: tuple[float, float]) -> None:
    figure = rp.lesson(name, rp.Scene().with_arm("arm", rp.planar_arm(joints, lengths))).figure()
    figure.draw_without_rendering()
    for axes in figure.axes:
        boxes = [label.get_window_extent() for label in axes.get_xticklabels() if label.get_text()]
        assert all(one.x1 < two.x0 for one, two in pairwise(boxes))


@pytest.mark.parametrize("name", ["workspace", "kinematics"])
def test_labels_of_millimeters_do_not_overlap(name: str) -> None:
    figure = rp.lesson(name, rp.Scene().with_arm("arm", rp.planar_arm("RR", (2e-3, 1.4e-3)))).figure()
    figure.draw_without_rendering()
    axes = figure.axes[0]
    boxes = [label.get_window_extent() for label in axes.get_xticklabels()]
    assert all(one.x1 < two.x0 for one, two in pairwise(boxes))
    assert axes.xaxis.get_offset_text().get_text() == "1e−3"


def test_the_legend_of_a_path_hides_nothing_of_its_map(lessons: dict[str, rp.Lesson]) -> None:
    figure = lessons["motion"].figure()
    figure.draw_without_rendering()
    axes = figure.axes[0]
    legend = axes.get_legend()
    assert legend is not None
    # A pixel of both may be the same after rounding.
    assert legend.get_window_extent().y1 <= axes.get_window_extent().y0 + 1.0


@pytest.mark.parametrize(("joints", "unit"), [("PP", " m"), ("PR", "")])
def test_lengths_have_the_unit_of_the_joints(joints: str, unit: str) -> None:
    scene = own_scene(joints)
    problem = rp.Problem(scene, [0.1, 0.1], rp.JointGoal([0.2, 0.1]))
    lesson: Any = rp.lesson("planning", problem=problem)
    assert lesson.unit == unit
    assert " rad" not in str(lesson.steps)
    edges = rp.lesson("continuous_checking", problem=problem)
    assert "prismatic joint" in str(edges.steps)


def test_numbers_in_texts_are_those_of_the_panels(lessons: dict[str, rp.Lesson]) -> None:
    motion: Any = lessons["motion"]
    text = next(step.text for step in motion.steps if step.name == "path")
    assert f"{len(clean(motion.raw))} waypoints" in text


def test_texts_on_six_joints_name_no_robot_and_count_moving_joints(lessons: dict[str, rp.Lesson]) -> None:
    steps = str(lessons["six_joints"].steps)
    assert "RR1" not in steps
    assert "about y moves 6 joints, about z moves 1 joint" in steps


def test_lessons_about_one_arm_refuse_two() -> None:
    two = rp.load_scene("planar2r_pair")
    for name in ("workspace", "six_joints"):
        with pytest.raises(rp.InputError, match="needs a scene with one arm, and this one has 2"):
            rp.lesson(name, two)


def test_images_of_the_own_obstacles_overlap_and_have_strips(lessons: dict[str, rp.Lesson]) -> None:
    lesson = lessons["configuration_space"]
    assert isinstance(lesson, ConfigurationSpaceLesson)
    layers = lesson.picture.grid.layers
    assert (layers["disc"] & layers["box"]).any()
    assert [name for name, mask in layers.items() if mask.all(axis=1).any()] == ["disc", "box", "corner"]


def test_a_torus_shows_the_colors_of_its_cells() -> None:
    colors = np.ones((40, 80, 3))
    colors[:, :40] = (1.0, 0.0, 0.0)  # first angle below zero: the left half
    image = torus_image(colors, 200)
    opaque = image[..., 3] > 0
    red = opaque & (image[..., 0] > 2 * image[..., 1])
    assert 0.45 < opaque.mean() < 0.75
    left = np.argwhere(red)[:, 1]
    assert (left < 102).mean() > 0.99
    assert red.sum() == pytest.approx(opaque.sum() / 2, rel=0.03)
    assert not opaque[image.shape[0] // 2, 100]  # the hole
