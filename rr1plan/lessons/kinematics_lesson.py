"""Lesson "kinematics": transforms link by link, DH parameters, both elbows, the Jacobian, ellipses, singularities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rr1plan.checks import Array
from rr1plan.lessons.arm_kinematics import DhTable, dh_table, ellipses, tool_jacobian
from rr1plan.lessons.lesson import Lesson, LessonStep
from rr1plan.lessons.lesson_scenes import refuse_problem, require_flat_arm
from rr1plan.lessons.mathml import math, matrix
from rr1plan.playback.cspace.configuration_space import cspace
from rr1plan.playback.cspace.cspace_page import page_parts
from rr1plan.playback.viewer.page_document import pack_array
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_robot
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rr1plan.playback.viewer.page_document import Document
    from rr1plan.playback.viewer.view_options import Panel, ViewOptions

_CELLS = 120  # of the map of |det J|, along each joint
# Colors of the x and y axes of frames, and of the velocity and force ellipses; safe for red-green color blindness.
X_AXIS, Y_AXIS, VELOCITY, FORCE = "#d55e00", "#0072b2", "#a3428f", "#00805c"
SPEED, PULL = 0.25, 0.1  # lengths on the picture of 1 m/s [m] and of 1 N [m]


class KinematicsLesson(Lesson):
    """Forward, inverse and differential kinematics of an arm of two joints in a plane."""

    name = "kinematics"

    def __init__(self, scene: Scene | None, problem: Problem | None) -> None:
        refuse_problem(self.name, problem)
        if scene is None:
            scene = Scene(name="2R arm").with_arm("arm", load_robot("planar2r"), q=(0.5, 0.9))
        self.scene = scene
        self.arm_name, self.flat = require_flat_arm(self.name, scene)
        self.robot = scene.arms[self.arm_name].robot
        self.table = dh_table(self.robot)
        self.picture = cspace(scene)
        self.steps = _steps(self)

    def determinant(self, q: Array) -> Array:
        """The determinant of J at configurations (..., 2), from the tool's motion in the plane."""
        step = 1e-6
        columns = []
        for k in range(2):
            move = np.eye(2)[k] * step
            columns.append((self.flat.points(q + move)[..., 2, :] - self.flat.points(q - move)[..., 2, :]) / (2 * step))
        (a, c), (b, d) = np.moveaxis(columns[0], -1, 0), np.moveaxis(columns[1], -1, 0)
        return np.asarray(a * d - b * c)

    def map(self) -> tuple[Array, list[Array]]:
        """The determinant of J over the configuration space (n, n), and the curves where it is zero, each (k, 2)."""
        import contourpy

        axes = [
            np.linspace(1.5 * c[0] - 0.5 * c[1], 1.5 * c[-1] - 0.5 * c[-2], _CELLS + 1) for c in self.picture.grid.axes
        ]
        # A little wider, so that a zero on the border of the picture is found.
        wide = [np.linspace(a[0] - (a[1] - a[0]), a[-1] + (a[1] - a[0]), _CELLS + 4) for a in axes]
        values = self.determinant(np.stack(np.meshgrid(*wide, indexing="ij"), axis=-1))
        zero = contourpy.contour_generator(wide[1], wide[0], values).lines(0.0)
        curves = [np.asarray(line)[:, ::-1] for line in zero]
        centers = [0.5 * (a[1:] + a[:-1]) for a in axes]
        return self.determinant(np.stack(np.meshgrid(*centers, indexing="ij"), axis=-1)), curves

    # ---- the page ------------------------------------------------------------------------

    def _page(self, options: ViewOptions) -> tuple[Document, tuple[Panel, ...]]:
        document, panel = page_parts(self.picture, options=options)
        return document, (panel,)

    def _data(self) -> Any:
        values, curves = self.map()
        robot = self.robot
        return {
            "map": pack_array(np.abs(values)),
            "largest": float(np.abs(values).max()),
            "singular": [np.round(curve, 4).tolist() for curve in curves],
            "joints": [{"slides": robot.joint(name).kind == "prismatic"} for name in robot.joint_names],
            "flat": {
                "kinds": self.flat.kinds,
                "base": [self.flat.base.real, self.flat.base.imag],
                "height": self.flat.height,
                "bars": [[bar.real, bar.imag] for bar in self.flat.bars],
                "senses": list(self.flat.senses),
                "slides": [[way.real, way.imag] for way in self.flat.slides],
            },
            "colors": {"x": X_AXIS, "y": Y_AXIS, "velocity": VELOCITY, "force": FORCE},
            "scales": [SPEED, PULL],
        }

    # ---- the figure ----------------------------------------------------------------------

    def _draw(self, figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        self._draw_arm(left)
        self._draw_map(figure, right)

    def _draw_arm(self, axes: Axes) -> None:
        """The arm with its frames, the other elbow, and the ellipses for several configurations."""
        from matplotlib.patches import Ellipse as Drawn
        from matplotlib.patheffects import withStroke

        q = np.array(self.scene.arms[self.arm_name].q)
        both = self.flat.solutions(self.flat.points(q)[2])
        for other in both:
            if np.isfinite(other).all() and np.abs(np.angle(np.exp(1j * (other - q)))).max() > 1e-6:
                axes.plot(*self.flat.points(other).T, "o--", color="#9aa5b3", lw=3, label="the other solution")
        axes.plot(*self.flat.points(q).T, "o-", color="#22262b", lw=5, ms=9)
        frames = self.table.frames(q)
        base = self.scene.arms[self.arm_name].base
        for k, frame in enumerate(base @ frames):
            for axis, color in ((0, X_AXIS), (1, Y_AXIS)):
                way = 0.28 * frame[:2, axis]
                axes.annotate(
                    "", frame[:2, 3] + way, frame[:2, 3], arrowprops={"arrowstyle": "-|>", "color": color, "lw": 2}
                )
            label = axes.annotate(
                f"{{{k}}}",
                frame[:2, 3],
                -20.0 * (frame[:2, 0] + frame[:2, 1]),  # opposite to both axes
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=13,
                zorder=9,
            )
            label.set_path_effects([withStroke(linewidth=4, foreground="white")])
        bends = np.linspace(0.25, 2.7, 6)
        for k, second in enumerate(bends):
            at = np.array([q[0], second]) if self.flat.kinds == "RR" else q
            if self.flat.kinds != "RR" and k:
                break
            turn = -1.4 - 0.15 * k if self.flat.kinds == "RR" else 0.0
            self._draw_ellipse(axes, Drawn, at + np.array([turn, 0.0]), faint=True)
        self._draw_ellipse(axes, Drawn, q, faint=False)
        reach = 1.12 * sum(abs(bar) for bar in self.flat.bars)
        x, y = base[:2, 3]
        axes.set(
            aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(x - reach, x + reach), ylim=(y - reach, y + reach)
        )
        axes.set_title("frames, both solutions, ellipses", loc="left")
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="upper left", fontsize=11, frameon=False)

    def _draw_ellipse(self, axes: Axes, drawn: Any, q: Array, faint: bool) -> None:
        tip = self.flat.points(q)[2]
        base = self.scene.arms[self.arm_name].base[:3, :3]
        found = ellipses((base @ tool_jacobian(self.robot, q))[:2])
        angle = float(np.degrees(np.arctan2(found.directions[1, 0], found.directions[0, 0])))
        kinds = [(found.velocity, SPEED, VELOCITY, "velocity ellipse", "-")]
        if not faint:
            kinds.append((found.force, PULL, FORCE, "force ellipse", "--"))
        else:
            axes.plot(*self.flat.points(q).T, "-", color="#c9ced6", lw=1.5, zorder=0)
        for sizes, scale, color, label, line in kinds:
            sizes = np.minimum(sizes * scale, 2.0)
            patch = drawn(tuple(tip), 2 * sizes[0], 2 * sizes[1], angle=angle, fill=False, edgecolor=color, ls=line)
            patch.set(linewidth=1.2 if faint else 2.4, alpha=0.7 if faint else 1.0, label=None if faint else label)
            axes.add_patch(patch)

    def _draw_map(self, figure: Figure, axes: Axes) -> None:
        """|det J| over the configuration space, and its zeros."""
        grid = self.picture.grid
        extent = [edge for c in grid.axes for edge in (1.5 * c[0] - 0.5 * c[1], 1.5 * c[-1] - 0.5 * c[-2])]
        values, curves = self.map()
        image = axes.imshow(np.abs(values).T, origin="lower", extent=tuple(extent), cmap="cividis", aspect="auto")
        for k, curve in enumerate(curves):
            axes.plot(*curve.T, color="white", lw=5)
            axes.plot(*curve.T, color="#d55e00", lw=2.4, ls="--", label=None if k else "singular: det J = 0")
        axes.plot(*grid.wrapped(self.scene.arms[self.arm_name].q), "o", color="white", mec="#22262b", ms=11)
        axes.set(xlim=extent[:2], ylim=extent[2:])
        for axis, name, turns in zip((axes.xaxis, axes.yaxis), grid.joint_names, grid.turns, strict=True):
            axis.set_label_text(f"{name} [{'rad' if turns else 'm'}]")
        axes.set_box_aspect(1.0)
        axes.set_title("manipulability |det J|", loc="left")
        if curves:
            axes.legend(loc="upper right", fontsize=11)
        figure.colorbar(image, ax=axes, shrink=0.75)


