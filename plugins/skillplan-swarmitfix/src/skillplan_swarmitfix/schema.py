"""The YAML schema of a bench task. Lengths in metres, in the frame of the bench."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from skillplan.domains.domain import Name, Strict
from skillplan.files.schema_errors import Located
from skillplan_swarmitfix.trajectory.schema import TrajectoryConfig

Length = Annotated[float, Field(gt=0, le=1000)]
Duration = Annotated[float, Field(ge=0, le=86_400)]
Swing = Annotated[float, Field(gt=0, le=86_400)]
Position = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
Reachable = Literal["required", "preferred", "ignored"]
# Range of the machine's own plans [m].
PLANNED_REACH_M = [0.333, 0.451]
GoalRule = Literal["whole-trajectory", "fewest-steps", "nearest-centroid"]
# A state holds a bit for each position; larger benches are for the compiled kernels alone.
MOST_ROBOTS = 8
MAX_POSITIONS = 10_000


class BenchConfig(Strict):
    """The triangular lattice of pins."""

    rows: int = Field(6, ge=1, le=1_000, description="rows of triangles [-]")
    cols: int = Field(
        13,
        ge=1,
        le=2_001,
        description="triangles in a row, odd, so that rows begin and end alike [-]",
    )
    pitch_m: Length = Field(0.34, description="distance of neighbouring pins [m]")
    actions: Literal[11, 13] = Field(
        11, description="11 for B0 to B10, 13 to include B11 and B12 [-]"
    )

    @model_validator(mode="after")
    def _odd_columns(self) -> BenchConfig:
        if self.cols % 2 == 0:
            message = (
                f"must be odd, not {self.cols}: with an even number of columns, odd positions "
                "would not be the upward triangles of every row."
            )
            raise Located(message, "cols")
        if self.rows * self.cols > MAX_POSITIONS:
            message = (
                f"{self.rows} x {self.cols} positions are more than the {MAX_POSITIONS:,} of the "
                "largest bench."
            )
            raise Located(message, "rows")
        return self


class HeadsConfig(Strict):
    """The triangular heads that support the sheet along the trajectory."""

    side_m: Length = Field(0.10, description="side of the equilateral head [m]")
    max_gap_m: Length = Field(0.20, description="longest stretch of the trajectory left bare [m]")
    step_m: Length = Field(0.02, description="grid on which heads may be placed [m]")
    orientations: int = Field(
        2, ge=1, le=12, description="headings tried for a head, over a third of a turn [-]"
    )
    reorientation_cost: Annotated[float, Field(ge=0, lt=1)] = Field(
        0.1, description="weight of turning the head, in supports [-]"
    )
    subdivisions: (
        Annotated[
            list[Annotated[int, Field(ge=1, le=1_000)]], Field(min_length=1, max_length=10_000)
        ]
        | None
    ) = Field(
        None,
        description="equal parts of every segment; instead of planning the heads between vertices",
    )

    @model_validator(mode="after")
    def _planned_or_given(self) -> HeadsConfig:
        rules = {"max_gap_m", "step_m", "orientations", "reorientation_cost"}
        both = sorted(rules & self.model_fields_set)
        if self.subdivisions is not None and both:
            message = f"heads so given leave nothing to plan by {', '.join(both)}. Give only one."
            raise Located(message, "subdivisions")
        return self


class BaseConfig(Strict):
    """Start of the base and its positions for holding a head."""

    home: Position = Field("C66", description="position at the start, such as C66")
    goals: Annotated[list[Position], Field(min_length=1, max_length=1_000)] | None = Field(
        None, description="goal positions in order; instead of a trajectory"
    )
    arm_length_m: Length = Field(0.472, description="l_arm of Eqs 1 and 2 [m]")
    safe_distance_m: Annotated[float, Field(ge=0, le=1000)] = Field(
        0.286, description="s_d of Eq 4, least distance of base and support [m]"
    )
    reach_m: Annotated[list[Length], Field(min_length=2, max_length=2)] | None = Field(
        None,
        description="least and greatest horizontal distance of base and head that the arm "
        "allows [m]; left out: the limits of the legs, or 0.333 to 0.451 unless reach is required",
    )
    side: Literal["inward", "outward", "left", "right"] | None = Field(
        None,
        description="side of the trajectory on which bases stand; left out: inward, or left of "
        "an open one",
    )
    reachable: Reachable = Field(
        "required",
        description="whether the legs of the PKM must reach every support from the position that "
        "holds it: required; preferred, where Eqs 1-4 leave such a position; ignored, as in the "
        "paper",
    )
    relax: Literal["needed", "always"] = Field(
        "needed",
        description="which supports may drop Eq 3 and the side if reachable is required: needed, "
        "those without a position otherwise; always, all",
    )
    prefer_reachable: bool | None = Field(
        None,
        description="former name of reachable: true is preferred, false is ignored; left out: "
        "reachable counts",
        deprecated=True,
    )
    goal_choice: GoalRule = Field(
        "whole-trajectory",
        description="choice among the positions that can hold a support: the fewest steps "
        "over the whole trajectory, a greedy choice for the next support, or the nearest position",
    )

    @property
    def reach_rule(self) -> Reachable:
        """Return whether reach is required, by either name of the key."""
        former = self.__dict__["prefer_reachable"]
        if former is None:
            return self.reachable
        return "preferred" if former else "ignored"

    @model_validator(mode="after")
    def _named_once(self) -> BaseConfig:
        if "reachable" in self.model_fields_set and self.__dict__["prefer_reachable"] is not None:
            message = "is the former name of reachable, which is given as well. Keep reachable."
            raise Located(message, "prefer_reachable")
        return self

    @model_validator(mode="after")
    def _reach_in_order(self) -> BaseConfig:
        if self.reach_m is not None and self.reach_m[0] >= self.reach_m[1]:
            least_m, most_m = self.reach_m
            message = f"must give the least reach first: {least_m:g} is not below {most_m:g}."
            raise Located(message, "reach_m")
        if self.safe_distance_m >= self.arm_length_m:
            message = (
                f"must be below arm_length_m, which is {self.arm_length_m:g}, not "
                f"{self.safe_distance_m:g}."
            )
            raise Located(message, "safe_distance_m")
        return self


LegLimits = Annotated[list[Annotated[float, Field(gt=0, le=2)]], Field(min_length=2, max_length=2)]


class LegLimitsConfig(Strict):
    """Shortest and longest leg of the parallel kinematic machine."""

    A: LegLimits | None = Field(
        None, description="shortest and longest leg A [m]; left out: the calibrated ones"
    )
    B: LegLimits | None = Field(
        None, description="shortest and longest leg B [m]; left out: the calibrated ones"
    )
    C: LegLimits | None = Field(
        None, description="shortest and longest leg C [m]; left out: the calibrated ones"
    )

    @model_validator(mode="after")
    def _in_order(self) -> LegLimitsConfig:
        for leg in "ABC":
            limits = getattr(self, leg)
            if limits is not None and limits[0] >= limits[1]:
                least_m, most_m = limits
                message = f"must give the shortest first: {least_m:g} is not below {most_m:g}."
                raise Located(message, leg)
        return self


class PkmConfig(Strict):
    """The parallel kinematic machine between base and head."""

    leg_limits_m: LegLimitsConfig = Field(
        default_factory=LegLimitsConfig, description="shortest and longest of legs A, B, C [m]"
    )
    sheet_height_m: Length | None = Field(
        None, description="height of the sheet above the bench [m]; left out: the calibrated one"
    )


class TimingsConfig(Strict):
    """Durations of the five steps."""

    swing_s: dict[Literal["60", "120", "180", "240", "300"], Swing] | None = Field(
        None,
        description="time of a swing by its angle in degrees [s]; left out: the real machine's",
    )
    retract_s: Duration | None = Field(
        None, description="head off the sheet [s]; left out: the real machine's"
    )
    park_s: Duration | None = Field(
        None, description="head to its parking position [s]; left out: the real machine's"
    )
    approach_s: Duration | None = Field(
        None, description="head below the next support [s]; left out: the real machine's"
    )
    support_s: Duration | None = Field(
        None, description="head onto the sheet [s]; left out: the real machine's"
    )


class BaseRobotConfig(Strict):
    """One of several bases on the bench."""

    home: Position = Field(description="position at the start, such as C66")
    goal: Position = Field(description="position at the end")


class BenchExpectConfig(Strict):
    """Figures that the project's tests verify; no command reads them."""

    goals: list[str] | None = Field(None, description="positions of the base, in order")
    makespans: list[int] | None = Field(None, description="swings to each of them")
    supports: int | None = Field(None, description="how many heads there are")
    steps: int | None = Field(None, description="how many swings there are in all")
    relaxed: int | None = Field(None, description="supports that need the relaxed rule")
    split: int | None = Field(None, description="supports that need a split stretch")
    csp: Literal["solved", "unsolved"] | None = Field(None, description="result of the solver csp")
    swings: int | None = Field(None, description="swings of a fleet's plan")
    parallel_makespan: int | None = Field(
        None, description="steps of a fleet's plan where bases move at once"
    )


