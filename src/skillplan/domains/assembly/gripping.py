"""Grasps of parts: the types of tools, the grasps that hands can take, and their faults."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from skillplan.domains.assembly.holding import (
    Handle,
    list_automatic_grasps,
    name_direction,
    name_grasps,
    name_side,
)
from skillplan.domains.assembly.layout import get_layout
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import GraspConfig
from skillplan.domains.assembly.screw_schema import ScrewConfig
from skillplan.domains.assembly.tool_schema import ACCELERATION_M_PER_S2, SAFETY_FACTOR, ToolConfig
from skillplan.domains.assembly.workholding import list_goal_poses
from skillplan.errors import Issue
from skillplan.physics.linear_motions import grasp_boxes
from skillplan.robots.arm_description import Hand
from skillplan.task.motion import Grasp, GraspKind
from skillplan.task.pose import Pose, cross, dot, plus
from skillplan.task.scene import ToolKind

# Clearance of the open jaws, both sides together, about a part that fits between them [m].
_PLAY_M = 0.002
# Distance of the jaws from a part's middle above which they push it aside [m].
_OFF_MIDDLE_M = 5e-4
# Least extent of a hand behind its tip [m].
_HAND_M = 0.06
# Greatest upward component of an approach at which the hand may still be above the table.
_UPWARDS = 0.3


@dataclass(frozen=True, slots=True)
class _Choice:
    """One grasp of a part, the path of its entry in the file, and the part's poses.

    At its goal a part has a pose for each orientation of its workholder, of which one is enough.
    """

    part: PartConfig
    handle: Handle
    given: GraspConfig
    path: tuple[str | int, ...]
    tool: ToolConfig
    hand: Hand
    poses: Mapping[str, Sequence[Pose]]


def choose_tool_kind(config: AssemblyConfig, tool: str) -> ToolKind:
    """Return the type of a tool: as given, or by its uses."""
    given = config.tools[tool].type
    if given is not None:
        return ToolKind(given)
    drives = any(tool in s.tools for s in config.screws.values())
    holds = any(tool in p.tools for p in config.parts.values())
    return ToolKind.SCREWDRIVER if drives and not holds else ToolKind.GRIPPER


def list_grasps(config: AssemblyConfig, name: str) -> tuple[Grasp, ...]:
    """Return the grasps of a part without faults, the preferred one first.

    For ``auto`` these are the candidates that a hand can take.
    """
    if config.parts[name].fixed:
        return ()
    choices = _list_choices(config, name)
    if config.parts[name].grasp == "auto":
        choices = [choice for choice in choices if not any(_find_faults(choice))] or choices[:1]
    return name_grasps([choice.handle.grasp() for choice in choices])


def describe_candidates(config: AssemblyConfig, name: str) -> tuple[list[str], list[str]]:
    """Return the grasps that ``auto`` keeps, and the refused ones with the reason.

    Equal reasons share a line.
    """
    kept = [grasp.name or name_side(grasp.approach) for grasp in list_grasps(config, name)]
    refused: dict[str, list[str]] = {}
    for choice in _list_choices(config, name):
        fault = next(_find_faults(choice), None)
        if fault is not None:
            refused.setdefault(_shorten(fault.message), []).append(_name_candidate(choice))
    return kept, [f"{', '.join(names)}: {reason}" for reason, names in refused.items()]


def _name_candidate(choice: _Choice) -> str:
    """Return the side and the closing axis of a candidate of ``auto``."""
    side, given = name_side(choice.handle.approach), choice.given
    hold = {"outer": "", "inner": " from inside", "wall": " by a wall"}[given.hold]
    return f"{side} closing along {given.closing_axis}{hold}"


def _shorten(message: str) -> str:
    """Return the fault of a message without its advice, which `auto` does not need."""
    return message.split("; give", 1)[0].split(". Give", 1)[0].rstrip(".")


def find_grasp_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield faults of tools and grasps of parts with known tools."""
    for name in config.tools:
        tool, kind = config.tools[name], choose_tool_kind(config, name)
        for issue in find_tool_issues(tool, kind, config.robot.hand):
            yield issue.under("tools", name)
    for name, part in config.moved_parts.items():
        kind = choose_tool_kind(config, part.tool)
        if kind not in (ToolKind.GRIPPER, ToolKind.SUCTION):
            message = f"{part.tool!r} is a {kind}, which holds no part. Name another."
            yield Issue(message, ("parts", name, "tool"))
            continue
        for issue in _find_part_issues(config, name):
            yield issue.under("parts", name)
    for name, screw in config.screws.items():
        for driver in screw.tools:
            kind = choose_tool_kind(config, driver)
            if kind is not ToolKind.SCREWDRIVER:
                message = f"{driver!r} is a {kind}, which turns no screw. Name a screwdriver."
                yield Issue(message, ("screws", name, "tool"))
                continue
            if fault := _compare_socket(config.tools[driver], driver, screw, name):
                yield Issue(fault, ("screws", name, "tool"))


