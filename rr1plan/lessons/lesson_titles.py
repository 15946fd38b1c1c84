"""Classes and titles of the lessons by name."""

from __future__ import annotations

# In the order of a course: the class of each lesson, in the module `<name>_lesson`, and its title.
LESSONS = {
    "workspace": ("WorkspaceLesson", "Workspace"),
    "configuration_space": ("ConfigurationSpaceLesson", "Configuration space"),
    "kinematics": ("KinematicsLesson", "Kinematics"),
    "no_path": ("NoPathLesson", "No free path although both ends are free"),
    "planning": ("PlanningLesson", "Planning step by step"),
    "potential_fields": ("PotentialFieldsLesson", "Potential fields"),
    "motion": ("MotionLesson", "From path to motion"),
    "continuous_checking": ("ContinuousCheckingLesson", "Continuous checking"),
    "two_arms": ("TwoArmsLesson", "Two 2R arms"),
    "six_joints": ("SixJointsLesson", "Six joints"),
}
