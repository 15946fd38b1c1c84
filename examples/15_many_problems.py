"""Many problems at once, over processes: a seed for each, results in order, and one failure does not affect others."""

import numpy as np

import rr1plan as rp


def report(progress):
    print(f"{100 * progress.fraction:3.0f} % after {progress.seconds:.1f} s")


# Spawned processes import this file: the guard below keeps them from running the rest.
def main():
    scene = rp.load_scene("rr1_table")
    places = [[-0.30, y, 0.20] for y in np.linspace(-0.3, 0.3, 6)] + [[3.0, 0.0, 0.2]]
    problems = [rp.Problem(scene, "home", rp.PoseGoal("tool", place)) for place in places]

    motions = rp.plan_many(problems, workers=2, rng=0, progress=report)
    for place, motion in zip(places, motions, strict=True):
        if isinstance(motion, rp.PlanFailure):  # it raised, or its process died
            print(np.round(place, 2), motion.error, "-", motion.reason)
        elif motion.valid:
            print(np.round(place, 2), f"{motion.trajectory.duration:.2f} s")
        else:
            print(np.round(place, 2), motion.status, "-", motion.reason)

    # Any concurrent.futures.Executor will do. Beyond one machine, with the extra `batch`:
    #     client = distributed.Client("scheduler:8786")
    #     rp.plan_many(problems, executor=client.get_executor(), workers=64, rng=0)


if __name__ == "__main__":
    main()
