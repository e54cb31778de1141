"""Interface of exporters: a handover of a task or plan, identifiers, and the files of a format.

Exporters are found by the entry point group ``skillplan.exporter``.
"""

from __future__ import annotations

import json
import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

from pydantic import BaseModel

from skillplan.model.replay import Replay, Step
from skillplan.model.skill_model import SkillModel
from skillplan.task import back_end
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task


@dataclass(frozen=True, slots=True)
class PlannedSkill:
    """A skill of a plan, with the states around it.

    Parameters
    ----------
    before, after
        State at its start, and nominal state at its end.
    origin, destination
        Names of the robot's places; empty if the task has none.
    """

    step: Step
    skill: Skill
    before: State
    after: State
    origin: str
    destination: str

    @property
    def subject(self) -> str:
        """Object of the skill: ``pcb`` of ``pick(pcb)``, ``a`` of ``place(a@b)``."""
        argument = get_argument(self.skill.name)
        # A choice of place or tool follows the name of the object.
        own = argument.partition("@")[0].partition(":")[0]
        return own if own in self.skill.parameters.values() else argument

    @property
    def tool(self) -> str:
        """Tool of the skill; may be empty."""
        return self.skill.parameters.get("tool", "")

    @property
    def torque_nm(self) -> float | None:
        """Tightening torque of a screw that it drives [N m]; None if none is stated."""
        if self.skill.motion is None:
            return None
        return self.skill.motion.visits(self.before)[-1].torque_nm


@dataclass(frozen=True)
class TrainedPolicy:
    """A policy of a training.

    Parameters
    ----------
    weights, biases
        Arrays of every layer, float32, of shape (inputs, outputs) and (outputs,). Outputs of a
        layer are rectified before the next.
    features, actions
        Name of every input, and skill of every output.
    observation, mask
        Kind of its observation, and restriction of its choice.
    solver, task
        Name of its learner, and of the task that it learned.
    step
        Environment step at which it was kept.
    cost
        Cost of its episode then, under chance its expected cost; None without one.
    own_rule
        How it drew its actions at the end of the training, such as ``temperature 1``.
    problem
        Why it has no cost; empty if no policy of its run completed the task.
    """

    weights: tuple[Any, ...]
    biases: tuple[Any, ...]
    features: tuple[str, ...]
    actions: tuple[str, ...]
    observation: str
    mask: str
    solver: str
    task: str
    step: int
    cost: float | None
    own_rule: str
    problem: str = ""


@dataclass(frozen=True)
class Handover:
    """A task and a plan to be exported.

    Parameters
    ----------
    plan
        Replayed, feasible and complete; None to export the task only.
    charted
        True if detectors use the hand-made chart only.
    policies
        Policies of a training by the number of their run; empty for a task or a plan.
    """

    model: SkillModel
    plan: Replay | None = None
    charted: bool = False
    policies: Mapping[int, TrainedPolicy] = field(default_factory=dict)

    @property
    def task(self) -> Task:
        """The task."""
        return self.model.task

    @cached_property
    def skills(self) -> tuple[PlannedSkill, ...]:
        """The skills of the plan, in order; none without a plan."""
        planned = []
        state = self.model.initial
        for step in () if self.plan is None else self.plan.steps:
            skill = self.task.skills[step.action]
            after = skill.prediction_in(state).apply(state)
            places = _name_place(self.task, skill, state), _name_place(self.task, skill, after)
            planned.append(PlannedSkill(step, skill, state, after, *places))
            state = after
        return tuple(planned)

    @property
    def chance(self) -> str:
        """Name of the first skill with several outcomes; empty if all are deterministic."""
        return next((skill.name for skill in self.task.skills if not skill.deterministic), "")


def get_argument(name: str) -> str:
    """Return the argument in brackets: ``pcb`` of ``placed(pcb)``; may be empty."""
    _, bracket, rest = name.partition("(")
    return rest.removesuffix(")") if bracket else ""


def _name_place(task: Task, skill: Skill, state: State) -> str:
    if skill.motion is not None:
        fact, _ = task.scene.robot(skill.motion.robot).place(state)
        return get_argument(fact) or fact
    names = [place.name for place in task.places_in(state)]
    return names[0] if len(names) == 1 else ""


def format_decimal(value: float) -> str:
    """Return a number with 12 significant digits, which removes noise of binary fractions."""
    return f"{value + 0.0:.12g}"


