"""Facts as typed predicates over objects, and everything's identifier."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from skillplan.exporters.handover import argument
from skillplan.exporters.identifiers import Identifiers
from skillplan.task.task import Task

_WORDS = """
define domain problem requirements types constants objects predicates functions action parameters
precondition effect init goal metric minimize maximize total_cost total_time increase decrease
assign scale_up scale_down and or not imply forall exists when either object number derived axiom
always sometime within over all start end from
"""
KEYWORDS: Final = frozenset(_WORDS.split())
PLACE = "location"
_UNKNOWN = "thing"


class Vocabulary:
    """What the facts of a task are called in PDDL.

    Parameters
    ----------
    task
        The task.

    Attributes
    ----------
    types
        Identifiers of types, by name.
    predicates
        Identifiers of predicates, by name.
    objects
        Identifiers of objects, by ``type/name``.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        arguments: dict[str, list[str]] = {}
        for fact in task.facts.names:
            arguments.setdefault(self.predicate(fact), [])
            if argument(fact):
                arguments[self.predicate(fact)].append(argument(fact))
        self._type_of = {
            predicate: _type(task, predicate, found)
            for predicate, found in arguments.items()
            if found
        }
        self.types = Identifiers(dict.fromkeys(self._type_of.values()), KEYWORDS)
        taken = KEYWORDS | {self.types[name] for name in self.types}
        self.predicates = Identifiers(arguments, taken)
        self.taken = taken | {self.predicates[name] for name in self.predicates}
        keys = {
            self._object(fact): None for fact in task.facts.names if argument(fact)
        }  # a set in order
        self.objects = Identifiers(keys, self.taken)

    @staticmethod
    def predicate(fact: str) -> str:
        """Return the name of a fact's predicate; facts with and without argument are two."""
        return f"{fact.partition('(')[0]}()" if argument(fact) else fact

    def type_of(self, predicate: str) -> str | None:
        """Return the identifier of the type of a predicate's argument; None without one."""
        name = self._type_of.get(predicate)
        return None if name is None else self.types[name]

    def atom(self, fact: str) -> str:
        """Return a fact as an atom, such as ``(placed part_pcb)``."""
        name = self.predicates[self.predicate(fact)]
        return f"({name} {self.object(fact)})" if argument(fact) else f"({name})"

    def object(self, fact: str) -> str:
        """Return the identifier of the object that a fact is about."""
        return self.objects[self._object(fact)]

    def objects_by_type(self) -> dict[str, list[str]]:
        """Return the identifiers of all objects by that of their type."""
        found: dict[str, list[str]] = {}
        for key in self.objects:
            found.setdefault(self.types[key.partition("/")[0]], []).append(self.objects[key])
        return found

    def _object(self, fact: str) -> str:
        return f"{self._type_of[self.predicate(fact)]}/{argument(fact)}"


def _type(task: Task, predicate: str, arguments: Iterable[str]) -> str:
    """Return what the arguments of a predicate are: a parameter of skills, or places."""
    facts = {fact for fact in task.facts.names if Vocabulary.predicate(fact) == predicate}
    stands = {fact for robot in task.scene.robots for fact in robot.places} | set(task.places)
    if facts <= stands:
        return PLACE
    values: dict[str, set[str]] = {}
    for skill in task.skills:
        for key, value in skill.parameters.items():
            values.setdefault(key, set()).add(value)
    fitting = [key for key, known in values.items() if set(arguments) <= known and "/" not in key]
    return min(fitting, key=lambda key: len(values[key]), default=_UNKNOWN)
