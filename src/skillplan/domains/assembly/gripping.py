"""How parts are held: what the tools do, the grasp of every part, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.domains.assembly.layout import boxes_of, height_of, shapes_of
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.errors import Issue
from skillplan.physics.linear_motions import jaws_about
from skillplan.robots.panda import FINGER_PROFILE_M
from skillplan.task.grasp import AXES, Grasp, GraspKind
from skillplan.task.scene import ToolKind

# What is left of the opening of the jaws on both sides of a part that fits between them [m].
_PLAY_M = 0.002
# Jaws that meet a part off their middle by more than this push it aside [m].
_OFF_MIDDLE_M = 5e-4
_FINGER_HALF_WIDTH_M = FINGER_PROFILE_M[0][1]


def tool_kind(config: AssemblyConfig, tool: str) -> ToolKind:
    """Return what a tool does: as its entry says, or else by what it is used for."""
    given = config.tools[tool].type
    if given is not None:
        return ToolKind(given)
    drives = any(screw.tool == tool for screw in config.screws.values())
    holds = any(part.tool == tool for part in config.parts.values())
    return ToolKind.SCREWDRIVER if drives and not holds else ToolKind.GRIPPER


def grasp_of_part(config: AssemblyConfig, name: str) -> Grasp:
    """Return how a part without faults of its grasp is held."""
    part = config.parts[name]
    grasp = part.grasp
    at_m = None if grasp.at_m is None else (grasp.at_m[0], grasp.at_m[1])
    if _kind(config, part) is GraspKind.SUCTION:
        x_m, y_m = at_m or (0.0, 0.0)
        top_m = _top_under(part, x_m, y_m)
        top_m = height_of(part) if top_m is None else top_m
        # The closed hand is turned such that the wrist has most room.
        return Grasp(GraspKind.SUCTION, (x_m, y_m, top_m), AXES["y"])
    axis = None if grasp.closing_axis == "auto" else grasp.closing_axis
    return jaws_about(boxes_of(part), axis, grasp.depth_m, at_m)


def grasp_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield what is wrong with tools and grasps of parts whose tools are known."""
    for name, tool in config.tools.items():
        if tool.opening_m is not None and tool_kind(config, name) is not ToolKind.GRIPPER:
            kind = tool_kind(config, name)
            message = f"a tool of type {kind} has no jaws. Leave it out, or give type: gripper."
            yield Issue(message, ("tools", name, "opening_m"))
    for name, part in config.parts.items():
        for issue in _part_issues(config, part):
            yield issue.under("parts", name)


def _part_issues(config: AssemblyConfig, part: PartConfig) -> Iterator[Issue]:
    kind = tool_kind(config, part.tool)
    if kind is ToolKind.SCREWDRIVER:
        message = f"{part.tool!r} is a screwdriver, which holds no part. Name another."
        yield Issue(message, ("tool",))
    elif kind is ToolKind.SUCTION and part.grasp.type == "jaws":
        message = f"{part.tool!r} is of type suction and has no jaws. Leave it out."
        yield Issue(message, ("grasp", "type"))
    elif _kind(config, part) is GraspKind.SUCTION:
        yield from _suction_issues(part)
    else:
        yield from _jaws_issues(config, part)


def _suction_issues(part: PartConfig) -> Iterator[Issue]:
    grasp = part.grasp
    of_jaws = {"closing_axis": grasp.closing_axis != "auto", "depth_m": grasp.depth_m is not None}
    for key in (key for key, given in of_jaws.items() if given):
        message = "says how jaws hold it, and suction has none. Leave it out, or give type: jaws."
        yield Issue(message, ("grasp", key))
    x_m, y_m = grasp.at_m or (0.0, 0.0)
    if _top_under(part, x_m, y_m) is None:
        yield _nothing_at(part, x_m, y_m, "the suction cup")


