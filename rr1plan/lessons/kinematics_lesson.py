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
from rr1plan.playback.cspace.reach_outline import reach_of
from rr1plan.playback.viewer.page_arrays import pack_array
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_robot
from rr1plan.scene.problem import Problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CELLS = 120  # of the map of |det J|, along each joint
# Colors of the x and y axes of frames, and of the velocity and force ellipses; safe for red-green color blindness.
X_AXIS, Y_AXIS, VELOCITY, FORCE = "#d55e00", "#0072b2", "#a3428f", "#00805c"
# On the picture of an arm with this reach [m]: lengths of 1 m/s [m], of 1 N [m] and of the axes of frames [m].
REACH, SPEED, PULL, ARROW = 1.7, 0.25, 0.1, 0.28


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

    @property
    def is_standard(self) -> bool:
        """Whether the second angle of an RR arm is that between its links, both joints turning counter-clockwise."""
        first, second = self.flat.bars
        return self.flat.senses == (1.0, 1.0) and abs((second / first).imag) < 1e-9 and (second / first).real > 0.0

    @property
    def nearly_singular(self) -> tuple[float, float]:
        """An RR arm's configuration with the first joint as in the scene, nearly stretched if the limits allow it."""
        limits, (first, second) = self.robot.limits, self.flat.bars
        bend = self.flat.senses[1] * (0.02 - float(np.angle(second / first)))
        return float(self.scene.arms[self.arm_name].q[0]), float(np.clip(bend, limits.lower[1], limits.upper[1]))

    @property
    def reach(self) -> float:
        """The length of both links; of an arm without lengths, a gantry, the radius of the tool's region [m]."""
        return sum(abs(bar) for bar in self.flat.bars) or reach_of(self.flat, self.robot.limits).radius

    def scales(self) -> tuple[float, float, tuple[float, float]]:
        """Lengths on the picture: of velocities per singular value, of forces per reciprocal one, and of columns of J.

        All are proportional to the arm's reach, whether the columns of J are (revolute joints) or not.
        """
        size = self.reach / REACH
        turning = self.flat.kinds == "RR"
        first, second = (2.0 * SPEED * (1.0 if kind == "R" else size) for kind in self.flat.kinds)
        return SPEED * (1.0 if turning else size), PULL * (size**2 if turning else size), (first, second)

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

        axes = [np.linspace(low, high, _CELLS + 1) for low, high in self.picture.grid.ranges]
        # A little wider, so that a zero on the border of the picture is found.
        wide = [np.linspace(a[0] - (a[1] - a[0]), a[-1] + (a[1] - a[0]), _CELLS + 4) for a in axes]
        values = self.determinant(np.stack(np.meshgrid(*wide, indexing="ij"), axis=-1))
        zero = contourpy.contour_generator(wide[1], wide[0], values).lines(0.0)
        curves = [np.asarray(line)[:, ::-1] for line in zero]
        centers = [0.5 * (a[1:] + a[:-1]) for a in axes]
        return self.determinant(np.stack(np.meshgrid(*centers, indexing="ij"), axis=-1)), curves

    # ---- the page ------------------------------------------------------------------------

    def _data(self) -> Any:
        values, curves = self.map()
        base = self.scene.arms[self.arm_name].base
        return {
            "map": pack_array(np.abs(values)),
            "largest": float(np.abs(values).max()),
            "singular": [np.round(curve, 4).tolist() for curve in curves],
            "colors": {"x": X_AXIS, "y": Y_AXIS, "velocity": VELOCITY, "force": FORCE},
            "size": self.reach / REACH,
            "scales": self.scales(),
            "yaw": float(np.arctan2(base[1, 0], base[0, 0])),
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
        other = self._other_solution(q)
        if other is not None:
            axes.plot(*self.flat.points(other).T, "o--", color="#9aa5b3", lw=3, label="the other solution")
        axes.plot(*self.flat.points(q).T, "o-", color="#22262b", lw=5, ms=9)
        frames = self.table.frames(q)
        base = self.scene.arms[self.arm_name].base
        for k, frame in enumerate(base @ frames):
            for axis, color in ((0, X_AXIS), (1, Y_AXIS)):
                way = ARROW * self.reach / REACH * frame[:2, axis]
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
        # A margin around all points that the tool reaches.
        low, high = (edge(self._tool_places(), axis=0) for edge in (np.min, np.max))
        low, high = 0.5 * (low + high) - 0.56 * (high - low), 0.5 * (low + high) + 0.56 * (high - low)
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.set_title(f"frames, {'both solutions, ' * (other is not None)}ellipses", loc="left")
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(loc="upper left", fontsize=11, frameon=False)

    def _other_solution(self, q: Array) -> Array | None:
        """The other configuration with the tool in the same place, if a sliding joint is within its limits there."""
        limits = self.robot.limits
        slides = np.array([kind == "P" for kind in self.flat.kinds])
        for other in self.flat.solutions(self.flat.points(q)[2]):
            away = np.where(slides, other - q, np.angle(np.exp(1j * (other - q))))
            within = (other >= limits.lower) & (other <= limits.upper)
            if np.abs(away).max() > 1e-6 and (within | ~slides).all():
                return np.asarray(other)
        return None

    def _tool_places(self) -> Array:
        """Positions of the tool in a grid over the configuration space [m], shape (k, 2)."""
        samples = [np.linspace(centers[0], centers[-1], 61) for centers in self.picture.grid.axes]
        return self.flat.points(np.stack(np.meshgrid(*samples), axis=-1).reshape(-1, 2))[:, 2]

    def _draw_ellipse(self, axes: Axes, drawn: Any, q: Array, faint: bool) -> None:
        tip = self.flat.points(q)[2]
        base = self.scene.arms[self.arm_name].base[:3, :3]
        found = ellipses((base @ tool_jacobian(self.robot, q))[:2])
        angle = float(np.degrees(np.arctan2(found.directions[1, 0], found.directions[0, 0])))
        speed, pull, _ = self.scales()
        kinds = [(found.velocity, speed, VELOCITY, "velocity ellipse", "-")]
        if not faint:
            kinds.append((found.force, pull, FORCE, "force ellipse", "--"))
        else:
            axes.plot(*self.flat.points(q).T, "-", color="#c9ced6", lw=1.5, zorder=0)
        for sizes, scale, color, label, line in kinds:
            sizes = np.minimum(sizes * scale, 1.2 * self.reach)
            patch = drawn(tuple(tip), 2 * sizes[0], 2 * sizes[1], angle=angle, fill=False, edgecolor=color, ls=line)
            patch.set(linewidth=1.2 if faint else 2.4, alpha=0.7 if faint else 1.0, label=None if faint else label)
            axes.add_patch(patch)

    def _draw_map(self, figure: Figure, axes: Axes) -> None:
        """|det J| over the configuration space, and its zeros."""
        grid = self.picture.grid
        extent = (*grid.ranges[0], *grid.ranges[1])
        values, curves = self.map()
        image = axes.imshow(np.abs(values).T, origin="lower", extent=extent, cmap="cividis", aspect="auto", vmin=0.0)
        for k, curve in enumerate(curves):
            axes.plot(*curve.T, color="white", lw=5)
            axes.plot(*curve.T, color="#d55e00", lw=2.4, ls="--", label=None if k else "singular: det J = 0")
        axes.plot(*grid.wrapped(self.scene.arms[self.arm_name].q), "o", color="white", mec="#22262b", ms=11)
        axes.set(xlim=extent[:2], ylim=extent[2:])
        for axis, name, turns in zip((axes.xaxis, axes.yaxis), grid.joint_names, grid.turns, strict=True):
            axis.set_label_text(f"{name} [{'rad' if turns else 'm'}]")
        axes.set_box_aspect(1.0)
        unit = ("", " [m]", " [m²]")[self.flat.kinds.count("R")]
        axes.set_title(f"manipulability |det J|{unit}", loc="left")
        if curves:
            axes.legend(loc="upper right", fontsize=11)
        figure.colorbar(image, ax=axes, shrink=0.75)


def _live(name: str, size: int) -> str:
    """A square matrix whose numbers the page fills in."""
    return matrix(*(tuple(f'<mn data-live="{name}{i}{k}">0</mn>' for k in range(size)) for i in range(size)))


def _dot(symbol: str) -> str:
    return f"<mover><mi>{symbol}</mi><mo>˙</mo></mover>"


def _product() -> str:
    """The transform from base to tool as the product of those of the links; where that is too long, on two lines."""

    def transform(a: int, b: int) -> str:
        return f"<mmultiscripts><mi>T</mi><mn>{b}</mn><none/><mprescripts/><none/><mn>{a}</mn></mmultiscripts>"

    factors = (transform(0, 1), transform(1, 2), "=", _live("A", 3), _live("B", 3))
    left, right = math(transform(0, 2), "=", *factors), math("=", _live("C", 3))
    return f'<p class="product">{left} {right}</p>'


def _dh_rows(table: DhTable) -> str:
    cells = ""
    for k, row in enumerate(table.rows, 1):
        own = "d" if row.slides else "θ"
        turned, moved, alpha = np.degrees(row.theta), row.d, f"{np.degrees(row.alpha):z.0f}".replace("-", "−")
        theta = f"{turned:z.0f}°".replace("-", "−") if row.slides else f"θ<sub>{k}</sub>{_offset(turned, '°')}"
        d = f"d<sub>{k}</sub>{_offset(moved, ' m')}" if row.slides else f"{moved:z.3g} m"
        cells += (
            f"<tr><td>{k}</td><td>{row.a:z.3g} m</td><td>{alpha}°</td><td>{d}</td><td>{theta}</td>"
            f'<td>{own}<sub>{k}</sub> = <span data-live="q{k - 1}"></span></td></tr>'
        )
    return "<table><tr><th>joint</th><th>a</th><th>α</th><th>d</th><th>θ</th><th>now</th></tr>" + cells + "</table>"


def _offset(value: float, unit: str) -> str:
    """A constant behind a variable, with its sign: " + 90°"; nothing for zero."""
    return "" if abs(value) < 1e-9 else f" {'−' if value < 0.0 else '+'} {abs(value):.3g}{unit}"


def _inverse(lesson: KinematicsLesson) -> str:
    place = """<p>Tool at (<span data-live="x"></span>, <span data-live="y"></span>): solution 1
        <span data-live="one"></span>, solution 2 <span data-live="two"></span>. Press E to switch; drag the tool to
        a boundary and see them coincide.</p>"""
    first, second = (abs(bar) for bar in lesson.flat.bars)
    match lesson.flat.kinds:
        case "RR":
            bend = "θ<sub>2</sub>" if lesson.is_standard else "β"
            between = "" if lesson.is_standard else " β between the two links"
            middle = "" if first != second else " At the base itself every angle of the first link is a solution."
            return f"""<p>For a point (x, y) at the distance r from the base, the law of cosines gives the
            bend{between}, cos {bend} = (r² − {first:g}² − {second:g}²) / (2 · {first:g} · {second:g}), and its sign is
            free: <b>two solutions</b>, the arm and its faint twin, ● and ○ in the configuration space. One on the
            boundaries, none beyond them.{middle}</p>{place}"""
        case "PP":
            return """<p>Which joint values put the tool at a point (x, y)? Each coordinate belongs to one joint: the
            equations are linear and have <b>one solution</b>. Tool at (<span data-live="x"></span>, <span
            data-live="y"></span>), joints at <span data-live="one"></span>.</p>"""
        case _:
            return f"""<p>Which joint values put the tool at a point (x, y)? The equations are quadratic and have two
            solutions. The arm’s faint twin is the other one, if it is within the limits of the sliding
            joint.</p>{place}"""


def _columns(kinds: str) -> str:
    turning = "perpendicular to the line from joint to tool, and as long as this line"
    match kinds:
        case "RR":
            return f"at 1 rad/s: {turning}"
        case "PP":
            return "at 1 m/s: the direction of its axis, of length 1"
        case _:
            return (
                f"at 1 rad/s or 1 m/s. That of the revolute joint is {turning}; that of the prismatic one is its axis"
            )


def _where(lesson: KinematicsLesson) -> str:
    """Where the determinant of the Jacobian is zero."""
    now = '<b><span data-live="det"></span></b>'
    first, second = (abs(bar) for bar in lesson.flat.bars)
    match lesson.flat.kinds:
        case "RR":
            formula, lines = (
                f"det J = {first:g} · {second:g} · sin θ<sub>2</sub>, now {now}: zero",
                "θ<sub>2</sub> = 0 and ±π",
            )
            if not lesson.is_standard:
                formula, lines = f"det J is now {now}: zero", "of the two elbow angles"
            if not lesson.map()[1]:
                return f"""<p>{formula} where the arm is <b>stretched or folded</b>, on the boundaries of the annulus.
                The joint limits of this arm exclude both.</p>"""
            return f"""<p>{formula} where the arm is <b>stretched or folded</b>: the dashed lines {lines} on the right,
            the two boundaries of the annulus on the left. They split the square into elbow-left and elbow-right: to
            change the elbow, the arm has to pass a singularity.</p>"""
        case "RP":
            size = now.replace("det", "w")
            return f"""<p>|det J| is the length of sleeve and rod from the base to the tool, now {size}: zero only where
            the tool would be nearest to the base. A dashed line shows it in the configuration space, if the rod
            retracts that far.</p>"""
        case "PR":
            return f"""<p>det J is now {now}: zero where the link is at a <b>right angle to the rail</b>, on the dashed
            lines. The tool is then as far from the rail as it gets, and the two solutions coincide.</p>"""
        case _:
            return f"""<p>det J is {now} everywhere: this arm has no singularities.</p>"""


def _steps(lesson: KinematicsLesson) -> tuple[LessonStep, ...]:
    q = tuple(float(v) for v in lesson.scene.arms[lesson.arm_name].q)
    kinds = lesson.flat.kinds
    inverse, where = _inverse(lesson), _where(lesson)
    unit = {"RR": "1 rad/s", "PP": "1 m/s"}.get(kinds, "1 (rad/s and m/s)")
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
            Rot<sub>z</sub>(θ) Trans<sub>z</sub>(d) Trans<sub>x</sub>(a) Rot<sub>x</sub>(α). (Standard convention, as
            in Siciliano; Craig and Lynch, Park count a and α from the joint before.)</p>""",
        ),
        ("inverse", "Inverse kinematics: both elbows" if kinds == "RR" else "Inverse kinematics", inverse),
        (
            "jacobian",
            "The Jacobian",
            f"""{math(matrix((_dot("x"),), (_dot("y"),)), "=", _live("J", 2), _dot("q"), block=True)}
            <p>The tool velocity is linear in the joint velocities. Column k, drawn as an
            arrow{"" if kinds == "PP" else " at half its length"}, is the velocity of the tool when joint k alone moves
            {_columns(kinds)}. Forces map the other way, by the transpose: τ = J<sup>T</sup> F.</p>""",
        ),
        (
            "ellipses",
            "Velocity and force ellipse",
            f"""<p>Joint velocities of length {unit} give tool velocities on an <b>ellipse</b> (solid), whose semi-axes
            are the singular values of J: <span data-live="s1"></span> and <span data-live="s2"></span>. Along its long
            axis the tool is fast; the <b>force ellipse</b> (dashed) has the same axes and reciprocal lengths: where
            the arm is slow, it is strong.</p><p>The product of the singular values is the manipulability w = |det J| =
            <b><span data-live="w"></span></b> (Yoshikawa 1985), the color on the right: bright is large.</p>""",
        ),
        (
            "singularities",
            "Singularities",
            where
            + """<p>In a singularity J loses rank: one semi-axis is zero; the tool cannot move in that direction at any
            joint speed, and withstands any force in that direction without torque.</p>""",
        ),
    )
    poses = {"singularities": lesson.nearly_singular if kinds == "RR" else q}
    return tuple(LessonStep(name, title, text, poses.get(name, q)) for name, title, text in rows)