def _compare_socket(tool: ToolConfig, driver: str, screw: ScrewConfig, name: str) -> str | None:
    """Return why a screwdriver does not turn a screw, or None."""
    if tool.socket_m is None:
        if screw.head == "nut":
            return f"{driver!r} has a bit, and a nut needs a socket. Give it 'socket_m'."
        return None
    if screw.flats_m is None:
        return f"{driver!r} has a socket, which turns head: hex or nut. Name another."
    if abs(tool.socket_m - screw.flats_m) > _FLATS_M:
        return (
            f"{driver!r} has a socket of {tool.socket_m * 1e3:g} mm, and {name!r} is "
            f"{screw.flats_m * 1e3:g} mm wide across its flats. Name another."
        )
    if tool.socket_below_m >= screw.head_height_m:
        return (
            f"the socket of {driver!r} is {tool.socket_below_m * 1e3:g} mm deep, and {name!r} is "
            f"{screw.head_height_m * 1e3:g} mm high. Give it a smaller 'socket_depth_m'."
        )
    return None


# Difference of a socket and a hexagon up to which they fit [m].
_FLATS_M = 5e-5
# Keys of tools that only some types have, with what the others lack.
_OF_TYPES = {
    "opening_m": (ToolKind.GRIPPER, "jaws"),
    "clearance_m": (ToolKind.GRIPPER, "jaws"),
    "jaw_profile_m": (ToolKind.GRIPPER, "jaws"),
    "fingers": (ToolKind.GRIPPER, "fingers"),
    "outer_grip_m": (ToolKind.GRIPPER, "jaws"),
    "inner_grip_m": (ToolKind.GRIPPER, "jaws"),
    "bit_length_m": (ToolKind.SCREWDRIVER, "bit"),
    "bit_diameter_m": (ToolKind.SCREWDRIVER, "bit"),
    "torque_nm": (ToolKind.SCREWDRIVER, "bit"),
    "speed_rpm": (ToolKind.SCREWDRIVER, "bit"),
    "force_n": (ToolKind.GRIPPER, "force"),
    "cup_diameter_m": (ToolKind.SUCTION, "cup"),
    "cups_m": (ToolKind.SUCTION, "cups"),
    "safety_factor": (ToolKind.SUCTION, "cup"),
    "acceleration_m_per_s2": (ToolKind.SUCTION, "cup"),
}
# Ends of tools by type, for messages.
_ENDS = {
    ToolKind.GRIPPER: "fingers",
    ToolKind.SUCTION: "cup",
    ToolKind.SCREWDRIVER: "bit",
    ToolKind.PRESS: "ram",
    ToolKind.DISPENSER: "needle",
}
# Tools whose ram or needle has the keys of a bit.
_WITH_BIT = (ToolKind.PRESS, ToolKind.DISPENSER)
# Tools other than grippers with a force.
_WITH_FORCE = (ToolKind.SUCTION, ToolKind.PRESS)
# Keys that the box about a tool replaces.
_IN_ENVELOPE = {
    "cup_diameter_m": "the cup is part of the envelope.",
    "cups_m": "the cups are part of the envelope.",
    "body": "the body is part of the envelope.",
}