def _jaws_issues(config: AssemblyConfig, part: PartConfig) -> Iterator[Issue]:
    given, height_m = part.grasp, height_of(part)
    if given.depth_m is not None and given.depth_m >= height_m:
        message = (
            f"{given.depth_m:.4f} m below the top of a part {height_m:.4f} m high; the fingers "
            "must end above its bottom."
        )
        yield Issue(message, ("grasp", "depth_m"))
        return
    grasp = _jaws(part, given.closing_axis)
    opening_m = config.tools[part.tool].opening_m
    if opening_m is None and given.model_fields_set.isdisjoint({"at_m", "closing_axis", "depth_m"}):
        # Neither the jaws nor the grasp are modelled.
        return
    axis = "xy".index(grasp.closing_axis or "x")
    middle_m = _jaws(part, "xy"[axis], centred=True).tip[axis]
    if not _between_fingers(part, grasp):
        yield _nothing_at(part, grasp.tip[0], grasp.tip[1], "the jaws")
    elif abs(grasp.tip[axis] - middle_m) > _OFF_MIDDLE_M:
        message = (
            f"the jaws close about {grasp.closing_axis} = {middle_m:.4f} m, not "
            f"{grasp.tip[axis]:.4f} m, where they would push the part aside."
        )
        yield Issue(message, ("grasp", "at_m", axis))
    if opening_m is not None and grasp.width_m > opening_m - _PLAY_M + 1e-9:
        other = "yx"[axis]
        fits = _jaws(part, other).width_m <= opening_m - _PLAY_M + 1e-9
        play = "" if grasp.width_m > opening_m else f", of which {_PLAY_M:.3f} m are play"
        message = (
            f"{grasp.width_m:.3f} m wide where the jaws of {part.tool!r} open {opening_m:.3f} m"
            f"{play}; give grasp: {f'{{closing_axis: {other}}} or ' if fits else ''}"
            "{type: suction}."
        )
        own = not given.model_fields_set.isdisjoint({"closing_axis", "depth_m"})
        yield Issue(message, ("grasp",) if own else (part.shape_key,))


def _kind(config: AssemblyConfig, part: PartConfig) -> GraspKind:
    if part.grasp.type is not None:
        return GraspKind(part.grasp.type)
    by_suction = tool_kind(config, part.tool) is ToolKind.SUCTION
    return GraspKind.SUCTION if by_suction else GraspKind.JAWS


def _jaws(part: PartConfig, closing_axis: str, *, centred: bool = False) -> Grasp:
    at_m = part.grasp.at_m
    return jaws_about(
        boxes_of(part),
        None if closing_axis == "auto" else closing_axis,
        part.grasp.depth_m,
        None if at_m is None or centred else (at_m[0], at_m[1]),
    )


def _between_fingers(part: PartConfig, grasp: Grasp) -> bool:
    """Whether anything of the part is between the fingers' faces above their ends."""
    closing = "xy".index(grasp.closing_axis or "x")
    across = 1 - closing
    return any(
        box.centre[2] + box.size[2] / 2 > grasp.tip[2] + 1e-9
        and abs(box.centre[across] - grasp.tip[across])
        < box.size[across] / 2 + _FINGER_HALF_WIDTH_M
        and abs(box.centre[closing] - grasp.tip[closing]) < (box.size[closing] + grasp.width_m) / 2
        for box in boxes_of(part)
    )


def _top_under(part: PartConfig, x_m: float, y_m: float) -> float | None:
    """Return the height of the part's surface at a point of its plan [m], or None beside it."""
    tops_m = [shape.top_m(x_m, y_m) for shape in shapes_of(part)]
    return max((top_m for top_m in tops_m if top_m is not None), default=None)


def _nothing_at(part: PartConfig, x_m: float, y_m: float, hand: str) -> Issue:
    message = f"nothing of the part is under {hand} at [{x_m:.4f}, {y_m:.4f}]; "
    if part.grasp.at_m is not None:
        return Issue(f"{message}move it onto the part.", ("grasp", "at_m"))
    return Issue(f"{message}give grasp: {{at_m: [x, y]}}.", (part.shape_key,))
