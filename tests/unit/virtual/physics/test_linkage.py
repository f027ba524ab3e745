"""What joints feel of each other's links, beside the formulas of a double pendulum as textbooks have them."""

import math
from collections.abc import Sequence

import pytest

from servobus.virtual.physics.linkage import Link, Linkage

G = 9.80665
M1, L1, M2, L2 = 0.3, 0.2, 0.15, 0.12
POSES = [(0.0, 0.0), (math.pi / 2, 0.0), (math.pi / 2, -math.pi / 2), (0.4, 0.9), (-2.0, 1.1), (3.0, -0.5)]


def two_links(down: tuple[float, float] = (0.0, 0.0), sense: tuple[int, int] = (1, 1)) -> Linkage:
    return Linkage(
        [
            Link(mass=M1, length=L1, down=down[0], sense=sense[0]),
            Link(mass=M2, length=L2, down=down[1], sense=sense[1], parent=0),
        ]
    )


@pytest.mark.parametrize("pose", POSES)
def test_gravity_on_two_links(pose: tuple[float, float]) -> None:
    a, b = pose
    felt = two_links().feel(pose, (0.0, 0.0))
    outer = M2 * G * L2 * math.sin(a + b)
    assert felt.torque == pytest.approx([-(M1 + M2) * G * L1 * math.sin(a) - outer, -outer], abs=1e-12)


def test_an_arm_stretched_out_level_feels_its_masses_by_their_levers() -> None:
    felt = two_links().feel((math.pi / 2, 0.0), (0.0, 0.0))
    # 0.3 kg at 0.2 m and 0.15 kg at 0.32 m; 0.15 kg at 0.12 m
    assert felt.torque == pytest.approx([-(0.588399 + 0.470719), -0.176520], abs=1e-6)
    assert [felt.inertia[0][0], felt.inertia[1][1]] == pytest.approx([0.012 + 0.01536, 0.00216])


@pytest.mark.parametrize("pose", POSES)
def test_inertia_and_what_speeds_do_on_two_links(pose: tuple[float, float]) -> None:
    b = pose[1]
    v, w = 1.3, -2.1
    felt, still = two_links().feel(pose, (v, w)), two_links().feel(pose, (0.0, 0.0))
    coupling = M2 * L1 * L2 * math.cos(b)
    inner = (M1 + M2) * L1**2 + M2 * L2**2 + 2 * coupling
    assert felt.inertia[0] == pytest.approx([inner, M2 * L2**2 + coupling])
    assert felt.inertia[1] == pytest.approx([M2 * L2**2 + coupling, M2 * L2**2])
    h = M2 * L1 * L2 * math.sin(b)
    speeds = [one - other for one, other in zip(felt.torque, still.torque, strict=True)]
    assert speeds == pytest.approx([h * (2 * v * w + w * w), -h * v * v], abs=1e-12)


def test_down_and_sense_say_where_the_angles_of_a_joint_count_from() -> None:
    plain = two_links().feel((0.4, 0.9), (1.0, -0.5))
    moved = two_links(down=(0.1, -0.2)).feel((0.5, 0.7), (1.0, -0.5))
    assert moved.torque == pytest.approx(plain.torque)
    turned = two_links(sense=(1, -1)).feel((0.4, -0.9), (1.0, 0.5))
    assert turned.torque == pytest.approx([plain.torque[0], -plain.torque[1]])
    assert turned.inertia[0][1] == pytest.approx(-plain.inertia[0][1])