class SwarmitfixConfig(Strict):
    """A walking fixture that supports sheet metal along a tool's trajectory."""

    kind: Literal["swarmitfix"] = Field(description="the kind of task file")
    name: Name = Field(description="the task's name")
    description: str = Field("", description="for people")
    bench: BenchConfig = Field(
        default_factory=BenchConfig, description="the triangular lattice of pins"
    )
    trajectory: TrajectoryConfig | None = Field(
        None, description="the path of the tool; left out: base.goals or robots is given"
    )
    heads: HeadsConfig = Field(
        default_factory=HeadsConfig, description="the heads that support the sheet"
    )
    base: BaseConfig = Field(
        default_factory=BaseConfig, description="start and permitted positions of the base"
    )
    pkm: PkmConfig = Field(
        default_factory=PkmConfig, description="the machine between base and head"
    )
    timings: TimingsConfig = Field(
        default_factory=TimingsConfig, description="how long the five steps take [s]"
    )
    robots: (
        Annotated[dict[Name, BaseRobotConfig], Field(min_length=2, max_length=MOST_ROBOTS)] | None
    ) = Field(None, description="several bases on one bench; instead of a trajectory")
    step_limit: Annotated[int, Field(ge=1, le=100_000)] | None = Field(
        None, description="the most skills of a sequence; left out: enough for every pair"
    )
    physics: Annotated[dict[Name, dict[str, Any] | None], Field(max_length=1)] = Field(
        {}, description="the physics engine and its options, as {kinematic: {}}; left out: that"
    )
    collision: Annotated[dict[Name, dict[str, Any] | None], Field(max_length=16)] = Field(
        {}, description="collision detectors and options; left out: none"
    )
    expect: BenchExpectConfig | None = Field(
        None, description="figures that tests verify; left out: none"
    )

    @model_serializer(mode="wrap")
    def _content(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the content in the form of older versions, as far as the meaning is the same.

        Hashes are of this content: older results of such files stay verifiable.
        """
        content: dict[str, Any] = handler(self)
        base = content["base"]
        del base["prefer_reachable"], base["reachable"], base["relax"]
        rule = "preferred" if self.trajectory is None else self.base.reach_rule
        if rule == "required":
            base["reachable"], base["relax"] = rule, self.base.relax
        else:
            base["reach_m"] = base["reach_m"] or PLANNED_REACH_M
            base["prefer_reachable"] = rule == "preferred"
        return content

    @model_validator(mode="after")
    def _one_job(self) -> SwarmitfixConfig:
        jobs = {"trajectory": self.trajectory, "base.goals": self.base.goals, "robots": self.robots}
        given = [key for key, job in jobs.items() if job is not None]
        if not given:
            raise ValueError("has no job: give a trajectory, base.goals, or robots.")
        if len(given) > 1:
            message = f"{' and '.join(given)} are {len(given)} jobs. Keep one of them."
            raise Located(message, *given[-1].split("."))
        return self