def _live(name: str, size: int) -> str:
    """A square matrix whose numbers the page fills in."""
    return matrix(*(tuple(f'<mn data-live="{name}{i}{k}">0</mn>' for k in range(size)) for i in range(size)))


def _dot(symbol: str) -> str:
    return f"<mover><mi>{symbol}</mi><mo>˙</mo></mover>"


def _product() -> str:
    """The transform from base to tool as the product of those of the links."""

    def transform(a: int, b: int) -> str:
        return f"<mmultiscripts><mi>T</mi><mn>{b}</mn><none/><mprescripts/><none/><mn>{a}</mn></mmultiscripts>"

    factors = (transform(0, 1), transform(1, 2), "=", _live("A", 3), _live("B", 3))
    return math(transform(0, 2), "=", *factors, "=", _live("C", 3), block=True)


def _dh_rows(table: DhTable) -> str:
    cells = ""
    for k, row in enumerate(table.rows, 1):
        own = "d" if row.slides else "θ"
        offset = f"{np.degrees(row.theta):.0f}°"
        turned = "" if abs(row.theta) < 1e-9 else f" + {offset}"
        theta = offset if row.slides else f"θ<sub>{k}</sub>{turned}"
        d = f"d<sub>{k}</sub>" + f" + {row.d:g}" * (abs(row.d) > 1e-9) if row.slides else f"{row.d:.3g}"
        cells += (
            f"<tr><td>{k}</td><td>{row.a:.3g} m</td><td>{np.degrees(row.alpha):.0f}°</td><td>{d}</td><td>{theta}</td>"
            f'<td>{own}<sub>{k}</sub> = <span data-live="q{k - 1}"></span></td></tr>'
        )
    return "<table><tr><th>joint</th><th>a</th><th>α</th><th>d</th><th>θ</th><th>now</th></tr>" + cells + "</table>"