def find_tool_issues(tool: ToolConfig, kind: ToolKind, hand: Hand) -> Iterator[Issue]:
    """Yield keys of a tool that its type does not have, or that exclude each other.

    Parameters
    ----------
    hand
        Hand of the arm.
    """
    for key, (owner, what) in _OF_TYPES.items():
        owners = (owner, *_WITH_BIT) if key.startswith("bit") else (owner,)
        owners = (*owners, *_WITH_FORCE) if key == "force_n" else owners
        if getattr(tool, key) is not None and kind not in owners:
            words = f"a tool of type {kind} has no {what}. Leave it out, or give type: {owner}."
            yield Issue(words, (key,))
        elif getattr(tool, key) is not None and key in _IN_ENVELOPE and tool.envelope_m is not None:
            yield Issue(f"give 'envelope_m' or {key!r}: {_IN_ENVELOPE[key]}", (key,))
    if tool.body is not None and tool.envelope_m is not None:
        yield Issue(f"give 'envelope_m' or 'body': {_IN_ENVELOPE['body']}", ("body",))
    for key in ("safety_factor", "acceleration_m_per_s2"):
        if getattr(tool, key) is not None and tool.force_n is None:
            yield Issue("has no effect without 'force_n', the holding force. Give that.", (key,))
    for key in ("outer_grip_m", "inner_grip_m"):
        widths_m = getattr(tool, key)
        if widths_m is not None and widths_m[0] >= widths_m[1]:
            yield Issue("the least width comes first, then a greater one.", (key,))
    if tool.mounted_on is not None and kind is ToolKind.GRIPPER:
        words = "a gripper is on the flange itself: mount the other tool on it, or give 'type'."
        yield Issue(words, ("mounted_on",))
    yield from _find_length_issues(tool, kind, hand)


def _find_length_issues(tool: ToolConfig, kind: ToolKind, hand: Hand) -> Iterator[Issue]:
    """Yield a tool that ends before its own parts would, seen from the flange."""
    if tool.length_m is None:
        return
    least_m, what = tool.measure_end_m(kind, hand), f"its {_ENDS[kind]}"
    if tool.body is not None:
        least_m, what = least_m + tool.body.height_m, f"its {_ENDS[kind]} and body"
    elif kind is ToolKind.GRIPPER:
        least_m = hand.tip_on_flange.xyz_m[2] + max(0.0, least_m - hand.jaw_m[-1][0])
        what = "the arm's hand, whose body it has"
    if tool.length_m < least_m - 1e-9:
        message = f"{tool.length_m:g} m is shorter than {what}, {least_m:g} m. Give at least that."
        yield Issue(message, ("length_m",))


def _list_choices(config: AssemblyConfig, name: str) -> list[_Choice]:
    """Return the given grasps of a part, or all candidates of ``auto``."""
    part = config.parts[name]
    given = part.grasp
    if given == "auto":
        given = list_automatic_grasps()
        outer = [_make_choice(config, name, grasp, ("grasp",)) for grasp in given]
        from_top = [choice for choice in outer if choice.handle.from_top]
        if not all(any(_find_faults(choice)) for choice in from_top):
            return outer
        # From the top, a wall or a hole may be narrow enough.
        given += [
            grasp.model_copy(update={"hold": hold})
            for hold in ("wall", "inner")
            for grasp in (choice.given for choice in from_top)
        ]
    several = isinstance(given, list)
    listed = given if isinstance(given, list) else [given]
    return [
        _make_choice(
            config,
            name,
            grasp,
            ("grasp", index) if several and part.grasp != "auto" else ("grasp",),
        )
        for index, grasp in enumerate(listed)
    ]


def _make_choice(
    config: AssemblyConfig, name: str, grasp: GraspConfig, path: tuple[str | int, ...]
) -> _Choice:
    part, layout = config.parts[name], get_layout(config)
    by_suction = choose_tool_kind(config, part.tool) is ToolKind.SUCTION
    default = GraspKind.SUCTION if by_suction else GraspKind.JAWS
    tool = config.tools[part.tool]
    hand = tool.hand_on(config.robot.hand) or config.robot.hand
    kind = default if grasp.type is None else GraspKind(grasp.type)
    poses = {
        "at the start": [layout.start(name).pose],
        "at its goal": list_goal_poses(config, name, layout.goal(name).pose),
    }
    handle = Handle(grasp, kind, part.shapes, hand)
    return _Choice(part, handle, grasp, path, tool, hand, poses)


