"""Links that hang on each other: what each joint of an arm feels of all the others.

Each link is a bar without mass, with a point mass at its end, where the joints after it sit.

    swinging joint    has an angle `down`: its link turns in an upright plane, the same for all joints of a tree
    other joint       one at the root of a tree turns about an upright axis, and the plane of all that sits on it with
                      it; one further out rolls about its own axis: its mass, and what sits on it, are where it is

    angle of a link   φ = φ of the parent + sense (q - down), from straight down; q is the angle of the joint
    end of a link     r = r of the parent + length sin φ, z = z of the parent - length cos φ
    upright axis      its link lies level: r = length, z = 0, φ = 0

With Jacobians  (∂r/∂q_i, ∂z/∂q_i) = sense_i (z_joint - z, r - r_joint)  for all joints i before a mass that swing,
where r and z are those of the mass and of the joint, and with the turn ψ of the upright axis:

    inertia   M_ij = Σ m (∂r/∂q_i ∂r/∂q_j + ∂z/∂q_i ∂z/∂q_j),   M_ψψ = Σ m r²,   all other M_ψi = 0
    torque    T_i = -Σ m (∂r/∂q_i (a_r - r ψ'²) + ∂z/∂q_i (g + a_z)),   T_ψ = -Σ 2 m r r' ψ'
    motion    Σ_j M_ij q_j'' = T_i + what motors and friction do

a_r and a_z is the acceleration that a mass has from the speeds alone: each link pulls its end towards its joint with
length φ'². These are the equations of Lagrange for point masses; nothing in them gains or loses energy. What rolls has
the inertia m length² of its own.

Angles in rad, lengths in m, masses in kg, inertias in kg·m², torques in N·m.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import NamedTuple

from servobus.virtual.physics.motor import GRAVITY


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """What a joint carries."""

    mass: float = 0.0  # kg, at the end of the link
    length: float = 0.0  # m
    down: float | None = None  # rad, angle of the joint where the link goes on as its parent does, or hangs down
    sense: int = 1  # -1 for a joint that turns the other way round than those with 1, seen from one side
    parent: int | None = None  # number of the link at whose end this one sits


@dataclass(frozen=True, slots=True)
class Felt:
    """What the joints feel of the links, joint by joint in their order."""

    inertia: list[list[float]]
    """kg·m²: how much torque on the one joint an acceleration of the other one takes."""
    torque: list[float]
    """N·m of gravity and of what the speeds do, towards larger angles."""


class _End(NamedTuple):
    """The end of a link: where it is, how fast it moves, and what acceleration it has from speeds alone."""

    angle: float = 0.0
    rate: float = 0.0
    r: float = 0.0
    z: float = 0.0
    r_rate: float = 0.0
    r_pull: float = 0.0
    z_pull: float = 0.0


GROUND = _End()


class Linkage:
    """The links of one or more arms; each link stands behind its parent."""

    def __init__(self, links: Sequence[Link]) -> None:
        self.links = list(links)
        if any(link.parent is not None and not 0 <= link.parent < n for n, link in enumerate(self.links)):
            raise ValueError("a link stands behind its parent")
        self._ways = [self._way_to(n) for n in range(len(self.links))]
        """Link -> the joints from the root to it."""

    def _way_to(self, n: int) -> list[int]:
        way = [n]
        while (parent := self.links[way[0]].parent) is not None:
            way.insert(0, parent)
        return way

    def feel(self, angles: Sequence[float], speeds: Sequence[float]) -> Felt:
        """Tell what the joints feel at these angles and speeds."""
        links, count = self.links, len(self.links)
        inertia = [[0.0] * count for _ in range(count)]
        torque = [0.0] * count
        joints: list[_End] = []
        ends: list[_End] = []
        for n, (link, way) in enumerate(zip(links, self._ways, strict=True)):
            joints.append(joint := GROUND if link.parent is None else ends[link.parent])
            ends.append(end := _end_of(link, joint, angles[n], speeds[n]))
            if not link.mass:
                continue
            mass, root = link.mass, way[0]
            out, up = mass * end.r_pull, mass * (GRAVITY + end.z_pull)
            if links[root].down is None:
                turn, lever = speeds[root], mass * end.r
                inertia[root][root] += lever * end.r
                torque[root] -= 2 * lever * end.r_rate * turn
                out -= lever * turn * turn
            if link.down is None and n != root:
                inertia[n][n] += mass * link.length**2
            slopes = [
                (i, links[i].sense * (joints[i].z - end.z), links[i].sense * (end.r - joints[i].r))
                for i in way
                if links[i].down is not None
            ]
            for i, r_i, z_i in slopes:
                torque[i] -= r_i * out + z_i * up
                for j, r_j, z_j in slopes:
                    inertia[i][j] += mass * (r_i * r_j + z_i * z_j)
        return Felt(inertia, torque)


def _end_of(link: Link, joint: _End, angle: float, speed: float) -> _End:
    """Give the end of a link that sits on a joint."""
    if link.down is None:
        return _End(r=link.length) if link.parent is None else joint
    turned, rate = joint.angle + link.sense * (angle - link.down), joint.rate + link.sense * speed
    r, z = link.length * sin(turned), -link.length * cos(turned)
    pull = rate * rate
    return _End(
        turned,
        rate,
        joint.r + r,
        joint.z + z,
        joint.r_rate - z * rate,
        joint.r_pull - r * pull,
        joint.z_pull - z * pull,
    )
