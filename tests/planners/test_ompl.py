"""The guarded interface to OMPL, on plain arrays and a wall; each way to crash OMPL is tried in a separate process."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.planners.ompl_planners import KINDS
from rr1plan.planning import Budget

ompl_adapter = pytest.importorskip("rr1plan.planners.ompl_adapter", reason="OMPL is not installed")

OMPL_NAMES = sorted(kind.ompl for kind in KINDS.values())
ROOT = Path(__file__).resolve().parents[2]

WORLD = """
import numpy as np
from rr1plan.planners import ompl_adapter
from rr1plan.planners.ompl_query import OmplQuery, Watch
from rr1plan.planning import Budget
import time

def state_valid(q):
    return not (abs(q[0]) < 0.04 and q[1] < 1.5)

def edge_valid(a, b):
    if not (state_valid(a) and state_valid(b)):
        return False
    if a[0] * b[0] >= 0:
        return True
    t = a[0] / (a[0] - b[0])
    return a[1] + t * (b[1] - a[1]) > 2.0 or min(a[1], b[1]) > 1.5

def query(**changes):
    parts = dict(lower=[-3, -3], upper=[3, 3], start=[-1, 0], goals=[[1, 0], [1, -1]],
                 state_valid=state_valid, edge_valid=edge_valid)
    return OmplQuery(**{**parts, **changes})

def solve(planner, iterations=4000, seconds=float("inf"), seed=1, settings={}, tree=False, goes_on=None, **changes):
    watch = Watch(Budget(seconds=seconds, iterations=iterations), time.perf_counter(), goes_on)
    return ompl_adapter.solve(planner, query(**changes), watch, seed, settings, tree=tree), watch