def _find_part_issues(config: AssemblyConfig, name: str) -> Iterator[Issue]:
    part = config.parts[name]
    choices = _list_choices(config, name)
    if part.grasp == "auto":
        if all(any(_find_faults(choice)) for choice in choices):
            _, refused = describe_candidates(config, name)
            message = f"no hand can hold it from any of its six sides: {'; '.join(refused)}."
            yield Issue(message, ("grasp",))
        return
    by_suction = choose_tool_kind(config, part.tool) is ToolKind.SUCTION
    first_index: dict[Grasp, int] = {}
    for index, choice in enumerate(choices):
        if by_suction and choice.given.type == "jaws":
            message = f"{part.tool!r} is of type suction and has no jaws. Leave it out."
            yield Issue(message, (*choice.path, "type"))
            continue
        faults = list(_find_faults(choice))
        yield from faults
        if not faults:
            earlier = first_index.setdefault(choice.handle.grasp(), index)
            if earlier != index:
                message = f"is the same as entry {earlier}. Leave one out."
                yield Issue(message, choice.path)


def _find_faults(choice: _Choice) -> Iterator[Issue]:
    """Yield the reasons why no hand can take a grasp."""
    handle, given = choice.handle, choice.given
    if handle.closes_askew:
        message = (
            f"is not at right angles to the direction in which the hand points, "
            f"{name_direction(handle.approach)}. Give another axis."
        )
        yield Issue(message, (*choice.path, "closing_axis"))
        return
    level = abs(handle.approach[2]) < 1 - 1e-9
    if level and given.at_m is not None and len(given.at_m) == 2:
        message = "give x y z of a point on the hand's axis: it does not come from the part's top."
        yield Issue(message, (*choice.path, "at_m"))
        return
    by_suction = handle.kind is GraspKind.SUCTION
    faults = list(_find_suction_faults(choice) if by_suction else _find_jaws_faults(choice))
    yield from faults or _find_table_faults(choice)


def _find_suction_faults(choice: _Choice) -> Iterator[Issue]:
    given, handle = choice.given, choice.handle
    yield from _find_weak_suction(choice)
    is_for_jaws = {
        # From any side but the top it turns the hand.
        "closing_axis": handle.from_top
        and given.closing_axis != "auto"
        and len(choice.tool.cups) == 1,
        "depth_m": given.depth_m is not None,
        "width_m": given.width_m is not None,
        "hold": given.hold != "outer",
    }
    if choice.part.grasp != "auto":
        for key in (key for key, applies in is_for_jaws.items() if applies):
            message = (
                "says how jaws hold it, and suction has none. Leave it out, or give type: jaws."
            )
            yield Issue(message, (*choice.path, key))
    through = handle.cup_axis()
    grasp = handle.grasp()
    across = cross(grasp.closing, grasp.approach)
    for x_m, y_m in choice.tool.cups:
        at = plus(plus(through, grasp.closing, x_m), across, y_m)
        if handle.lands_m(at) is None:
            what = "the suction cup" if len(choice.tool.cups) == 1 else "a suction cup"
            yield _report_miss(choice, at, what)
            return


# Friction of a cup on metal, glass or plastic (Schmalz, theoretical holding force) [-].
_CUP_FRICTION = 0.5
_GRAVITY_M_PER_S2 = 9.81
# Least downward component of an approach at which cups bear a part from above.
_FROM_ABOVE = 0.99


