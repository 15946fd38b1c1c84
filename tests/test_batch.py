"""Many problems at once. Processes start slowly, so most tests share one batch or run in this process."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing import get_context

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import batch_worker
from rr1plan.batch import PlanFailure, problem_seeds

BUDGET = rp.Budget(float("inf"), iterations=20_000)


class DaskLikeClient:
    """Submits tasks, but is no executor: its futures are not those of `concurrent.futures`."""

    def submit(self, function, *arguments):
        return object()

    def get_executor(self):
        return InLine()


class ShutDownAfterOne(ThreadPoolExecutor):
    """An executor that is shut down at its second task, which cancels tasks that have not begun."""

    def submit(self, function, /, *arguments, **settings):
        if not self.begun.is_set():
            future = super().submit(self.wait, function, *arguments, **settings)
            self.begun.wait()
            return future
        future = super().submit(function, *arguments, **settings)
        self.shutdown(wait=False, cancel_futures=True)
        self.go_on.set()
        return future

    def __init__(self):
        super().__init__(1)
        self.begun, self.go_on = threading.Event(), threading.Event()

    def wait(self, function, *arguments, **settings):
        self.begun.set()
        self.go_on.wait()
        return function(*arguments, **settings)


class InLine(Executor):
    """Runs tasks in this process on request, and records how many tasks were submitted at once."""

    def __init__(self):
        self.sizes = []

    def submit(self, function, /, *arguments, **settings):
        self.sizes.append(len(arguments[0]))
        future = Future()
        try:
            future.set_result(function(*arguments, **settings))
        except Exception as error:
            future.set_exception(error)
        return future


@pytest.fixture(scope="module")
def problems(planar2r):
    scene = rp.Scene().with_arm("a", planar2r)
    goals = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 2))
    return [rp.Problem(scene, np.zeros(2), rp.JointGoal(q)) for q in goals]


class Killer(rp.Problem):
    """A problem that ends the process in which it is unpickled."""

    def __reduce__(self):
        return os._exit, (1,)


def paths(answers):
    return [a.path_or_raise().waypoints for a in answers]


def test_answers_are_in_order_and_those_of_planning_alone(problems):
    answers = rp.plan_many(problems, executor=InLine(), rng=3, budget=BUDGET)
    assert all(isinstance(a, rp.MotionPlan) and a.valid for a in answers)
    for problem, seed, answer in zip(problems, problem_seeds(3, 5), answers, strict=True):
        assert answer.problem is problem
        alone = rp.plan_motion(problem, rng=seed, budget=BUDGET)
        np.testing.assert_array_equal(answer.path.waypoints, alone.path.waypoints)
        assert answer.trajectory.allclose(alone.trajectory, atol=0.0)


def test_seeds_do_not_depend_on_how_many_problems_there_are():
    assert problem_seeds(1, 3) == problem_seeds(1, 10)[:3]
    assert len(set(problem_seeds(1, 100))) == 100
    assert problem_seeds(np.random.default_rng(1), 3) == problem_seeds(1, 3)
    assert problem_seeds(2, 3) != problem_seeds(1, 3)


def test_spawned_processes_give_the_same_answers_whatever_their_number(problems):
    here = rp.plan_many(problems, executor=InLine(), rng=7, full=False, budget=BUDGET)
    spawned = rp.plan_many(problems, workers=2, rng=7, full=False, budget=BUDGET)
    for one, two in zip(paths(here), paths(spawned), strict=True):
        np.testing.assert_array_equal(one, two)


def test_a_problem_that_kills_its_process_is_the_only_one_lost(problems):
    killer = Killer(problems[0].scene, np.zeros(2), rp.JointGoal(np.ones(2)))
    asked = [problems[0], killer, *problems[1:3]]
    answers = rp.plan_many(asked, workers=1, rng=0, full=False, budget=BUDGET)
    assert [a.found for a in answers] == [True, False, True, True]
    assert isinstance(answers[1], PlanFailure)
    assert answers[1].problem is killer
    assert "died" in answers[1].reason


def test_a_process_that_is_interrupted_while_it_starts_goes_on(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import os, signal, sys\n"
        "import rr1plan as rp\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "if __name__ == '__mp_main__':\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "if __name__ == '__main__':\n"
        "    problem = rp.load_problems('planar2r_path')['to_a_point']\n"
        "    print(*(answer.status.value for answer in rp.plan_many([problem], workers=1, rng=0, full=False)))\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "found\n", "")


def test_plans_pickle(problems):
    motion = rp.plan_motion(problems[0], rng=0, budget=BUDGET)
    again = pickle.loads(pickle.dumps(motion))
    assert again.valid
    assert again.trajectory.allclose(motion.trajectory, atol=0.0)
    assert not again.path.waypoints.flags.writeable
    assert str(again.report) == str(motion.report)


def test_consecutive_problems_travel_together_and_their_scene_once(problems):
    executor = InLine()
    rp.plan_many(problems * 8, executor=executor, workers=2, rng=0, full=False, budget=BUDGET)
    assert executor.sizes == [5] * 8
    tasks = [batch_worker.Task(i, p, 0) for i, p in enumerate(problems)]
    more = len(pickle.dumps(tasks)) - len(pickle.dumps(tasks[:1]))
    assert more < 0.5 * len(pickle.dumps(problems[0].scene))


def test_what_raises_stands_in_its_place(problems, monkeypatch):
    planned = batch_worker.plan

    def fail(problem, **settings):
        if problem is problems[2]:
            raise rp.RetimingError("no time today")
        return planned(problem, **settings)

    monkeypatch.setattr(batch_worker, "plan", fail)
    answers = rp.plan_many(problems, executor=InLine(), rng=0, full=False, budget=BUDGET)
    assert [a.found for a in answers] == [True, True, False, True, True]
    failure = answers[2]
    assert isinstance(failure, PlanFailure)
    assert (failure.problem, failure.error, failure.reason) == (problems[2], "RetimingError", "no time today")
    assert "in fail" in failure.details
    assert [a.status for a in answers] == ["found", "found", "RetimingError", "found", "found"]


def test_a_problem_without_an_answer_is_no_failure(problems):
    unreachable = rp.Problem(problems[0].scene, np.zeros(2), rp.PoseGoal("tool", [9.0, 0.0, 0.0]))
    (answer,) = rp.plan_many([unreachable], executor=InLine(), rng=0, budget=BUDGET)
    assert answer.reason == answer.result.reason != ""
    assert isinstance(answer, rp.MotionPlan)
    assert answer.status is rp.PlanStatus.INFEASIBLE


def test_what_cannot_travel_is_lost_alone(problems):
    class Picky(InLine):
        def submit(self, function, /, chunk, settings):
            if any(task.number == 3 for task in chunk):
                future = Future()
                future.set_exception(pickle.PicklingError("not this one"))
                return future
            return super().submit(function, chunk, settings)

    answers = rp.plan_many(problems * 2, executor=Picky(), workers=1, rng=0, full=False, budget=BUDGET)
    assert [i for i, a in enumerate(answers) if not a.found] == [3]
    assert answers[3].error == "PicklingError"


def test_an_executor_of_ones_own_that_breaks_loses_what_is_left(problems):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        killer = Killer(problems[0].scene, np.zeros(2), rp.JointGoal(np.ones(2)))
        answers = rp.plan_many([killer, *problems], executor=executor, rng=0, full=False, budget=BUDGET)
        more = rp.plan_many(problems, executor=executor, rng=0, full=False, budget=BUDGET)
    for answer in [answers[0], *more]:
        assert isinstance(answer, PlanFailure)
        assert "broke" in answer.reason


@pytest.mark.parametrize("error", [pickle.PicklingError, OSError, ValueError])
def test_errors_of_submit_are_those_of_the_problems_that_it_refuses(error, problems):
    class Refusing(InLine):
        """Like a client that pickles tasks as they are submitted, or that has closed its connection."""

        def submit(self, function, /, chunk, settings):
            if error is not pickle.PicklingError or problems[0] in [task.problem for task in chunk]:
                raise error("the connection is closed")
            return super().submit(function, chunk, settings)

    answers = rp.plan_many(problems, executor=Refusing(), workers=1, rng=0, full=False, budget=BUDGET)
    assert (answers[0].error, answers[0].reason) == (error.__name__, "the connection is closed")
    assert all(answer.found == (error is pickle.PicklingError) for answer in answers[1:])


def test_an_executor_with_other_futures_is_refused(problems):
    class Foreign(InLine):
        def submit(self, function, /, *arguments):
            return super().submit(function, *arguments).result()

    with pytest.raises(rp.InputError, match=r"executor\.submit returned list, expected a concurrent\.futures\.Future"):
        rp.plan_many(problems, executor=Foreign(), rng=0, full=False, budget=BUDGET)


def test_an_executor_that_is_shut_down_keeps_what_is_done_and_says_why_the_rest_is_not(problems):
    settings = {"rng": 0, "full": False, "budget": BUDGET, "workers": 1}
    executor = ShutDownAfterOne()
    answers = rp.plan_many(problems, executor=executor, **settings)
    assert [answer.found for answer in answers] == [True, True, False, False, False]
    assert [answer.reason for answer in answers[2:4]] == ["the executor cancelled this problem"] * 2
    for answer in [answers[4], *rp.plan_many(problems, executor=executor, **settings)]:
        assert isinstance(answer, PlanFailure)
        assert "the executor accepted no more tasks" in answer.reason
        assert "shutdown" in answer.reason


def test_progress_is_told_and_may_cancel(problems):
    seen = []
    rp.plan_many(problems, executor=InLine(), rng=0, full=False, budget=BUDGET, progress=seen.append)
    assert [p.fraction for p in seen] == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])
    # An optimizing planner works until its budget ends, so that the last problems have not begun by the first report.
    slow = [rp.load_problems("planar2r_path")["to_a_point"]] * 40
    settings = {"planner": "rrt_star", "full": False, "budget": rp.Budget(0.1), "rng": 0}
    with ThreadPoolExecutor(1) as executor:
        answers = rp.plan_many(problems + slow, executor=executor, progress=lambda p: False, **settings)
    assert len(answers) == 45
    assert answers[-1].error == "Cancelled"


def test_each_problem_is_reported_as_it_ends_and_its_answer_survives_a_cancellation(problems):
    pytest.importorskip("ompl", reason="OMPL is not installed")
    unreachable = rp.Problem(problems[0].scene, np.zeros(2), rp.PoseGoal("tool", [9.0, 0.0, 0.0]))
    # An optimizing planner works until its budget ends unless a straight line solves the problem.
    slow = rp.load_problems("planar2r_path")["to_a_point"]
    fractions = []

    def cancel_after_the_first(progress):
        fractions.append(progress.fraction)
        return False

    settings = {"planner": "rrt_star", "full": False, "budget": rp.Budget(300)}
    answers = rp.plan_many([unreachable, slow] * 4, workers=1, rng=0, progress=cancel_after_the_first, **settings)
    assert fractions == [1 / 8]
    assert answers[0].status is rp.PlanStatus.INFEASIBLE
    assert [a.error for a in answers[1:]] == ["Cancelled"] * 7


def test_processes_report_every_problem_once(problems):
    fractions = []
    settings = {"full": False, "budget": BUDGET, "progress": lambda p: fractions.append(p.fraction)}
    killer = Killer(problems[0].scene, np.zeros(2), rp.JointGoal(np.ones(2)))
    rp.plan_many([*problems, killer, *problems], workers=1, rng=0, **settings)
    assert fractions == pytest.approx(np.arange(1, 12) / 11)


def test_no_problems_are_no_answers():
    assert rp.plan_many([]) == []


@pytest.mark.parametrize(
    ("settings", "error", "match"),
    [
        ({"workers": 0}, rp.InputError, "workers"),
        ({"workers": True}, rp.InputError, "workers"),
        ({"executor": 4}, rp.InputError, "executor"),
        ({"executor": DaskLikeClient()}, rp.InputError, r"executor is DaskLikeClient.*pass its get_executor\(\)"),
        ({"planner": "rrt_conect"}, rp.UnknownNameError, "rrt_connect"),
        ({"retiming": "blended"}, rp.UnknownNameError, "blend"),
        ({"rng": -1}, rp.InputError, "rng"),
    ],
)
def test_wrong_calls_are_told_before_anything_starts(problems, settings, error, match):
    with pytest.raises(error, match=match):
        rp.plan_many(problems, **settings)


def test_what_is_no_problem_is_named(problems):
    with pytest.raises(rp.InputError, match=r"problems\[1\] is str"):
        rp.plan_many([problems[0], "home"])


SCRIPT = """
import rr1plan as rp
scene = rp.Scene().with_arm("a", rp.load_robot("planar2r"))
asked = [rp.Problem(scene, [0.0, 0.0], rp.JointGoal([1.0, 1.0]))] * 4
"""


def test_a_script_without_a_guard_is_told_so(tmp_path):
    file = tmp_path / "unguarded.py"
    file.write_text(SCRIPT + "rp.plan_many(asked, workers=1)\n")
    done = subprocess.run([sys.executable, str(file)], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1
    assert "BackendError: worker processes do not start" in done.stderr


def test_processes_end_without_a_collection_of_all_objects(tmp_path):
    file = tmp_path / "counting.py"
    file.write_text(
        "import atexit, gc\n"
        "atexit.register(lambda: print(gc.get_freeze_count() > 0, flush=True))\n"
        + SCRIPT
        + "if __name__ == '__main__':\n"
        "    rp.plan_many(asked, workers=1)\n"
    )
    done = subprocess.run([sys.executable, str(file)], capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout.split() == ["True", "False"]


def test_a_planner_that_processes_do_not_know_is_named(tmp_path):
    """As one that is defined in a notebook, or below the guard of a script."""
    file = tmp_path / "own_planner.py"
    file.write_text(
        SCRIPT + "if __name__ == '__main__':\n"
        "    class Own(rp.RrtConnect):\n"
        "        name = 'own'\n"
        "    rp.plan_many(asked, workers=1, planner=Own())\n"
    )
    done = subprocess.run([sys.executable, str(file)], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1
    said = done.stderr.splitlines()[-1]
    assert "InputError: planner 'own' cannot be sent to other processes: Can't get attribute 'Own'" in said
    assert said.endswith("define its class in a module, and keep what cannot be pickled out of it")
    assert "Process SpawnProcess" not in done.stderr


def has_ended(group):
    """Whether no process of a group is left; multiprocessing's tracker ends a moment later than the others."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    time.sleep(0.1)
    return False


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends Ctrl-C to consoles, not to processes")
@pytest.mark.parametrize(("send", "number"), [("killpg", "SIGINT"), ("kill", "SIGKILL")])
def test_no_process_is_left_after_ctrl_c_or_a_killed_parent(send, number, tmp_path):
    file = tmp_path / "long.py"
    # the first is solved immediately; an optimizing planner works on the others, which no straight line solves,
    # until its budget ends
    file.write_text(
        SCRIPT + "first = rp.Problem(scene, [0.0, 0.0], rp.PoseGoal('tool', [9.0, 0.0, 0.0]))\n"
        "asked = [*rp.load_problems('planar2r_path').values()][:1] * 4\n"
        "if __name__ == '__main__':\n"
        "    tell = lambda progress: print('begun', flush=True)\n"
        "    settings = dict(planner='rrt_star', full=False, budget=rp.Budget(300), progress=tell)\n"
        "    rp.plan_many([first, *asked], workers=2, **settings)\n"
    )
    run = subprocess.Popen(
        [sys.executable, str(file)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert run.stdout is not None
    assert run.stdout.readline() == "begun\n"
    time.sleep(0.5)
    getattr(os, send)(run.pid, signal.Signals[number])
    assert run.wait(timeout=60) != 0
    try:
        assert any(has_ended(run.pid) for _ in range(100))
    finally:
        with suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
        _, errors = run.communicate()
    assert number != "SIGINT" or errors.rstrip().endswith("KeyboardInterrupt")


def test_dask_leads_off_this_machine(problems):
    distributed = pytest.importorskip("distributed", reason="needs the extra 'batch' (dask.distributed)")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        answers = rp.plan_many(problems, executor=client.get_executor(), rng=7, full=False, budget=BUDGET)
    here = rp.plan_many(problems, executor=InLine(), rng=7, full=False, budget=BUDGET)
    for one, two in zip(paths(here), paths(answers), strict=True):
        np.testing.assert_array_equal(one, two)


def test_problems_of_many_arms_are_planned_in_processes(rr1):
    grid = rp.random_grid(rr1, 2, 0.6, 1)
    here, spawned = (
        rp.plan_many([grid] * 2, rng=5, planner="many_arms", budget=rp.Budget(60.0), **where)
        for where in ({"executor": InLine()}, {"workers": 1})
    )
    for one, two in zip(here, spawned, strict=True):
        assert one
        assert two.many_arms.makespan == pytest.approx(two.trajectory.duration)
        assert one.trajectory.coefficients.tobytes() == two.trajectory.coefficients.tobytes()
        assert {arm for s in two.many_arms.schedules for arm in s.path.agent.arms} == set(grid.arms)
        # The seed of the result repeats it.
        again = rp.plan_motion(grid, planner="many_arms", rng=two.result.seed, budget=rp.Budget(60.0))
        assert again.trajectory.coefficients.tobytes() == two.trajectory.coefficients.tobytes()
    # By default the same planner as plan_motion's, which depends on the number of arms.
    four = rp.random_grid(rr1, 4, 0.8, 1)
    (answer,) = rp.plan_many([four], rng=5, executor=InLine())
    assert answer.many_arms is not None
    (path,) = rp.plan_many([four], rng=5, executor=InLine(), full=False)
    assert path.planner == "rrt_connect"
    with pytest.raises(rp.InputError, match="leave full=True"):
        rp.plan_many([grid], planner="many_arms", full=False)
    with pytest.raises(rp.InputError, match="leaves the paths"):
        rp.plan_many([grid], planner="many_arms", retiming="ruckig_direct")
