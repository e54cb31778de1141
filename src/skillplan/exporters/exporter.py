"""What every exporter offers: the files that hand a task or a plan on, or why there are none."""

from __future__ import annotations

import json
import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

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
    step
        What it costs and how long it takes.
    skill
        The skill.
    before, after
        The state where it starts, and the nominal one where it ends.
    origin, destination
        Names of the places where the robot stands then; empty where the task has none.
    """

    step: Step
    skill: Skill
    before: State
    after: State
    origin: str
    destination: str

    @property
    def subject(self) -> str:
        """What the skill is done to: ``pcb`` of ``pick(pcb)``."""
        return argument(self.skill.name)

    @property
    def tool(self) -> str:
        """The tool that it uses; empty where it names none."""
        return self.skill.parameters.get("tool", "")


@dataclass(frozen=True)
class Handover:
    """A task and a plan that are handed over.

    Parameters
    ----------
    model
        The task with the back ends that judge it.
    plan
        Replayed, feasible and complete; None where only the task is handed over.
    charted
        True if the hand-made chart is all that the detectors go by.
    """

    model: SkillModel
    plan: Replay | None = None
    charted: bool = False

    @property
    def task(self) -> Task:
        """The task."""
        return self.model.task

    @cached_property
    def skills(self) -> tuple[PlannedSkill, ...]:
        """The skills of the plan, in order; none without a plan."""
        found = []
        state = self.model.initial
        for step in () if self.plan is None else self.plan.steps:
            skill = self.task.skills[step.action]
            after = skill.prediction_in(state).apply(state)
            places = _place(self.task, skill, state), _place(self.task, skill, after)
            found.append(PlannedSkill(step, skill, state, after, *places))
            state = after
        return tuple(found)

    @property
    def chance(self) -> str:
        """The first skill of several outcomes, whose outcome is left to chance; else empty."""
        return next((skill.name for skill in self.task.skills if not skill.deterministic), "")


def argument(name: str) -> str:
    """Return what stands in brackets: ``pcb`` of ``placed(pcb)``; else nothing."""
    _, bracket, rest = name.partition("(")
    return rest.removesuffix(")") if bracket else ""


def _place(task: Task, skill: Skill, state: State) -> str:
    if skill.motion is not None:
        fact, _ = task.scene.robot(skill.motion.robot).place(state)
        return argument(fact) or fact
    names = [place.name for place in task.places_in(state)]
    return names[0] if len(names) == 1 else ""


def decimal_text(value: float) -> str:
    """Return a number with 12 significant digits, the noise of binary fractions rounded away."""
    return f"{value + 0.0:.12g}"


class Exporter(ABC):
    """Says a task, or a plan of it, in a format that other tools read.

    Parameters
    ----------
    options
        An instance of `Options`; None for the defaults.

    Attributes
    ----------
    name
        Kebab-case, as in the entry point.
    Options
        A pydantic model whose fields carry range and description.
    suffix
        End of the name of the one file that it makes, such as ``.csv``; empty where it makes
        several, which go into a folder.
    needs_plan
        True if there is nothing to hand over without a plan.
    """

    name: ClassVar[str]
    Options: ClassVar[type[BaseModel]] = back_end.Options
    suffix: ClassVar[str] = ""
    needs_plan: ClassVar[bool] = True

    def __init__(self, options: BaseModel | None = None) -> None:
        self.options = self.Options() if options is None else options

    def refuses(self, handover: Handover) -> str | None:
        """Return in words what the format cannot say of it; None where it can say all.

        By default what is left to chance is refused: a list of skills says nothing of it.
        """
        return refused_chance(handover)

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return what whoever takes the files over has to know, a clause each."""
        return ()

    @abstractmethod
    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return contents by the names of files; the name of a single one is not used.

        Called where it does not refuse. Texts are written as UTF-8. The last of several is
        written last.
        """


def refused_chance(handover: Handover) -> str | None:
    """Return why what is left to chance cannot be handed over; None where nothing is."""
    if not handover.chance:
        return None
    return (
        f"what becomes of {handover.chance} is left to chance, and this format knows one outcome "
        "only. Take the chance out, as by --set parts.NAME.grasp_failure=0, or "
        "export to btcpp, which tries again"
    )


_LONGEST = 60


class Identifiers:
    """Names with an identifier each: small letters, digits and single underscores.

    They depend on the names and their order alone, so that whoever knows the names can tell them
    from the identifiers again.

    Parameters
    ----------
    names
        Distinct ones; any text.
    reserved
        Words of the language, in small letters, that no identifier may be.
    prefix
        What every identifier begins with.
    """

    def __init__(
        self, names: Iterable[str], reserved: Collection[str] = (), prefix: str = ""
    ) -> None:
        self._by_name: dict[str, str] = {}
        self._by_identifier: dict[str, str] = {}
        for name in names:
            plain = prefix + _plain(name)
            found, number = plain, 1
            while found in self._by_identifier or found in reserved:
                number += 1
                found = f"{plain}_{number}"
            self._by_name[name] = found
            self._by_identifier[found] = name

    def __getitem__(self, name: str) -> str:
        return self._by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_name)

    def name_of(self, identifier: str) -> str | None:
        """Return the name of an identifier, however its letters are; None of an unknown one."""
        return self._by_identifier.get(identifier.lower())

    def lines(self) -> list[str]:
        """Return for a comment which identifier stands for which name: ``pick_pcb = "..."``."""
        return [f"{identifier} = {quoted(name)}" for name, identifier in self._by_name.items()]


def quoted(text: str) -> str:
    """Return a text as JSON in plain ASCII on one line, which no comment's end can hide in."""
    return json.dumps(text).replace("*", "\\u002a").replace("\x7f", "\\u007f")


def _plain(name: str) -> str:
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower())[:_LONGEST].strip("_")
    # The word of a name without any letter or digit of ASCII.
    return plain if plain[:1].isalpha() else f"x_{plain}".rstrip("_")
