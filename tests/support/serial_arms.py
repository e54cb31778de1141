"""Arms that nobody builds, for tests of what holds for any serial arm."""

import math
from dataclasses import replace

import numpy as np

from skillplan.robots import UR5E, ArmDescription, Joint, LinkInertia, Transform

_LINK = LinkInertia(1.0, (0.0, 0.0, 0.1), (0.01, 0.01, 0.01, 0.0, 0.0, 0.0))


def random_arm(joints: int, seed: int) -> ArmDescription:
    """Return an arm whose axes point anywhere, with links of 0.1 to 0.4 m."""
    rng = np.random.default_rng(seed)

    def direction() -> tuple[float, float, float]:
        drawn = rng.normal(size=3)
        x, y, z = (drawn / np.linalg.norm(drawn)).tolist()
        return x, y, z

    def placed() -> Transform:
        x, y, z = (rng.uniform(0.1, 0.4) * np.array(direction())).tolist()
        roll, pitch, yaw = rng.uniform(-math.pi, math.pi, 3).tolist()
        return Transform((x, y, z), (roll, pitch, yaw))

    created = []
    for number in range(joints):
        middle, half = rng.uniform(-0.5, 0.5), rng.uniform(2.0, 3.0)
        created.append(
            Joint(
                f"joint_{number + 1}",
                placed(),
                float(middle - half),
                float(middle + half),
                1.0,
                1.0,
                1.0,
                _LINK,
                direction(),
            )
        )
    return ArmDescription(f"arm {seed}", tuple(created), placed(), (0.0,) * joints)


def ur_arm(name: str, lengths_m: tuple[float, float, float, float, float, float]) -> ArmDescription:
    """Return an arm of Universal Robots' family by its d1, a2, a3, d4, d5 and d6 [m]."""
    d1, a2, a3, d4, d5, d6 = lengths_m
    ends = (
        Transform.from_standard_dh(0.0, d1, math.pi / 2),
        Transform.from_standard_dh(a2, 0.0, 0.0),
        Transform.from_standard_dh(a3, 0.0, 0.0),
        Transform.from_standard_dh(0.0, d4, math.pi / 2),
        Transform.from_standard_dh(0.0, d5, -math.pi / 2),
        Transform.from_standard_dh(0.0, d6, 0.0),
    )
    places = (Transform(), *ends[:-1])
    joints = tuple(
        replace(joint, placement=place) for joint, place in zip(UR5E.joints, places, strict=True)
    )
    return replace(UR5E, name=name, joints=joints, tip=ends[-1])
