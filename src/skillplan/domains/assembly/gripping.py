"""How parts are held: what the tools do, the grasps of every part, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from skillplan.domains.assembly.holding import Handle, automatic, direction_name, named, side_name
from skillplan.domains.assembly.layout import boxes_of, goal_pose, shapes_of, start_pose
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import GraspConfig
from skillplan.errors import Issue
from skillplan.physics.linear_motions import jaws_about
from skillplan.task.motion import Grasp, GraspKind
from skillplan.task.pose import Pose, dot, plus
from skillplan.task.scene import ToolKind

# What is left of the opening of the jaws on both sides of a part that fits between them [m].
_PLAY_M = 0.002
# Jaws that meet a part off their middle by more than this push it aside [m].
_OFF_MIDDLE_M = 5e-4
# A hand reaches back from its tip by more than this [m].
_HAND_M = 0.06
# A hand that points up less steeply than this may still be above the table.
_UPWARDS = 0.3


@dataclass(frozen=True, slots=True)
class _Choice:
    """One grasp of a part, and where the file says it."""

    part: PartConfig
    handle: Handle
    path: tuple[str | int, ...]
    tool: str
    opening_m: float | None

    @property
    def given(self) -> GraspConfig:
        return self.handle.given


def tool_kind(config: AssemblyConfig, tool: str) -> ToolKind:
    """Return what a tool does: as its entry says, or else by what it is used for."""
    given = config.tools[tool].type
    if given is not None:
        return ToolKind(given)
    drives = any(screw.tool == tool for screw in config.screws.values())
    holds = any(part.tool == tool for part in config.parts.values())
    return ToolKind.SCREWDRIVER if drives and not holds else ToolKind.GRIPPER


def grasps_of_part(config: AssemblyConfig, name: str) -> tuple[Grasp, ...]:
    """Return how a part without faults of its grasps may be held, the preferred first.

    Of those that ``auto`` tries, the ones that a hand can take.
    """
    part = config.parts[name]
    choices = _choices(config, part)
    if part.grasp == "auto":
        poses = _poses(config, name)
        choices = [one for one in choices if not any(_faults(one, poses))] or choices[:1]
    return named([choice.handle.grasp() for choice in choices])


def grasp_of_part(config: AssemblyConfig, name: str) -> Grasp:
    """Return how a part without faults of its grasps is held before any other way."""
    return grasps_of_part(config, name)[0]


def grasp_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield what is wrong with tools and grasps of parts whose tools are known."""
    for name, tool in config.tools.items():
        if tool.opening_m is not None and tool_kind(config, name) is not ToolKind.GRIPPER:
            kind = tool_kind(config, name)
            message = f"a tool of type {kind} has no jaws. Leave it out, or give type: gripper."
            yield Issue(message, ("tools", name, "opening_m"))
    for name, part in config.parts.items():
        if tool_kind(config, part.tool) is ToolKind.SCREWDRIVER:
            message = f"{part.tool!r} is a screwdriver, which holds no part. Name another."
            yield Issue(message, ("parts", name, "tool"))
            continue
        for issue in _part_issues(config, name):
            yield issue.under("parts", name)


def _choices(config: AssemblyConfig, part: PartConfig) -> list[_Choice]:
    """Return the grasps that a part is given, all that are tried for ``auto``."""
    given = automatic() if part.grasp == "auto" else part.grasp
    several = isinstance(given, list)
    listed = given if isinstance(given, list) else [given]
    by_suction = tool_kind(config, part.tool) is ToolKind.SUCTION
    own = GraspKind.SUCTION if by_suction else GraspKind.JAWS
    shapes = shapes_of(part)
    return [
        _Choice(
            part,
            Handle(one, own if one.type is None else GraspKind(one.type), shapes),
            ("grasp", index) if several and part.grasp != "auto" else ("grasp",),
            part.tool,
            config.tools[part.tool].opening_m,
        )
        for index, one in enumerate(listed)
    ]


def _poses(config: AssemblyConfig, name: str) -> Mapping[str, Pose]:
    return {"at the start": start_pose(config, name), "at its goal": goal_pose(config, name)}


def _part_issues(config: AssemblyConfig, name: str) -> Iterator[Issue]:
    part = config.parts[name]
    choices, poses = _choices(config, part), _poses(config, name)
    if part.grasp == "auto":
        if all(any(_faults(choice, poses)) for choice in choices):
            top = next(_faults(choices[0], poses)).message
            message = f"no hand can hold it from any of its six sides; from the top: {top}"
            yield Issue(message, ("grasp",))
        return
    cup = tool_kind(config, part.tool) is ToolKind.SUCTION
    seen: dict[Grasp, int] = {}
    for index, choice in enumerate(choices):
        if cup and choice.given.type == "jaws":
            message = f"{part.tool!r} is of type suction and has no jaws. Leave it out."
            yield Issue(message, (*choice.path, "type"))
            continue
        found = list(_faults(choice, poses))
        yield from found
        if not found:
            earlier = seen.setdefault(choice.handle.grasp(), index)
            if earlier != index:
                message = f"is the same as entry {earlier}. Leave one out."
                yield Issue(message, choice.path)