"""
world: dict = {}
exec(WORLD, world)
solve = world["solve"]


def in_a_process(code: str, timeout: float = 60.0) -> subprocess.CompletedProcess[str]:
    """Run code after the world above in a fresh interpreter."""
    return subprocess.run(
        [sys.executable, "-X", "faulthandler", "-W", "error", "-c", WORLD + textwrap.dedent(code)],
        capture_output=True,
        text=True,
        timeout=timeout,
        cwd=ROOT,
        check=False,
    )


def assert_clean(done: subprocess.CompletedProcess[str]) -> None:
    assert done.returncode == 0, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    # Messages about the first compilation depend on earlier runs.
    said = [line for line in done.stderr.splitlines() if not line.startswith("compiling for this machine")]
    assert said == [], "nothing else may be said on stderr, not at exit either"


@pytest.mark.parametrize("planner", OMPL_NAMES)
def test_every_planner_finds_the_way_round_the_wall(planner):
    result, watch = solve(planner)
    assert result.waypoints is not None
    assert result.waypoints[0].tolist() == [-1.0, 0.0]
    assert result.waypoints[-1].tolist() in ([1.0, 0.0], [1.0, -1.0])
    assert all(world["edge_valid"](a, b) for a, b in zip(result.waypoints[:-1], result.waypoints[1:], strict=True))
    assert 0 < watch.checks <= 4000


@pytest.mark.parametrize("planner", OMPL_NAMES)
def test_a_seed_gives_the_same_bytes_again_after_other_searches(planner):
    first = solve(planner, iterations=2500)[0].waypoints.tobytes()
    solve("RRT", seed=77)
    assert solve(planner, iterations=2500)[0].waypoints.tobytes() == first
    others = (solve(planner, iterations=2500, seed=s)[0].waypoints for s in (2, 3, 4))
    assert any(w is None or w.tobytes() != first for w in others)


@pytest.mark.parametrize("planner", ["RRTConnect", "PRM", "PRMstar", "BITstar", "AORRTC", "KPIECE1"])
def test_a_seed_gives_the_same_bytes_while_other_threads_search(planner):
    first = solve(planner, iterations=800)[0].waypoints
    others = []

    def disturbed(answer):
        def call(*states):
            if len(others) < 20:
                others.append(threading.Thread(target=solve, args=("RRT",), kwargs={"seed": len(others) + 7}))
                others[-1].start()
                others[-1].join(0.003)  # it may wait for the end of this callback
            return answer(*states)

        return call

    callbacks = {"state_valid": disturbed(world["state_valid"]), "goes_on": disturbed(lambda: True)}
    again = solve(planner, iterations=800, **callbacks)[0].waypoints
    for other in others:
        other.join()
    assert again.tobytes() == first.tobytes()


@pytest.mark.parametrize("planner", ["RRTConnect", "PRM", "BITstar"])
def test_a_seed_gives_the_same_bytes_in_another_process(planner):
    done = in_a_process(f"print(solve({planner!r})[0].waypoints.tobytes().hex())")
    assert_clean(done)
    assert done.stdout.strip() == solve(planner)[0].waypoints.tobytes().hex()


@pytest.mark.parametrize("planner", ["RRTConnect", "RRTstar", "BITstar", "FMT", "PRM", "PRMstar", "LBKPIECE1"])
def test_what_was_explored_comes_as_arrays(planner):
    tree = solve(planner, tree=True)[0].tree
    assert tree.vertices.shape[1] == 2
    assert len(tree.edges) > 0
    assert tree.edges.min() >= 0
    assert tree.edges.max() < len(tree.vertices)
    assert ((tree.vertices == [-1.0, 0.0]).all(axis=1)).any()


@pytest.mark.parametrize("planner", OMPL_NAMES)
def test_no_way_ends_with_the_budget_and_no_path(planner):
    result, watch = solve(planner, iterations=300, edge_valid=lambda a, b: a[0] * b[0] > 0)
    assert result.waypoints is None
    assert watch.checks <= 300


def test_an_approximate_solution_is_none_and_says_how_near_it_came():
    result, _ = solve("RRT", iterations=300, edge_valid=lambda a, b: a[0] * b[0] > 0)
    assert result.waypoints is None
    assert 0.5 < result.difference < 3.0


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"start": [np.nan, 0]}, "start"),
        ({"goals": [[np.nan, 0]]}, "goals"),
        ({"goals": [[1, 0, 0]]}, "goals"),
        ({"goals": np.empty((0, 2))}, "0 goals"),
        ({"start": [1.0]}, "start"),
        ({"lower": [np.nan, -3]}, "lower"),
        ({"upper": [np.inf, 3]}, "upper"),
        ({"lower": [3, -3]}, "bounds"),
        ({"start": [-4, 0]}, "outside"),
        ({"lower": [], "upper": [], "start": [], "goals": np.empty((1, 0))}, "0 joints"),
    ],
)
def test_numbers_that_ompl_would_call_solved_are_refused(changes, word):
    with pytest.raises(InputError, match=word):
        solve("RRTConnect", **changes)


@pytest.mark.parametrize("seed", [0, -1, 2**32])
def test_seeds_that_ompl_misreads_are_refused(seed):
    with pytest.raises(InputError, match="seed"):
        solve("RRT", seed=seed)


def test_settings_are_taken_and_wrong_ones_named():
    loose = solve("RRTConnect", settings={"range": 5.0}, tree=True)[0].tree
    tight = solve("RRTConnect", settings={"range": 0.1}, tree=True)[0].tree
    assert len(tight.vertices) > len(loose.vertices)
    with pytest.raises(UnknownNameError, match="range"):
        solve("RRTConnect", settings={"rnage": 1.0})
    for value in (np.nan, -1.0, "far"):
        with pytest.raises(InputError, match="range"):
            solve("RRTConnect", settings={"range": value})
    with pytest.raises(InputError, match="num_samples"):
        solve("FMT", settings={"num_samples": 0.5})
    for settings in ({"goal_bias": 1.5}, {"goal_bias": 5}):
        with pytest.raises(InputError, match=r"setting 'goal_bias' is .*expected a share from 0 to 1"):
            solve("RRT", settings=settings)


@pytest.mark.parametrize("planner", OMPL_NAMES)
def test_every_planner_names_its_settings(planner):
    names = ompl_adapter.setting_names(planner)
    assert all(name == name.lower() and name not in ("name", "problem_definition", "up") for name in names)
    assert len(names) > 0


def test_the_clock_ends_a_search_whose_checks_are_slow():
    def slow(a, b):
        time.sleep(0.02)
        return world["edge_valid"](a, b)

    result, watch = solve("PRM", iterations=None, seconds=0.2, edge_valid=slow)
    assert result.waypoints is None
    assert watch.over


def test_a_search_ends_at_the_first_check_that_says_so():
    asked = []

    def goes_on():
        asked.append(None)
        return len(asked) < 50

    _, watch = solve("RRTstar", goes_on=goes_on)
    assert watch.cancelled
    assert len(asked) == watch.checks == 50


@pytest.mark.parametrize("planner", ["RRTstar", "InformedRRTstar", "SORRTstar", "AORRTC", "BITstar", "PRMstar"])
def test_optimizing_planners_report_falling_costs(planner):
    result, watch = solve(planner, iterations=3000)
    costs = [cost for _, cost in watch.history]
    assert len(costs) >= 1
    assert costs == sorted(costs, reverse=True)
    length = np.linalg.norm(np.diff(result.waypoints, axis=0), axis=1).sum()
    assert length <= costs[-1] + 1e-9


# ---- each of these has killed or wedged a process that spoke to OMPL directly ------------------------


@pytest.mark.parametrize("planner", OMPL_NAMES)
def test_no_state_is_outside_the_bounds(planner):
    # A short third axis and many goals, as of a SCARA that moves to a point: SORRT* also samples outside its range.
    lower, upper = np.array([-2.3, -2.5, -0.02, -7.85]), np.array([2.3, 2.5, 0.15, 7.85])
    goals = [[x, y, 0.12, turn] for x, y in ((0.1, 0.95), (0.97, -0.95)) for turn in np.linspace(-6.0, 6.0, 16)]
    query = {"lower": lower, "upper": upper, "start": [-0.8, 0.6, 0.0, 0.0], "goals": goals}
    found, _ = solve(planner, seed=4, tree=True, **query)
    assert (found.tree.vertices >= lower - 1e-9).all()
    assert (found.tree.vertices <= upper + 1e-9).all()


def test_an_exception_in_a_callback_arrives_unchanged_and_searching_goes_on():
    done = in_a_process(f"""
        originals = dict(state_valid=state_valid, edge_valid=edge_valid, goes_on=lambda: True)
        calls = 0
        def failing(original):
            def call(*arguments):
                global calls
                calls += 1
                if calls == 5:
                    raise KeyError("mine")
                return original(*arguments)
            return call
        for planner in {OMPL_NAMES!r}:
            for where, original in originals.items():
                print(planner, where, flush=True)
                calls = 0
                try:
                    solve(planner, **{{where: failing(original)}})
                except KeyError as error:
                    assert error.args == ("mine",)
                else:
                    assert calls < 5, "the exception was lost"
            assert solve(planner, iterations=2500)[0].waypoints is not None
    """)
    assert_clean(done)


@pytest.mark.parametrize("planner", ["RRTConnect", "PRM", "BITstar", "BFMT"])
def test_ctrl_c_ends_a_search_cleanly(planner):
    code = WORLD + textwrap.dedent(f"""
        import gc
        blocked = lambda a, b: a[0] * b[0] > 0
        print("go", flush=True)
        try:
            while True:
                solve({planner!r}, iterations=10**9, edge_valid=blocked)
        except KeyboardInterrupt:
            pass
        gc.collect()
        assert solve({planner!r})[0].waypoints is not None
        print("clean", flush=True)
    """)
    child = subprocess.Popen(
        [sys.executable, "-X", "faulthandler", "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    try:
        assert child.stdout.readline() == "go\n"
        time.sleep(0.3)
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=30)
    finally:
        child.kill()
        child.wait()
    assert (child.returncode, out, err) == (0, "clean\n", "")


def test_handlers_of_the_caller_are_left_alone():
    done = in_a_process("""
        import signal, threading
        solve("RRTConnect")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        mine = lambda *a: None
        signal.signal(signal.SIGINT, mine)
        solve("PRM")
        assert signal.getsignal(signal.SIGINT) is mine
        found = []
        thread = threading.Thread(target=lambda: found.append(solve("PRM")[0].waypoints))
        thread.start(); thread.join()
        assert found[0] is not None
    """)
    assert_clean(done)


def test_callbacks_may_return_anything_with_a_truth():
    done = in_a_process(f"""
        for planner in {OMPL_NAMES!r}:
            for result in (None, 1, np.bool_(True), np.float64(1.0)):
                solve(planner, edge_valid=lambda a, b: result, state_valid=lambda q: result, iterations=200)
    """)
    assert_clean(done)


def test_nothing_of_ompl_is_needed_after_the_call_and_nothing_is_said():
    done = in_a_process("""
        import gc
        for planner in ("RRTConnect", "PRMstar", "BITstar", "SORRTstar"):
            result, watch = solve(planner, tree=True)
            gc.collect()
            assert np.isfinite(result.waypoints).all() and np.isfinite(result.tree.vertices).all()
            assert result.waypoints.flags.owndata or result.waypoints.base.flags.owndata
    """)
    assert_clean(done)
    assert done.stdout == ""


def test_memory_does_not_grow():
    done = in_a_process("""
        import gc, resource
        def rounds(count):
            for k in range(count):
                solve("RRTConnect", seed=k + 1, iterations=60)
                if k % 10 == 0:
                    solve("PRM", seed=k + 1, iterations=60)
            gc.collect()
            return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        rounds(200)
        before = rounds(200)
        print((rounds(800) - before) * 1024 / 800)
    """)
    assert_clean(done)
    assert float(done.stdout) < 700, "bytes a search"


def test_an_informed_search_in_hardly_any_volume_ends():
    done = in_a_process(
        """
        nearly = lambda a, b: abs(a - b).max() < 1.9
        for planner in ("SORRTstar", "InformedRRTstar", "BITstar", "AORRTC", "RRTstar"):
            result, watch = solve(planner, iterations=3000, edge_valid=nearly, state_valid=lambda q: True)
            if planner == "AORRTC":  # its best path may lead from the goal to itself
                assert result.waypoints is None or list(result.waypoints[0]) == [-1.0, 0.0]
            else:
                assert result.waypoints is not None
    """,
        timeout=60,
    )
    assert_clean(done)


def test_a_wave_front_without_enough_samples_begins_again_with_more():
    done = in_a_process("""
        nowhere = lambda a, b: a[0] * b[0] > 0
        result, watch = solve("BFMT", iterations=12000, edge_valid=nowhere)
        assert result.waypoints is None and watch.checks == 12000
        assert solve("BFMT", iterations=10, state_valid=lambda q: False)[0].waypoints is None
    """)
    assert_clean(done)


def test_seeds_give_different_paths():
    paths = {solve("RRTConnect", seed=seed)[0].waypoints.tobytes() for seed in range(1, 9)}
    assert len(paths) == 8


def test_budget_counts_are_exact():
    for iterations in (1, 7, 100):
        _, watch = solve("RRT", iterations=iterations, edge_valid=lambda a, b: False)
        assert watch.checks == iterations


def test_budget_of_nothing_is_refused():
    with pytest.raises(InputError, match="zero"):
        Budget(seconds=0.0)


def test_a_search_that_samples_forever_can_be_cancelled():
    began = []

    def progress(part):
        began.append(part.seconds)
        return len(began) < 4

    budget = Budget(seconds=float("inf"), iterations=200)
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r_limited"))
    scene = scene.with_obstacle("ball", rp.Sphere(0.15), [0.5, 0.3, 0.0])
    goals = [[-2.26385604, 2.25559833], [1.10430269, 1.68366306], [2.38080739, 0.43326424]]
    problem = rp.Problem(scene, [-0.45757534, 0.44876184], [rp.JointGoal(goal) for goal in goals])
    result = rp.plan(problem, planner="aorrtc", budget=budget, rng=0, progress=progress)
    assert result.status is rp.PlanStatus.CANCELLED


def test_a_search_that_samples_forever_ends_under_iterations_alone():
    budget = Budget(seconds=float("inf"), iterations=200)
    problem = rp.load_problems("planar2r_path")["elbow_flip"]
    result = rp.plan(problem, planner="aorrtc", budget=budget, rng=0)
    assert result.found
    assert 0 < result.iterations < 200


@pytest.mark.parametrize("planner", ["PRM", "PRMstar"])
def test_roadmaps_leave_time_for_their_last_query(monkeypatch, planner):
    clock, dijkstra = [0.0], ompl_adapter.dijkstra

    def tick(seconds=1e-4):
        clock[0] += seconds
        return clock[0]

    def slow(graph, **options):
        tick(2e-4 * graph.shape[0])
        return dijkstra(graph, **options)

    monkeypatch.setattr(time, "perf_counter", tick)
    monkeypatch.setattr(ompl_adapter, "dijkstra", slow)
    found, watch = solve(planner, seconds=3.0, iterations=None, edge_valid=lambda a, b: a[0] * b[0] > 0)
    assert watch.over
    assert found.waypoints is None
    assert 2.0 < clock[0] <= 3.0


IMPORTED_SLOWLY = """
import sys
import time

import rr1plan as rp

late, clock = [0.0], time.perf_counter

class Slow:
    @staticmethod
    def find_spec(name, path=None, target=None):
        late[0] += 60.0 * (name == "ompl.base")

time.perf_counter = lambda: clock() + late[0]
sys.meta_path.insert(0, Slow)
problem = rp.load_problems("rr1_cage")["into_cage"]
print(rp.plan(problem, planner="ompl_rrt_connect", budget=rp.Budget(seconds=40), rng=0).status, late)
"""


def test_the_import_of_ompl_is_not_taken_from_the_budget():
    done = subprocess.run(
        [sys.executable, "-c", IMPORTED_SLOWLY], capture_output=True, text=True, timeout=100, cwd=ROOT, check=False
    )
    assert done.stdout == "found [60.0]\n", done.stderr
