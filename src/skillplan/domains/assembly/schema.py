"""The YAML schema of an assembly task. Lengths in metres, world frame, z up, table at z = 0."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from skillplan.domains.assembly.cost_schema import CostChoice
from skillplan.domains.assembly.many_schema import Trays
from skillplan.domains.assembly.part_schema import FixtureConfig, PartConfig
from skillplan.domains.assembly.robot_schema import RobotConfig
from skillplan.domains.assembly.schema_types import (
    Angle,
    Angles,
    DurationsConfig,
    Height,
    Planar,
    PlanarOrSpatial,
    is_absent,
    is_empty,
)
from skillplan.domains.assembly.screw_schema import ScrewConfig
from skillplan.domains.assembly.tool_schema import ToolConfig, WorkConfig
from skillplan.domains.assembly.workholder_schema import HolderConfig, WorkholderConfig
from skillplan.domains.assembly.zone_schema import ZoneConfig
from skillplan.domains.domain import Name, Strict
from skillplan.errors import name_hint
from skillplan.files.schema_errors import Located
from skillplan.task.pose import Point

Reward = Annotated[float, Field(ge=-1e6, le=1e6)]
Fact = Annotated[str, Field(min_length=1, max_length=200)]
Shift = Annotated[float, Field(ge=0, le=1)]
ToolChange = Literal["swap", "separate"]


class ToolChangeConfig(Strict):
    """Style of tool changes."""

    style: ToolChange = Field(
        "swap",
        description="swap: one action offloads the attached tool and loads the next; "
        "separate: offload and load are two actions",
    )
    reload: bool = Field(
        False, description="whether loading the tool that is attached already may be tried"
    )


class FeederConfig(Strict):
    """A feeder that presents parts or screws one at a time at a fixed place."""

    position_m: Planar = Field(description="place where it presents them, x y [m]")
    height_m: Height = Field(
        0.0, description="height of the support of a part, or of the head of a screw [m]"
    )
    cycle_s: Annotated[float, Field(gt=0, le=3600)] | None = Field(
        None,
        exclude_if=is_absent,
        description="least time between the ends of two picks from it [s]; the wait counts in "
        "times, also of back ends, and 'simulate' and playbacks wait; left out: none",
    )
    capacity: Annotated[int, Field(ge=1, le=100_000)] | None = Field(
        None,
        exclude_if=is_absent,
        description="number of parts or screws before it is empty; left out: not limited",
    )

    @property
    def position(self) -> Point:
        """Place where it presents them [m]."""
        return (self.position_m[0], self.position_m[1], self.height_m)


class BufferConfig(Strict):
    """A place where parts are put down in between, one at a time."""

    at_m: PlanarOrSpatial = Field(
        description="place of the origin of a part there, x y or x y z [m]; without z it rests on "
        "stands_on, or on the table"
    )
    stands_on: Name | None = Field(
        None, description="the fixture that parts rest on; left out: the table, or what at_m says"
    )
    yaw_rad: Angle = Field(0.0, description="yaw of a part there [rad]")
    rpy_rad: Angles | None = Field(
        None,
        description="rotation of a part there about the fixed axes x, y and z in this order [rad]; "
        "instead of yaw_rad",
    )

    @model_validator(mode="after")
    def _one_turn(self) -> BufferConfig:
        if {"yaw_rad", "rpy_rad"} <= self.model_fields_set and self.rpy_rad is not None:
            raise Located("give one of 'yaw_rad' and 'rpy_rad', not both.", "rpy_rad")
        if self.stands_on is not None and len(self.at_m) == 3:
            raise Located("give x y only, as parts rest on a fixture.", "at_m")
        return self

    @property
    def turn_rad(self) -> Point:
        """Roll, pitch and yaw of a part there [rad]."""
        roll, pitch, yaw = self.rpy_rad or (0.0, 0.0, self.yaw_rad)
        return (roll, pitch, yaw)


class ChartLine(Strict):
    """A line of the hand-made precedence chart."""

    before: Name | None = Field(
        None,
        exclude_if=is_absent,
        description="the part or screw that comes first; instead of any_of",
    )
    any_of: Annotated[list[Name], Field(min_length=1, max_length=64)] | None = Field(
        None,
        exclude_if=is_absent,
        description="parts and screws of which at least one comes first; instead of before",
    )
    after: Annotated[list[Name], Field(min_length=1, max_length=512)] = Field(
        description="parts and screws that come later"
    )

    @model_validator(mode="after")
    def _one_first(self) -> ChartLine:
        if (self.before is None) == (self.any_of is None):
            raise Located("give one of 'before' and 'any_of'.")
        return self


class RewardConfig(Strict):
    """The reward scheme, after Table II of Moller et al."""

    infeasible: Reward = Field(-10.0, description="a collision or an inapplicable skill")
    complete: Reward = Field(10.0, description="the step that completes the assembly")
    per_cost: Reward = Field(-0.1, description="factor on the cost of any other step [1/m; 1/s]")
    out_of_time: Reward = Field(-10.0, description="the step that exhausts the step limit")
    repeated_tool_change: Reward | None = Field(
        None,
        description="a tool change right after another, instead of the cost term; left out: no "
        "other than the cost",
    )


class FamilyConfig(Strict):
    """A family of layouts: ranges of random shifts."""

    start_shift_m: Shift = Field(
        0.0,
        description="the most that a start, of each part by itself, is moved in x and in y [m]; "
        "what lies on it moves along, feeders stay",
    )
    gap_m: Shift = Field(
        0.0,
        description="least distance along x or y of a part at its start from starts and goals of "
        "others [m]; pairs that are closer in the file come no closer",
    )
    goal_shift_m: Shift = Field(
        0.0, description="the most that all goals and holes together are moved in x and in y [m]"
    )

    @model_validator(mode="after")
    def _something_moves(self) -> FamilyConfig:
        if not self.start_shift_m and not self.goal_shift_m:
            raise Located("give 'start_shift_m' or 'goal_shift_m' above 0.")
        return self


class CostExpectation(Strict):
    """A sequence and its cost."""

    actions: Annotated[list[int], Field(min_length=1)] = Field(
        description="numbers of the actions, from 0"
    )
    cost: float = Field(ge=0, description="total cost in the task's unit")


class ExpectConfig(Strict):
    """Figures that the project's tests verify; no command reads them."""

    optimal_cost: float | None = Field(None, ge=0, description="cost of the optimum [m; s]")
    optimal_expected_cost: float | None = Field(
        None, ge=0, description="expected cost of the optimum, where grasps may fail [m; s]"
    )
    optimal_actions: list[int] | None = Field(
        None, description="the actions of the optimum, by number from 0"
    )
    states: int | None = Field(None, ge=1, description="number of reachable states")
    observations: int | None = Field(None, ge=1, description="number of observations of a learner")
    sequences: dict[str, int] | None = Field(
        None, description="number of feasible sequences by their number of skills"
    )
    costs: list[CostExpectation] | None = Field(None, description="sequences with their costs")
    tool_changes: int | None = Field(
        None, ge=0, description="number of tool changes of the optimum"
    )