def _steps(lesson: KinematicsLesson) -> tuple[LessonStep, ...]:
    q = tuple(float(v) for v in lesson.scene.arms[lesson.arm_name].q)
    revolute = lesson.flat.kinds == "RR"
    first, second = (abs(bar) for bar in lesson.flat.bars)

    inverse = (
        f"""<p>For a point (x, y) at the distance r, the law of cosines gives the bend of the elbow,
        cos θ<sub>2</sub> = (r² − {first:g}² − {second:g}²) / (2 · {first:g} · {second:g}), and its sign is free:
        <b>two solutions</b>, the arm and its faint twin, ● and ○ in the configuration space. One on the boundaries,
        none outside.</p><p>Tool at (<span data-live="x"></span>, <span data-live="y"></span>): elbow 1 at
        <span data-live="one"></span>, elbow 2 at <span data-live="two"></span>. Press E to switch; drag the tool to a
        boundary and see them coincide.</p>"""
        if revolute
        else """<p>Given a point (x, y), which joint values put the tool there? The arm’s faint twin is the other
        solution, where there is one. Tool at (<span data-live="x"></span>, <span data-live="y"></span>): solution 1
        at <span data-live="one"></span>, solution 2 at <span data-live="two"></span>.</p>"""
    )
    where = (
        f"""<p>det J = {first:g} · {second:g} · sin θ<sub>2</sub>, now <b><span data-live="det"></span></b>: zero where
        the arm is <b>stretched or folded</b>: the dashed lines θ<sub>2</sub> = 0 and ±π on the right, the two
        boundaries of the annulus on the left. They split the square into elbow-left and elbow-right: to change the
        elbow, the arm has to pass a singularity.</p>"""
        if revolute
        else """<p>det J is now <b><span data-live="det"></span></b>. It is zero on the dashed lines of the
        configuration space, if there are any; the tool is then on the boundary of its reachable region.</p>"""
    )
    rows = (
        (
            "transforms",
            "Transforms, link by link",
            f"""{_product()}
            <p>Every link carries a frame at its far end, <i class="x">x</i> and <i class="y">y</i>. Each link adds one
            matrix, so the pose of the tool is a product; in the plane, 3 × 3 suffices. The last column is the position
            of the next frame. Move a joint: one factor changes, and with it the product.</p>""",
        ),
        (
            "dh",
            "DH parameters",
            f"""{_dh_rows(lesson.table)}<p>Denavit and Hartenberg put z along the joint axes and x along their
            common normals; then four numbers describe a link: <b>a</b> along the normal, <b>α</b> about it,
            <b>d</b> along the axis, <b>θ</b> about it. One of them is the joint’s variable, and A =
            Rot<sub>z</sub>(θ) Trans<sub>z</sub>(d) Trans<sub>x</sub>(a) Rot<sub>x</sub>(α).</p>""",
        ),
        ("inverse", "Inverse kinematics: both elbows" if revolute else "Inverse kinematics", inverse),
        (
            "jacobian",
            "The Jacobian",
            f"""{math(matrix((_dot("x"),), (_dot("y"),)), "=", _live("J", 2), _dot("q"), block=True)}
            <p>The tool velocity is linear in the joint velocities. Column k, drawn as an arrow, is the velocity of the
            tool when joint k alone moves at 1: perpendicular to the line from joint to tool, and equally long. Forces
            map the other way, by the transpose: τ = J<sup>T</sup> F.</p>""",
        ),
        (
            "ellipses",
            "Velocity and force ellipse",
            """<p>Joint velocities of length 1 give tool velocities on an <b>ellipse</b> (solid), whose semi-axes are
            the singular values of J: <span data-live="s1"></span> and <span data-live="s2"></span>. Along its long axis
            the tool is fast; the <b>force ellipse</b> (dashed) has the same axes and reciprocal lengths: where the arm
            is slow, it is strong.</p><p>The product of the singular values is the manipulability w = |det J| = <b><span
            data-live="w"></span></b> (Yoshikawa 1985), the color on the right: bright is large.</p>""",
        ),
        (
            "singularities",
            "Singularities",
            where
            + """<p>There J loses rank: one semi-axis is zero; the tool cannot move in that direction at any joint
            speed, and withstands any force in that direction without torque.</p>""",
        ),
    )
    poses = {"singularities": (q[0], 0.02) if revolute else q}
    return tuple(LessonStep(name, title, text, poses.get(name, q)) for name, title, text in rows)
