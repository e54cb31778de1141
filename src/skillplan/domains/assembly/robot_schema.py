"""YAML schema of the arm, and arms from URDF files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    Field,
    ModelWrapValidatorHandler,
    PrivateAttr,
    ValidationInfo,
    computed_field,
    model_validator,
)

from skillplan.domains.assembly.arm_files import ArmFileError, read_arm
from skillplan.domains.assembly.schema_types import (
    Angles,
    Length,
    Planar,
    Spatial,
    is_absent,
    is_empty,
)
from skillplan.domains.domain import Name, Strict
from skillplan.files.schema_errors import Located, continue_sentence, shown
from skillplan.robots.arm_description import ArmDescription, Hand
from skillplan.robots.catalogue import ARMS, DEFAULT_ARM, DEFAULT_HAND, DEFAULT_MODEL, STANDARD_HAND
from skillplan.task.pose import Point, Pose, Quaternion

JointAngle = Annotated[float, Field(ge=-20, le=20)]
# Links of others' files have any names.
LinkName = Annotated[str, Field(min_length=1, max_length=256)]
FolderName = Annotated[str, Field(min_length=1, max_length=4096)]


class RobotConfig(Strict):
    """The arm."""

    name: Name = Field("robot", description="the agent's name")
    model: Annotated[str, Field(min_length=1, max_length=4096)] = Field(
        DEFAULT_ARM,
        description=f"{', '.join(ARMS)}, or a URDF or xacro file in the task file's folder, or in "
        "a folder of it",
    )
    packages: Annotated[list[FolderName], Field(max_length=64)] = Field(
        default_factory=list,
        exclude_if=is_empty,
        description="of a URDF, folders of ROS packages, or folders that contain them; left out: "
        "those around the file, and those of ROS_PACKAGE_PATH and AMENT_PREFIX_PATH",
    )
    xacro_args: dict[Name, str] = Field(
        default_factory=dict,
        exclude_if=is_empty,
        description="arguments of a xacro file; left out: its defaults",
    )
    base_m: Spatial = Field([0.0, 0.0, 0.0], description="base, x y z [m]")
    base_rpy_rad: Angles = Field(
        [0.0, 0.0, 0.0],
        description="rotation of the base about the fixed axes x, y and z, in this order [rad]",
    )
    tip: LinkName | None = Field(
        None,
        description="of a URDF, the link to which the hand is fixed, its z pointing out; left out: "
        "there is none, as of an arm that is named",
    )
    home_rad: Annotated[list[JointAngle], Field(min_length=4, max_length=8)] | None = Field(
        None,
        description="posture with room for every joint, next to which others are preferred [rad], "
        "of prismatic joints [m]; left out: that of the model, of a URDF one that is found",
    )
    home_m: Planar = Field(description="place of the tip at the start, x y [m]")
    reach_m: Length | None = Field(
        None, description="greatest distance from base to tip [m]; left out: that of the model"
    )
    payload_kg: Annotated[float, Field(gt=0, le=10_000)] | None = Field(
        None,
        exclude_if=is_absent,
        description="greatest mass at the flange, hand or tool included [kg]; left out: that of "
        "the model, of a URDF unknown",
    )
    safe_height_m: Length = Field(
        0.15, description="height of the lowest carried point between two places [m]"
    )
    travel_speed_m_per_s: Annotated[float, Field(ge=1e-3, le=100)] = Field(
        0.25, description="planar speed between skills [m/s]"
    )
    look_m: Planar | None = Field(
        None,
        description="place from which the arm looks for a part after a failed grasp, x y [m]; left "
        "out: over the part",
    )

    # Factories avoid a deep copy of the default by pydantic for every file.
    _arm: ArmDescription = PrivateAttr(default_factory=lambda: DEFAULT_MODEL)
    _hand: Hand = PrivateAttr(default_factory=lambda: DEFAULT_HAND)
    _sha256: str | None = PrivateAttr(None)

    @model_validator(mode="wrap")
    @classmethod
    def _find_arm(
        cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo
    ) -> Self:
        """Find the model, or read it."""
        robot = handler(data)
        if robot.model in ARMS:
            robot._arm, robot._hand = robot._named()
            return robot
        folder = Path((info.context or {}).get("folder", Path()))
        try:
            robot._arm, robot._sha256 = read_arm(
                folder, robot.model, robot.tip, robot.home_rad, robot.packages, robot.xacro_args
            )
        except ArmFileError as error:
            words = str(error)
            if error.key == "model":
                words = f"{shown(robot.model)}: {continue_sentence(words)}"
            key = error.key if getattr(robot, error.key) is not None else "model"
            raise Located(words, key) from None
        robot._hand = STANDARD_HAND
        return robot

    def _named(self) -> tuple[ArmDescription, Hand]:
        arm, hand = ARMS[self.model]
        if self.tip is not None:
            words = f"'tip' is of a URDF's arm; {self.model} ends at its flange. Leave it out."
            raise Located(words, "tip")
        if self.home_rad is None:
            return arm, hand
        if len(self.home_rad) != len(arm.joints):
            words = f"{len(self.home_rad)} angles, where the arm has {len(arm.joints)} joints."
            raise Located(words, "home_rad")
        try:
            return replace(arm, home_rad=tuple(self.home_rad)), hand
        except ValueError as error:
            raise Located(str(error), "home_rad") from None

    @property
    def arm(self) -> ArmDescription:
        """Joints, limits, masses and shapes."""
        return self._arm

    @property
    def hand(self) -> Hand:
        """Hand on the flange."""
        return self._hand

    @property
    def reaches_m(self) -> float:
        """Greatest distance from base to tip [m]."""
        return self._arm.works_within_m if self.reach_m is None else self.reach_m

    @property
    def look(self) -> Point:
        """Place where the tip looks for a part after a failed grasp, at safe height [m]."""
        assert self.look_m is not None
        return (self.look_m[0], self.look_m[1], self.safe_height_m)

    @property
    def base_orientation(self) -> Quaternion:
        """Orientation of the base."""
        roll, pitch, yaw = self.base_rpy_rad
        origin: Point = (0.0, 0.0, 0.0)
        return Pose.turned(origin, (roll, pitch, yaw)).orientation

    @computed_field  # type: ignore[prop-decorator]
    @property
    def model_sha256(self) -> str | None:
        """Hash of a URDF and its meshes, which makes it part of the task's hash."""
        return self._sha256
