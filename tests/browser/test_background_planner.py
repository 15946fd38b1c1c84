"""Planning in a worker: the motions that the page would plan itself, canceled by the user, and without workers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import pytest

import rr1plan as rp
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

# Numbers of the motion that plays, and those of the motion that the page's own planner finds.
_PLAYED = "(({ breaks, coefficients }) => [[...breaks.values], [...coefficients.values]])(RR1.document.track)"
_OWN = """(({ track: { breaks, coefficients } }) => [[...breaks.values], [...coefficients.values]])(
    RR1.planner.plan(RR1.editing.start, RR1.editing.goal, { seed: 0 }))"""
# Searches in the page do not succeed within a moment.
_HARD = "() => { RR1.planner.plan = () => ({ status: 'timeout' }); }"
_ANSWER = "document.getElementById('answer').textContent"


def one_arm() -> rp.Problem:
    return next(iter(rp.load_problems("rr1_cluttered").values()))


def many_arms() -> rp.Problem:
    scene = rp.place_grid(rp.load_robot("rr1"), 4, 4, spacing=0.8)
    start = scene.configuration()
    goal = start.copy()
    goal[0::12] += 0.6
    return rp.Problem(scene, start, scene.split(goal))


@pytest.fixture(scope="module", params=[one_arm, many_arms])
def page_file(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    problem = request.param()
    return rp.save_html(tmp_path_factory.mktemp("page") / "page with spaces – ø.html", problem.scene, problem=problem)


@pytest.fixture
def page(tab: Any, page_file: FilePath) -> Any:
    tab.open(page_file)
    wait_until(tab.page, "Boolean(RR1.planner)")
    return tab


def test_a_worker_plans_the_same_motion(page: Any) -> None:
    page.ask(_HARD)
    assert page.ask("RR1.editing.plan().then((answer) => answer.certified)")
    assert page.ask("RR1.editing.background.isParallel")
    page.ask("delete RR1.planner.plan")
    assert page.ask(_PLAYED) == page.ask(_OWN)
    wait_until(page.page, f"{_ANSWER}.includes('clearance')")
    assert page.complaints == []
    assert len(page.requests) == 1


@pytest.mark.parametrize("page_file", [one_arm], indirect=True)
def test_a_motion_found_in_a_moment_does_not_wait_for_the_worker(page: Any) -> None:
    page.ask("() => { RR1.editing.background.run = () => Promise.resolve(null); performance.now = () => 0; }")
    assert page.ask("RR1.editing.plan().then((answer) => answer.certified)")
    page.ask("delete performance.now")
    assert page.ask(_PLAYED) == page.ask(_OWN)


@pytest.mark.parametrize("page_file", [one_arm], indirect=True)
def test_a_moved_obstacle_is_moved_in_the_worker_too(page: Any) -> None:
    page.ask(_HARD)
    assert page.ask("RR1.editing.plan().then((answer) => answer.status)") == "found"
    name = page.ask("RR1.planner.obstacles.at(-1)")
    T = page.ask("name => [...RR1.editing.poses.get(name)]", name)
    T[14] += 0.05
    page.ask("([name, T]) => RR1.editing.moveObstacle(name, T)", [name, T])
    assert page.ask("RR1.editing.plan().then((answer) => answer.certified)")
    page.ask("delete RR1.planner.plan")
    assert page.ask(_PLAYED) == page.ask(_OWN)


def test_planning_is_canceled_by_the_user_and_begins_anew(page: Any) -> None:
    plan = "() => { const found = RR1.editing.plan(); %s; return found; }"
    assert page.ask(plan % "RR1.editing.requestPlan()") is None
    assert page.ask(_ANSWER) == "Planning canceled."
    assert page.ask("RR1.document.track") is None
    # A changed question cancels too, and another document.
    assert page.ask(plan % "RR1.editing.setEnd('goal', RR1.editing.start)") is None
    assert "has changed" in page.ask(_ANSWER)
    page.ask("RR1.editing.reset()")
    assert page.ask(plan % "RR1.load(RR1.document)") is None
    wait_until(page.page, "Boolean(RR1.planner)")
    # The last plan wins.
    assert page.ask("() => { const first = RR1.editing.plan(), next = RR1.editing.plan(); return first; }") is None
    page.wait_for_plan()
    assert page.ask(_PLAYED) == page.ask(_OWN)
    assert page.complaints == []


def no_constructor(tab: Any, file: FilePath) -> FilePath:
    tab.page.add_init_script("window.Worker = class { constructor() { throw new Error('no workers'); } };")
    return file


def no_policy(tab: Any, file: FilePath) -> FilePath:
    text = file.read_text("utf-8")
    assert "worker-src blob:" in text
    strict = file.with_name("strict.html")
    strict.write_text(text.replace("worker-src blob:", "worker-src &#x27;none&#x27;"), "utf-8")
    return strict


@pytest.mark.parametrize("refuse", [no_constructor, no_policy])
def test_without_workers_the_page_plans_itself(
    refuse: Callable[[Any, FilePath], FilePath], tab: Any, page_file: FilePath
) -> None:
    tab.open(refuse(tab, page_file))
    wait_until(tab.page, "Boolean(RR1.planner)")
    assert tab.ask("RR1.editing.plan().then((answer) => answer.certified)")
    assert not tab.ask("RR1.editing.background.isParallel")
    assert tab.ask(_PLAYED) == tab.ask(_OWN)
    wait_until(tab.page, f"{_ANSWER}.includes('clearance')")


def test_slow_planning_shows_its_progress_and_how_to_cancel(page: Any) -> None:
    # The worker reports a step and never answers.
    page.ask(
        """() => {
            const { background } = RR1.editing;
            background.plan = (start, goal, options, report) => new Promise((resolve) => {
                background.cancel = () => resolve(null);
                report("3 of 8 arms");
            });
            RR1.editing.plan();
        }"""
    )
    wait_until(page.page, f"{_ANSWER} === 'Planning … 3 of 8 arms'")
    assert page.page.locator(".act.plan").inner_text().startswith("Cancel")
    frames = page.ask("RR1.frames")
    wait_until(page.page, f"RR1.frames > {frames} + 3")
    page.page.keyboard.press("Escape")
    assert page.ask(_ANSWER) == "Planning canceled."
    assert page.page.locator(".act.plan").inner_text().startswith("Plan")
    assert page.page.locator("#editing").is_visible()


# The planner of pages that are opened later waits for `letGo`.
_LOADS_LATE = """
    window.held = new Promise((resolve) => { window.letGo = resolve; });
    const { instantiate } = WebAssembly;
    WebAssembly.instantiate = async (...given) => { await held; return instantiate(...given); };