def _faults(choice: _Choice, poses: Mapping[str, Pose]) -> Iterator[Issue]:
    """Yield why no hand holds a part in one way."""
    handle, given = choice.handle, choice.given
    if handle.closes_askew:
        message = (
            f"is not at right angles to the direction in which the hand points, "
            f"{direction_name(handle.approach)}. Give another axis."
        )
        yield Issue(message, (*choice.path, "closing_axis"))
        return
    level = abs(handle.approach[2]) < 1 - 1e-9
    if level and given.at_m is not None and len(given.at_m) == 2:
        message = "give x y z of a point on the hand's axis: it does not come from the part's top."
        yield Issue(message, (*choice.path, "at_m"))
        return
    if handle.kind is GraspKind.SUCTION:
        found = list(_suction_faults(choice))
    else:
        found = list(_jaws_faults(choice))
    yield from found or _under_the_table(choice, poses)


def _suction_faults(choice: _Choice) -> Iterator[Issue]:
    given, handle = choice.given, choice.handle
    of_jaws = {
        # From another side than the top it says how the hand is turned.
        "closing_axis": handle.from_top and given.closing_axis != "auto",
        "depth_m": given.depth_m is not None,
    }
    if choice.part.grasp != "auto":
        for key in (key for key, own in of_jaws.items() if own):
            message = (
                "says how jaws hold it, and suction has none. Leave it out, or give type: jaws."
            )
            yield Issue(message, (*choice.path, key))
    through = handle.cup_axis()
    if handle.lands_m(through) is None:
        yield _nothing_at(choice, through, "the suction cup")


def _jaws_faults(choice: _Choice) -> Iterator[Issue]:
    given, handle, opening_m = choice.given, choice.handle, choice.opening_m
    if given.depth_m is not None and given.depth_m >= handle.height_m:
        message = (
            f"{given.depth_m:.4f} m below the top of a part {handle.height_m:.4f} m high; the "
            "fingers must end above its bottom."
        )
        yield Issue(message, (*choice.path, "depth_m"))
        return
    if opening_m is None and not given.model_fields_set - {"type"}:
        # Neither the jaws nor the grasp are modelled.
        return
    grasp = handle.jaws()
    if not handle.between_fingers(grasp):
        yield _nothing_at(choice, grasp.tip, "the jaws")
    else:
        yield from _off_the_middle(choice, grasp)
    if opening_m is not None and grasp.width_m > opening_m - _PLAY_M + 1e-9:
        yield _too_wide(choice, grasp, opening_m)


def _off_the_middle(choice: _Choice, grasp: Grasp) -> Iterator[Issue]:
    """Yield that the jaws would push a part aside before they hold it."""
    at_m = dot(grasp.tip, grasp.closing)
    middle_m = dot(choice.handle.jaws(centred=True).tip, grasp.closing)
    if abs(at_m - middle_m) > _OFF_MIDDLE_M:
        axis = grasp.closing_axis
        message = (
            f"the jaws close about {axis or direction_name(grasp.closing)} = {middle_m:.4f} m, not "
            f"{at_m:.4f} m, where they would push the part aside."
        )
        place = () if axis is None else ("xyz".index(axis),)
        yield Issue(message, (*choice.path, "at_m", *place))


def _too_wide(choice: _Choice, grasp: Grasp, opening_m: float) -> Issue:
    given, part = choice.given, choice.part
    fits = False
    other = "yx"["xy".index(grasp.closing_axis)] if grasp.closing_axis in ("x", "y") else ""
    if choice.handle.from_top and other:
        width_m = jaws_about(boxes_of(part), other, given.depth_m).width_m
        fits = width_m <= opening_m - _PLAY_M + 1e-9
    play = "" if grasp.width_m > opening_m else f", of which {_PLAY_M:.3f} m are play"
    message = (
        f"{grasp.width_m:.3f} m wide where the jaws of {choice.tool!r} open {opening_m:.3f} m"
        f"{play}; give grasp: {f'{{closing_axis: {other}}} or ' if fits else ''}"
        "{type: suction}."
    )
    own = bool(given.model_fields_set & {"approach", "closing_axis", "depth_m"})
    return Issue(message, choice.path if own or len(choice.path) > 1 else (part.shape_key,))


def _under_the_table(choice: _Choice, poses: Mapping[str, Pose]) -> Iterator[Issue]:
    """Yield that a hand would have to be in the table, at the start or at the goal."""
    grasp = choice.handle.grasp()
    for where, pose in poses.items():
        points = pose.rotate(grasp.approach)
        behind = plus(pose.apply(grasp.tip), points, -_HAND_M)
        if points[2] > _UPWARDS and behind[2] < 0:
            side = side_name(grasp.approach)
            side = f"the {side}" if side in ("top", "bottom") else f"its {side} side"
            message = (
                f"no hand can hold it from {side} {where}, where the hand would be in the table. "
                "Give another approach."
            )
            named_by = [key for key in ("approach",) if key in choice.given.model_fields_set]
            yield Issue(message, (*choice.path, *named_by))
            return


def _nothing_at(choice: _Choice, point: tuple[float, float, float], hand: str) -> Issue:
    numbers = point[:2] if choice.handle.from_top else point
    place = ", ".join(f"{value:.4f}" for value in numbers)
    message = f"nothing of the part is under {hand} at [{place}]; "
    if choice.given.at_m is not None:
        return Issue(f"{message}move it onto the part.", (*choice.path, "at_m"))
    wanted = "x, y" if choice.handle.from_top else "x, y, z"
    path = choice.path if len(choice.path) > 1 else (choice.part.shape_key,)
    return Issue(f"{message}give grasp: {{at_m: [{wanted}]}}.", path)