def _find_weak_suction(choice: _Choice) -> Iterator[Issue]:
    """Yield a part that is too heavy for its suction tool.

    Load cases II and III of Schmalz, "Theoretical holding force of a suction cup": the part hangs
    below the cups and is accelerated sideways, or it hangs at their side.
    """
    tool, mass_kg = choice.tool, choice.part.mass_kg
    if tool.force_n is None:
        return
    factor = SAFETY_FACTOR if tool.safety_factor is None else tool.safety_factor
    rate = tool.acceleration_m_per_s2
    rate = ACCELERATION_M_PER_S2 if rate is None else rate
    approach = choice.handle.approach
    above = all(pose.rotate(approach)[2] < -_FROM_ABOVE for pose, *_ in choice.poses.values())
    if above:
        needed_m_per_s2 = _GRAVITY_M_PER_S2 + rate / _CUP_FRICTION
        words = f"({_GRAVITY_M_PER_S2:g} + {rate:g} / {_CUP_FRICTION:g}) m/s2"
    else:
        needed_m_per_s2 = (_GRAVITY_M_PER_S2 + rate) / _CUP_FRICTION
        words = f"({_GRAVITY_M_PER_S2:g} + {rate:g}) / {_CUP_FRICTION:g} m/s2, from its side"
    needed_n = factor * mass_kg * needed_m_per_s2
    if needed_n > tool.force_n + 1e-9:
        message = (
            f"{mass_kg:g} kg need {needed_n:.1f} N of suction: {factor:g} (safety) x {mass_kg:g} "
            f"kg x {words}; {choice.part.tool!r} holds {tool.force_n:g} N. Take another tool or "
            "more cups."
        )
        yield Issue(message, ("mass_kg",))


def _find_jaws_faults(choice: _Choice) -> Iterator[Issue]:
    given, handle, opening_m = choice.given, choice.handle, choice.tool.opening_m
    if given.depth_m is not None and given.depth_m >= handle.height_m:
        message = (
            f"{given.depth_m:.4f} m below the top of a part {handle.height_m:.4f} m high; the "
            "fingers must end above its bottom."
        )
        yield Issue(message, (*choice.path, "depth_m"))
        return
    is_open = opening_m is None and choice.tool.outer_grip_m is None
    if is_open and not given.model_fields_set - {"type"}:
        # Neither jaws nor grasp are given.
        return
    if given.hold != "outer":
        yield from _find_feature_faults(choice)
        return
    grasp = handle.jaws()
    if not handle.between_fingers(grasp):
        yield _report_miss(choice, grasp.tip, "the jaws")
    elif given.width_m is None:
        yield from _find_offset(choice, grasp)
    if opening_m is not None and grasp.width_m > opening_m - _PLAY_M + 1e-9:
        yield _report_width(choice, grasp, opening_m)
    else:
        yield from _find_width_faults(choice, grasp)


def _find_width_faults(choice: _Choice, grasp: Grasp) -> Iterator[Issue]:
    """Yield a part or wall that is not as wide as the tool holds from outside."""
    low_m, high_m = choice.tool.outer_grip_m or (0.0, math.inf)
    if not low_m - 1e-9 <= grasp.width_m <= high_m + 1e-9:
        message = (
            f"{grasp.width_m:.3f} m wide where {choice.part.tool!r} holds {low_m:g} to "
            f"{high_m:g} m from outside. Give another closing axis, or another tool."
        )
        yield Issue(message, choice.path if len(choice.path) > 1 else (choice.part.shape_key,))


def _find_feature_faults(choice: _Choice) -> Iterator[Issue]:
    """Yield a wall or hole that is not there, or that the jaws cannot hold."""
    given, handle = choice.given, choice.handle
    tool = choice.part.tool
    if handle.feature is None:
        where = "" if given.at_m is None else " there"
        message = (
            f"no wall{where} that jaws can close about; give grasp: {{hold: wall, at_m: [x, y]}} "
            "of a point on it."
            if given.hold == "wall"
            else f"no hole{where} that jaws can open in, across the whole width of the fingers; "
            "give grasp: {hold: inner, at_m: [x, y]} of a point in it."
        )
        yield Issue(message, (*choice.path, "hold" if given.at_m is None else "at_m"))
        return
    grasp = handle.jaws()
    opening_m = min(choice.hand.opening_m, choice.tool.opening_m or choice.hand.opening_m)
    if given.hold == "wall":
        if grasp.width_m > opening_m - _PLAY_M + 1e-9:
            message = (
                f"the wall is {grasp.width_m:.4f} m thick over the fingers' width, where the jaws "
                f"of {tool!r} open {opening_m:.3f} m, of which {_PLAY_M:.3f} m are play."
            )
            yield Issue(message, (*choice.path, "hold"))
        yield from _find_width_faults(choice, grasp)
        return
    fingers_m = 2 * choice.hand.jaw_thickness_m(handle.depth_m(grasp))
    least_m, most_m = fingers_m + _PLAY_M, fingers_m + opening_m
    if choice.tool.inner_grip_m is not None:
        low_m, high_m = choice.tool.inner_grip_m
        least_m, most_m = max(least_m, low_m), min(most_m, high_m)
    if not least_m - 1e-9 <= grasp.width_m <= most_m + 1e-9:
        message = (
            f"the hole is {grasp.width_m:.4f} m wide over the fingers' width, where the jaws of "
            f"{tool!r} hold from inside {least_m:.4f} m to {most_m:.4f} m: both are "
            f"{fingers_m:.4f} m thick {handle.depth_m(grasp):.4f} m above their ends. Give another "
            "tool, a smaller depth_m, or hold: wall."
        )
        yield Issue(message, (*choice.path, "hold"))