"""


@pytest.mark.parametrize("page_file", [one_arm], indirect=True)
def test_a_plan_waits_until_the_planner_is_loaded(tab: Any, page_file: FilePath) -> None:
    tab.page.add_init_script(_LOADS_LATE)
    tab.open(page_file)
    assert tab.ask("RR1.planner") is None
    tab.page.keyboard.press("p")
    assert tab.ask(_ANSWER) == "Planning starts when the planner is loaded."
    tab.page.keyboard.press("p")
    assert tab.ask(_ANSWER) == "Planning canceled."
    tab.page.keyboard.press("p")
    tab.ask("letGo()")
    wait_until(tab.page, "Boolean(RR1.planner) && Boolean(RR1.document.track)")
    assert tab.ask(_PLAYED) == tab.ask(_OWN)
    assert tab.complaints == []


@pytest.mark.parametrize("page_file", [one_arm], indirect=True)
def test_a_plan_that_waits_reports_why_there_is_no_planner(tab: Any, page_file: FilePath) -> None:
    tab.page.add_init_script(_LOADS_LATE)
    tab.open(page_file)
    tab.page.keyboard.press("p")
    tab.ask("RR1.editing.takePlanner(null, 'this browser is too old')")
    wait_until(tab.page, f"{_ANSWER} === 'Cannot plan here: this browser is too old.'")


def test_a_plan_of_a_configuration_space_waits_until_the_planner_is_loaded(tab: Any, tmp_path: FilePath) -> None:
    problem = rp.load_problems("planar2r_path")["over_the_seam"]
    page = rp.cspace(problem.scene, problem, resolution=24).save_html(tmp_path / "cspace.html")
    tab.page.add_init_script(_LOADS_LATE)
    tab.open(page)
    tab.page.keyboard.press("p")
    said = "document.querySelector('.said').textContent"
    assert tab.ask(said) == "Planning starts when the planner is loaded."
    tab.ask("letGo()")
    wait_until(tab.page, "Boolean(RR1.lesson.answer) && RR1.playing")
    assert tab.ask(said) == ""
    assert tab.complaints == []
