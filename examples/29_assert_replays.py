"""Motions in your own tests: failures name elements and times, and other collision checkers give second opinions."""

import rr1plan as rp


def make_motion() -> rp.MotionPlan:
    """The motion under test, with the limits of the real arm."""
    scene = rp.load_scene("rr1_table")
    scene = scene.with_robot("rr1", scene.arms["rr1"].robot.with_limits("hardware"))
    return rp.plan_motion(rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20])), rng=0)


# As pytest would run them.
def test_the_motion_is_valid() -> None:
    """The referee certifies it anew, whatever report it carries."""
    rp.assert_valid(make_motion(), torque_limits=True)


def test_the_arm_follows_it_with_a_payload() -> None:
    """Ten arms with unknown payloads and wrong masses follow it, too."""
    unknown = rp.ReplayVariations(payload=0.3, mass=0.1, count=10, rng=0)
    found = rp.assert_replays(make_motion(), tolerance=0.02, goal_tolerance=0.02, variations=unknown)
    worst = found.worst_case
    print(f"{sum(found.passed)} replays passed; the worst: {found.worst.worst_error:.1e} rad, {found.cases[worst]}")


def test_three_checkers_find_no_contact() -> None:
    """At every millimeter of motion, with separate kinematics."""
    motion = make_motion()
    opinion = rp.second_opinion(motion.trajectory, motion.scene)
    assert opinion.free
    assert opinion.agree, opinion
    print(opinion)


def test_something_is_in_the_way() -> None:
    """Fails: there is a ball on the table."""
    motion = make_motion()
    rp.assert_valid(motion.trajectory, motion.scene.with_obstacle("ball", rp.Sphere(0.06), [-0.30, 0.25, 0.20]))


for test in (
    test_the_motion_is_valid,
    test_the_arm_follows_it_with_a_payload,
    test_three_checkers_find_no_contact,
    test_something_is_in_the_way,
):
    try:
        test()
        print(f"{test.__name__}: passed")
    except AssertionError as error:
        print(f"{test.__name__}: failed\n  {str(error).splitlines()[0]}")