def _find_offset(choice: _Choice, grasp: Grasp) -> Iterator[Issue]:
    """Yield jaws that would push the part aside before they hold it."""
    at_m = dot(grasp.tip, grasp.closing)
    middle_m = dot(choice.handle.jaws(centred=True).tip, grasp.closing)
    if abs(at_m - middle_m) > _OFF_MIDDLE_M:
        axis = grasp.closing_axis
        message = (
            f"the jaws close about {axis or name_direction(grasp.closing)} = {middle_m:.4f} m, not "
            f"{at_m:.4f} m, where they would push the part aside."
        )
        place = () if axis is None else ("xyz".index(axis),)
        yield Issue(message, (*choice.path, "at_m", *place))


def _report_width(choice: _Choice, grasp: Grasp, opening_m: float) -> Issue:
    given, part = choice.given, choice.part
    fits = False
    other = "yx"["xy".index(grasp.closing_axis)] if grasp.closing_axis in ("x", "y") else ""
    if choice.handle.from_top and other:
        width_m = grasp_boxes(part.bounding_boxes, other, given.depth_m).width_m
        fits = width_m <= opening_m - _PLAY_M + 1e-9
    play = "" if grasp.width_m > opening_m else f", of which {_PLAY_M:.3f} m are play"
    message = (
        f"{grasp.width_m:.3f} m wide where the jaws of {choice.part.tool!r} open {opening_m:.3f} m"
        f"{play}; give grasp: {f'{{closing_axis: {other}}} or ' if fits else ''}"
        "{type: suction}."
    )
    is_own = bool(given.model_fields_set & {"approach", "closing_axis", "depth_m"})
    return Issue(message, choice.path if is_own or len(choice.path) > 1 else (part.shape_key,))


def _find_table_faults(choice: _Choice) -> Iterator[Issue]:
    """Yield a hand that would be in the table, at the start or at the goal."""
    grasp = choice.handle.grasp()
    for where, poses in choice.poses.items():
        if all(_is_in_table(grasp, pose) for pose in poses):
            side = name_side(grasp.approach)
            side = f"the {side}" if side in ("top", "bottom") else f"its {side} side"
            message = (
                f"no hand can hold it from {side} {where}, where the hand would be in the table. "
                "Give another approach."
            )
            key = ("approach",) if "approach" in choice.given.model_fields_set else ()
            yield Issue(message, (*choice.path, *key))
            return


def _is_in_table(grasp: Grasp, pose: Pose) -> bool:
    points = pose.rotate(grasp.approach)
    return points[2] > _UPWARDS and plus(pose.apply(grasp.tip), points, -_HAND_M)[2] < 0


def _report_miss(choice: _Choice, point: tuple[float, float, float], hand: str) -> Issue:
    numbers = point[:2] if choice.handle.from_top else point
    place = ", ".join(f"{value:.4f}" for value in numbers)
    message = f"nothing of the part is under {hand} at [{place}]; "
    if choice.given.at_m is not None:
        return Issue(f"{message}move it onto the part.", (*choice.path, "at_m"))
    numbers_needed = "x, y" if choice.handle.from_top else "x, y, z"
    path = choice.path if len(choice.path) > 1 else (choice.part.shape_key,)
    return Issue(f"{message}give grasp: {{at_m: [{numbers_needed}]}}.", path)
