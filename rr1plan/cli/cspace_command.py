"""`cspace`: the configuration space of two joints, with a query in it."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path

import rr1plan as rp
from rr1plan.cli.console import Console, milliseconds, progress_callback
from rr1plan.cli.exit_codes import OK
from rr1plan.cli.picture_files import check_video, film
from rr1plan.cli.scene_options import check_scene_name, chosen_query, name_or_numbers, page_options
from rr1plan.errors import InputError
from rr1plan.files.file_access import check_writable
from rr1plan.planners import chosen_planner
from rr1plan.scene.model_library import load_scene_file

# Short edges [rad] show how the tree grew.
_TREE_RANGE = 0.15
# If no path exists the planner stops after this many iterations, enough to draw a tree.
_HOPELESS_ITERATIONS = 1500


def cspace(options: Namespace, console: Console) -> int:
    """Draw the configuration space of two joints, with a query of a two-joint arm and its result."""
    look = page_options(options)
    check_scene_name(options.scene)
    loaded = load_scene_file(options.scene)
    scene, problem = loaded.scene, _flat_query(options, loaded.problems)
    pictures = _pictures(options, scene)
    if problem is None:
        idle = [option for option in ("--planner", "--seconds", "--seed") if option in options.given]
        if idle:
            raise InputError(f"{idle[0]} has no effect: there is no query of two joints to plan for")
    with console.progress("checking every cell") as advance:
        picture = rp.cspace(
            scene,
            problem,
            arm=options.arm,
            joints=None if options.joints is None else (options.joints[0], options.joints[1]),
            at=None if options.at is None else name_or_numbers(options.at),
            resolution=options.resolution,
            progress=progress_callback(advance),
        )
    result = None if problem is None else _plan_in(picture, problem, options, console)
    if result is not None:
        picture = picture.with_result(result)
    with console.progress("drawing"):
        files = {
            kind: picture.save_html(file, options=look) if kind == "page" else picture.save(file)
            for kind, file in pictures.items()
        }
    if options.video is not None:
        film(picture, options, console)
        files["video"] = Path(options.video)
    console.say(str(picture))
    if result is not None:
        found = result.reason if result.path is None else f"path found in {milliseconds(result.seconds)}"
        console.say(f"  {result.planner}: {found}")
    for kind, file in files.items():
        console.say(f"{kind}: {file}")
    console.result(
        {
            "components": picture.grid.components,
            "free_share": float(picture.grid.free.mean()),
            "proves_no_path": picture.proves_no_path,
            "verdict": picture.verdict,
            "planned": None if result is None else result.status.value,
            "files": {kind: str(file) for kind, file in files.items()},
        }
    )
    return OK


def _plan_in(picture: rp.CSpace, problem: rp.Problem, options: Namespace, console: Console) -> rp.PlanResult:
    """Plan for the query of a picture, only long enough for a tree where the picture proves that no path exists."""
    with console.progress("looking for a proof that no path exists"):
        hopeless = picture.proves_no_path
    budget = rp.Budget(options.seconds, _HOPELESS_ITERATIONS if hopeless else None)
    with console.progress("planning") as advance:
        return _with_tree(options.planner).plan(
            problem, budget=budget, rng=options.seed, progress=progress_callback(advance)
        )


def _with_tree(name: str) -> rp.Planner:
    """A planner that keeps its search tree, if it can."""
    if name == rp.RrtConnect.name:
        return rp.RrtConnect(range=_TREE_RANGE, tree=True)
    planner = chosen_planner(name)
    return rp.OmplPlanner(name, tree=True) if isinstance(planner, rp.OmplPlanner) else planner


def _flat_query(options: Namespace, queries: Mapping[str, rp.Problem]) -> rp.Problem | None:
    """The query to draw: the requested one, or the first that the picture can show; None for a picture without one."""
    if options.query is not None:
        return chosen_query(options.scene, queries, options.query)
    for problem in queries.values():
        own = problem.scene.arms[problem.arms[0]].robot.joint_names
        shown = options.arm in (None, problem.arms[0]) and options.joints in (None, list(own))
        if problem.nq == 2 and len(problem.arms) == 1 and shown:
            return problem
    return None


def _pictures(options: Namespace, scene: rp.Scene) -> dict[str, str]:
    """The requested files, or a PNG, by kind.

    Raises:
        InputError: a file cannot be written.
        MissingPackageError: a package or the browser for a video is not installed.
    """
    asked = {kind: getattr(options, kind) for kind in ("png", "svg", "pdf", "html")}
    if not any(asked.values()) and options.video is None:
        asked["png"] = f"{scene.name}-cspace.png"
    for file in filter(None, asked.values()):
        check_writable(file)
    if options.video is not None:
        check_video(options.video)
    return {"page" if kind == "html" else kind: file for kind, file in asked.items() if file}