def test_an_upright_axis_feels_how_far_out_the_arm_reaches() -> None:
    arm = Linkage(
        [
            Link(mass=0.5, length=0.05),
            Link(mass=M1, length=L1, down=0.0, parent=0),
            Link(mass=M2, parent=1, length=0.03),
        ]
    )
    felt = arm.feel((0.7, 0.6, 0.2), (2.0, 0.5, 0.0))
    reach, mass = 0.05 + L1 * math.sin(0.6), M1 + M2
    assert felt.inertia[0] == pytest.approx([0.5 * 0.05**2 + mass * reach**2, 0.0, 0.0])
    # m r w² outwards on the lever l cos, and gravity; 2 m r r' w against the turn
    out = mass * reach * 2.0**2 * L1 * math.cos(0.6)
    assert felt.torque[1] == pytest.approx(out - mass * G * L1 * math.sin(0.6))
    assert felt.torque[0] == pytest.approx(-2 * mass * reach * (L1 * math.cos(0.6) * 0.5) * 2.0)
    assert felt.torque[2] == 0.0  # what rolls feels nothing of gravity, and only its own inertia
    assert felt.inertia[2] == pytest.approx([0.0, 0.0, M2 * 0.03**2])


def solve(matrix: Sequence[Sequence[float]], right: Sequence[float]) -> list[float]:
    """Solve a linear system by elimination."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for n, pivot in enumerate(rows):
        for row in rows[n + 1 :]:
            share = row[n] / pivot[n]
            row[n:] = [one - share * other for one, other in zip(row[n:], pivot[n:], strict=True)]
    found: list[float] = []
    for n in reversed(range(len(rows))):
        known = sum(one * other for one, other in zip(rows[n][n + 1 : -1], found, strict=True))
        found.insert(0, (rows[n][-1] - known) / rows[n][n])
    return found


def test_nothing_in_a_tree_of_links_gains_or_loses_energy() -> None:
    links = [
        Link(mass=0.2, length=0.1),
        Link(mass=0.3, length=0.2, down=0.0, parent=0),
        Link(mass=0.1, length=0.15, down=0.3, parent=1),
        Link(mass=0.2, length=0.1, down=-0.4, sense=-1, parent=1),
    ]
    tree = Linkage(links)

    def masses(q: Sequence[float]) -> list[tuple[float, float, float]]:
        """Give where the masses are, drawn by hand."""
        r, fore, left, right = 0.1, q[1], q[1] + q[2] - 0.3, q[1] - q[3] - 0.4
        end = r + 0.2 * math.sin(fore), -0.2 * math.cos(fore)
        ends = [
            (r, 0.0),
            end,
            (end[0] + 0.15 * math.sin(left), end[1] - 0.15 * math.cos(left)),
            (end[0] + 0.1 * math.sin(right), end[1] - 0.1 * math.cos(right)),
        ]
        return [(r * math.cos(q[0]), r * math.sin(q[0]), z) for r, z in ends]

    def energy(q: Sequence[float], v: Sequence[float]) -> float:
        step = 1e-5
        ahead = masses([one + step * rate for one, rate in zip(q, v, strict=True)])
        behind = masses([one - step * rate for one, rate in zip(q, v, strict=True)])
        total = 0.0
        for link, one, two, here in zip(links, ahead, behind, masses(q), strict=True):
            speed = math.dist(one, two) / (2 * step)
            total += link.mass * (speed**2 / 2 + G * here[2])
        return total

    def slope(state: list[float]) -> list[float]:
        q, v = state[:4], state[4:]
        felt = tree.feel(q, v)
        return v + solve(felt.inertia, felt.torque)

    def ahead(state: list[float], rate: list[float], step: float) -> list[float]:
        return [one + step * by for one, by in zip(state, rate, strict=True)]

    state, dt = [0.0, 2.0, 0.5, -0.3, 3.0, 1.0, -2.0, 0.5], 0.001
    began = energy(state[:4], state[4:])
    for _ in range(300):  # by the rule of Runge and Kutta
        one = slope(state)
        two = slope(ahead(state, one, dt / 2))
        three = slope(ahead(state, two, dt / 2))
        four = slope(ahead(state, three, dt))
        mean = [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(one, two, three, four, strict=True)]
        state = ahead(state, mean, dt)
    assert energy(state[:4], state[4:]) == pytest.approx(began, abs=1e-6)


def test_a_link_stands_behind_its_parent() -> None:
    with pytest.raises(ValueError, match="behind its parent"):
        Linkage([Link(parent=1), Link()])