class AssemblyConfig(Strict):
    """An assembly task."""

    kind: Literal["assembly"] = Field(description="the kind of task file")
    name: Name = Field(description="the task's name")
    description: str = Field("", description="for people")
    robot: RobotConfig = Field(description="the arm")
    cost: CostChoice = Field(
        "distance",
        description="objective: distance, the planar path of the tip [m]; time, the cycle "
        "time [s]: 'durations_s', and travels by the trajectories of a back end, or else by "
        "'travel_speed_m_per_s'; a list such as [holds, turns, time], the fewest of the first, "
        "then of the next; or weights of a sum of both with wear and energy",
    )
    durations_s: DurationsConfig = Field(
        default_factory=DurationsConfig,
        description="dwell times: the hand stays so long at a target to act, travel not counted "
        "[s]; 'durations_s' of a part or screw comes first, then that of its tool",
    )
    tools: Annotated[dict[Name, ToolConfig], Field(min_length=1, max_length=32)] = Field(
        description="tools of the changer by name"
    )
    initial_tool: Name | None = Field(
        None, description="the tool attached at the start; left out: none"
    )
    tool_change: ToolChangeConfig = Field(
        default_factory=ToolChangeConfig, description="style of tool changes"
    )
    feeders: Annotated[dict[Name, FeederConfig], Field(max_length=64)] = Field(
        {}, description="feeders by name; left out: none"
    )
    fixtures: Annotated[dict[Name, FixtureConfig], Field(max_length=128)] = Field(
        {},
        exclude_if=is_empty,
        description="bodies that stay where they are, by name, which nothing may run into, and on "
        "which parts may lie; left out: none",
    )
    zones: Annotated[dict[Name, ZoneConfig], Field(max_length=64)] = Field(
        {},
        exclude_if=is_empty,
        description="zones by name that arm or load stay out of, or in which the arm is slow near "
        "people; left out: none",
    )
    buffers: Annotated[dict[Name, BufferConfig], Field(max_length=32)] = Field(
        {},
        exclude_if=is_empty,
        description="places to put parts down in between, by name, for parts that name them in "
        "'buffers'; left out: none",
    )
    trays: Trays = Field(
        {},
        exclude_if=is_empty,
        description="trays and racks by name, in whose pockets parts lie at the start; "
        "each is a fixture with plates beneath its pockets; left out: none",
    )
    parts: Annotated[dict[Name, PartConfig], Field(min_length=1, max_length=256)] = Field(
        description="parts by name"
    )
    screws: Annotated[dict[Name, ScrewConfig], Field(max_length=256)] = Field(
        {}, description="screws by name; left out: none"
    )
    works: Annotated[dict[Name, WorkConfig], Field(max_length=64)] = Field(
        {},
        exclude_if=is_empty,
        description="works of presses and dispensers on parts, by name; left out: none",
    )
    workholders: Annotated[dict[Name, WorkholderConfig], Field(max_length=8)] = Field(
        {},
        exclude_if=is_empty,
        description="stations by name that carry the product and turn it; left out: none",
    )
    holders: Annotated[dict[Name, HolderConfig], Field(max_length=256)] = Field(
        {},
        exclude_if=is_empty,
        description="clamps and passive holders by name, which keep parts in place; left out: none",
    )
    goal: Annotated[list[Fact], Field(min_length=1, max_length=4096)] | None = Field(
        None,
        description="facts to bring about; left out: every part placed, every screw fastened, "
        "every work done",
    )
    product_parts: Annotated[int, Field(ge=1, le=100_000)] | None = Field(
        None,
        exclude_if=is_absent,
        description="number of parts of the whole product, of which this task may put together "
        "some; left out: not stated",
    )
    chart: Annotated[list[ChartLine], Field(max_length=4096)] = Field(
        [],
        description="the hand-made precedence relation, as [{before: a, after: [b, c]}] or "
        "[{any_of: [a, b], after: [c]}]; left out: none",
    )
    actions: Annotated[list[Fact], Field(min_length=1, max_length=1024)] | None = Field(
        None, description="the actions in the order of their numbers; left out: all, in file order"
    )
    observation: Annotated[list[Fact], Field(min_length=1, max_length=4096)] | None = Field(
        None, description="the bits a learner sees: facts, or 'not FACT'; left out: all facts"
    )
    reward: RewardConfig | None = Field(
        None, description="the reward scheme; left out: less cost is more reward"
    )
    step_limit: Annotated[int, Field(ge=1, le=100_000)] | None = Field(
        None,
        description="the most skills a sequence may have [-]; left out: enough for every order, "
        "with a tool change before each part and screw",
    )
    physics: Annotated[dict[Name, dict[str, Any] | None], Field(max_length=1)] = Field(
        {}, description="the physics engine and its options, as {kinematic: {}}; left out: that"
    )
    collision: Annotated[dict[Name, dict[str, Any] | None], Field(max_length=16)] = Field(
        {},
        description="collision detectors and options, as {aabb: {}}; left out: swept if it is "
        "installed, or else aabb. A chart is checked in addition; {precedence: {}} checks it alone",
    )
    family: FamilyConfig | None = Field(
        None,
        description="layouts like this one, to learn on some and be tested on others; left out: "
        "there is none",
    )
    expect: ExpectConfig | None = Field(
        None, description="figures that tests verify; left out: none"
    )

    @model_validator(mode="after")
    def _join_members(self) -> AssemblyConfig:
        if any(part.made_of for part in self.parts.values()):
            from skillplan.domains.assembly.subassembly import join_members

            join_members(self)
        return self

    @property
    def component_count(self) -> int:
        """Number of parts and screws; sub-assemblies are none, as their members count."""
        return sum(part.made_of is None for part in self.parts.values()) + len(self.screws)

    @property
    def joined_in(self) -> dict[str, str]:
        """The sub-assembly that each of its parts and screws becomes part of, by name."""
        return {member: name for name, part in self.parts.items() for member in part.made_of or ()}

    @model_validator(mode="after")
    def _share_holders(self) -> AssemblyConfig:
        for name, tool in self.tools.items():
            if tool.mounted_on is None:
                continue
            carrier = self.tools.get(tool.mounted_on)
            here = ("tools", name, "mounted_on")
            if carrier is None or carrier is tool:
                others = [other for other in self.tools if other != name]
                hint = name_hint(tool.mounted_on, others)
                raise Located(f"unknown tool {tool.mounted_on!r}. {hint}", *here)
            if carrier.mounted_on is not None:
                words = f"{tool.mounted_on!r} is on {carrier.mounted_on!r} itself. Name that."
                raise Located(words, *here)
            for key in ("holder_m", "holder_height_m"):
                # Assigning to a frozen model fails.
                object.__setattr__(tool, key, getattr(carrier, key))
        return self

    @property
    def carriers(self) -> dict[str, ToolConfig]:
        """The tools that are on the flange themselves, by name."""
        return {name: tool for name, tool in self.tools.items() if tool.mounted_on is None}

    def find_carrier(self, tool: str) -> str:
        """Return the name of the tool on the flange that a tool comes with: often itself."""
        return self.tools[tool].mounted_on or tool

    @property
    def moved_parts(self) -> dict[str, PartConfig]:
        """The parts that hands move, by name."""
        return {name: part for name, part in self.parts.items() if not part.fixed}


def choose_variant(
    config: AssemblyConfig, name: str, label: str = "", tool: str = ""
) -> AssemblyConfig:
    """Return the task with one of the goals and tools of a part or screw as its only ones.

    Parameters
    ----------
    label
        Suffix of the skill: ``@2`` for the second goal; without a number, the part's own goal.
    tool
        One of its tools; empty for the first.
    """
    part = config.parts.get(name)
    owner = config.screws[name] if part is None else part
    changes: dict[str, Any] = {}
    number = label.partition(":")[0].removeprefix("@")
    if part is not None and number.isdigit():
        goal = (part.other_goals or [])[int(number) - 2]
        changes |= {key: getattr(goal, key) for key in type(goal).model_fields}
    if tool and tool != owner.tool:
        changes["tool"] = tool
    if not changes:
        return config
    section = "screws" if part is None else "parts"
    entries = {**getattr(config, section), name: owner.model_copy(update=changes)}
    return config.model_copy(update={section: entries})
