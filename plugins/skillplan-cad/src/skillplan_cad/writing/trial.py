"""Try a written task: whether `check` accepts it, and whether the arm can bring every part."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import ValidationError

from skillplan.checks import Feasibility
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain
from skillplan.errors import Issue
from skillplan.files.schema_errors import list_schema_issues
from skillplan.pipeline import Setup, make_feasibility, names
from skillplan.task import Skill, State, Task

SWEPT = "swept"


@dataclass(frozen=True, slots=True)
class Failure:
    """Why the arm cannot bring a part or drive a screw.

    Parameters
    ----------
    text
        The skill and the reason, as a clause.
    is_far
        True if a place is out of the arm's reach.
    """

    text: str
    is_far: bool


@dataclass(frozen=True, slots=True)
class Trial:
    """Outcome of a trial of a task.

    Parameters
    ----------
    refusals
        Reasons why `check` refuses the task, by names of parts and screws. Reasons that concern no
        part have an empty name.
    failures
        Reasons why the arm cannot bring a part or drive a screw, by name.
    """

    refusals: Mapping[str, str]
    failures: Mapping[str, Failure]


def try_task(
    document: Mapping[str, Any],
    files: Mapping[str, str],
    order: Sequence[str],
    granted: set[str],
) -> Trial:
    """Check a task, and try each pick, place and fastening when its turn comes.

    Parameters
    ----------
    document
        Content of the task file.
    files
        Contents of the mesh files by their path within the folder.
    order
        Names of parts and screws in the order of the plan.
    granted
        Parts and screws that need no trial; those that pass are added.
    """
    with TemporaryDirectory(prefix="skillplan-cad-") as folder:
        for name, content in files.items():
            path = Path(folder, name)
            path.parent.mkdir(exist_ok=True)
            path.write_text(content, "utf-8")
        domain = AssemblyDomain()
        try:
            config = domain.Config.model_validate(document, context={"folder": Path(folder)})
        except ValidationError as error:
            return Trial(_sort_issues(list_schema_issues(error, domain.Config)), {})
        refusals = _sort_issues(domain.issues(config))
        if refusals or SWEPT not in names("collision"):
            return Trial(refusals, {})
        (task,) = domain.ground(config, "")
    return Trial({}, dict(_try_skills(task, config, order, granted)))


def _sort_issues(issues: Iterable[Issue]) -> dict[str, str]:
    reasons: dict[str, str] = {}
    for issue in issues:
        of_part = len(issue.path) > 1 and issue.path[0] in ("parts", "screws")
        reasons.setdefault(str(issue.path[1]) if of_part else "", issue.message)
    return reasons


def _try_skills(
    task: Task, config: AssemblyConfig, order: Sequence[str], granted: set[str]
) -> Iterator[tuple[str, Failure]]:
    """Yield the parts and screws that the arm cannot bring, each with the reason."""
    # Paths between motions are left to the search.
    setup = Setup(collision=(SWEPT,), options={SWEPT: {"check_travel": False}})
    feasibility = make_feasibility(task, setup)
    skills = {skill.name: skill for skill in task.skills}
    try:
        for number, name in enumerate(order):
            if name in granted or (name in config.parts and config.parts[name].fixed):
                continue
            turn = _list_facts(task, config, order[:number], name)
            failure = _try_one(feasibility, skills, task, turn, name)
            if failure is not None:
                alone = _list_facts(task, config, _list_supports(config, name), name)
                failure = _try_one(feasibility, skills, task, alone, name)
            if failure is None:
                granted.add(name)
            else:
                yield name, failure
    finally:
        feasibility.close()


def _list_supports(config: AssemblyConfig, name: str) -> list[str]:
    """Return the parts that must be in place before a part or screw."""
    if name in config.screws:
        return [config.screws[name].through]
    supports: list[str] = []
    waiting = [name]
    while waiting:
        for other in config.parts[waiting.pop()].goal_on or ():
            if other not in supports:
                supports.append(other)
                waiting.append(other)
    return supports


def _list_facts(task: Task, config: AssemblyConfig, before: Sequence[str], name: str) -> set[str]:
    """Return the facts that hold when a part's turn comes, with the hand over the home place."""
    owner = config.parts[name] if name in config.parts else config.screws[name]
    facts = {f"tool({owner.tool})", "hand_free", "at(home)"}
    for part, entry in config.parts.items():
        placed = entry.fixed or part in before
        facts.add(f"placed({part})" if placed else f"at_start({part})")
    facts |= {f"fastened({screw})" for screw in config.screws if screw in before}
    return facts & set(task.facts.names)


def _try_one(
    feasibility: Feasibility,
    skills: Mapping[str, Skill],
    task: Task,
    facts: set[str],
    name: str,
) -> Failure | None:
    """Return why the arm cannot bring a part or drive a screw, or None."""
    state: State = task.facts.of(*facts)
    kinds = ("fasten",) if f"fasten({name})" in skills else ("pick", "place")
    for kind in kinds:
        skill = skills[f"{kind}({name})"]
        if not skill.applicable(state):
            # A part on another at the start comes later.
            return None
        verdict = feasibility.verdict(skill, state)
        if not verdict.is_feasible:
            return Failure(f"{kind}: {verdict.reason}", "missed_by_m" in verdict.evidence)
        state = skill.prediction.apply(state)
    return None