class Exporter(ABC):
    """Writes a task or a plan in a format of other tools.

    Parameters
    ----------
    options
        An instance of `Options`; None for the defaults.

    Attributes
    ----------
    name
        Kebab-case, as in the entry point.
    Options
        A pydantic model whose fields have ranges and descriptions.
    suffix
        Suffix of a single file, such as ``.csv``; empty for a folder of files.
    needs_plan
        True if a task without a plan cannot be exported.
    needs_policies
        True if it exports policies of a training, and no tasks and plans.
    """

    name: ClassVar[str]
    Options: ClassVar[type[BaseModel]] = back_end.Options
    suffix: ClassVar[str] = ""
    needs_plan: ClassVar[bool] = True
    needs_policies: ClassVar[bool] = False

    def __init__(self, options: BaseModel | None = None) -> None:
        self.options = self.Options() if options is None else options

    def refuses(self, handover: Handover) -> str | None:
        """Return the reason why the format cannot represent the handover, or None.

        By default tasks with chance are refused, which a list of skills cannot represent.
        """
        return refuse_chance(handover)

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return notes for users of the files, a clause each."""
        return ()

    @abstractmethod
    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return contents by file name; a single file may get another name.

        Called only if `refuses` returns None. Texts are written as UTF-8, the last file last.
        """


def states_torques(handover: Handover) -> bool:
    """Return True if a skill of the plan has a tightening torque."""
    return any(planned.torque_nm is not None for planned in handover.skills)


def note_arrivals(handover: Handover) -> tuple[str, ...]:
    """Return that a file holds no times of arrival, if parts of the task arrive."""
    if not handover.task.has_arrivals:
        return ()
    words = "left out are times of arrival ('arrives_s'): durations contain the planned waits, and"
    return (f"{words} the executor has to wait for each part",)


def note_zones(handover: Handover) -> tuple[str, ...]:
    """Return that a file without paths holds no zones, if the task has any."""
    zones = handover.task.scene.zones
    if not zones:
        return ()
    names = ", ".join(zone.name for zone in zones)
    slow = any(zone.speed_m_per_s is not None for zone in zones)
    what = "keep-out zones and limits of speed" if slow else "keep-out zones"
    return (f"the file has no paths: the controller must keep the {what} of {names}",)


def refuse_chance(handover: Handover) -> str | None:
    """Return the reason why a task with chance is refused, or None."""
    if not handover.chance:
        return None
    return (
        f"what becomes of {handover.chance} is left to chance, and this format knows one outcome "
        "only. Take the chance out, as by --set parts.NAME.grasp_failure=0, or "
        "export to btcpp, which tries again"
    )


_LONGEST = 60


class Identifiers:
    """Unique identifiers of names: small letters, digits and single underscores.

    They depend on the names and their order alone, so they can be converted back.

    Parameters
    ----------
    reserved
        Reserved words of the language, in small letters.
    """

    def __init__(
        self, names: Iterable[str], reserved: Collection[str] = (), prefix: str = ""
    ) -> None:
        self._by_name: dict[str, str] = {}
        self._by_identifier: dict[str, str] = {}
        for name in names:
            plain = prefix + _simplify(name)
            identifier, number = plain, 1
            while identifier in self._by_identifier or identifier in reserved:
                number += 1
                identifier = f"{plain}_{number}"
            self._by_name[name] = identifier
            self._by_identifier[identifier] = name

    def __getitem__(self, name: str) -> str:
        return self._by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_name)

    def name_of(self, identifier: str) -> str | None:
        """Return the name of an identifier in any case; None if it is unknown."""
        return self._by_identifier.get(identifier.lower())

    def lines(self) -> list[str]:
        """Return lines for a comment, such as ``pick_pcb = "..."``."""
        return [f"{identifier} = {quote(name)}" for name, identifier in self._by_name.items()]


def quote(text: str) -> str:
    """Return a text as one line of ASCII JSON that cannot end a comment."""
    return json.dumps(text).replace("*", "\\u002a").replace("\x7f", "\\u007f")


def _simplify(name: str) -> str:
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower())[:_LONGEST].strip("_")
    # Word for a name without letters or digits of ASCII.
    return plain if plain[:1].isalpha() else f"x_{plain}".rstrip("_")
