"""Try a written task: whether `check` accepts it, and whether the arm can bring every part."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import ValidationError

from skillplan.chart import Conflict, HypotheticalStates, find_order
from skillplan.checks import Feasibility
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain, MeshConfig
from skillplan.errors import Issue
from skillplan.files.schema_errors import list_schema_issues
from skillplan.model import SkillModel
from skillplan.model.replay import replay
from skillplan.pipeline import Setup, make_feasibility, names
from skillplan.task import Skill, State, Task, Verdict
from skillplan_cad.planning.watch import Watch
from skillplan_cad.writing.verdict_memory import VerdictMemory, describe_motion

SWEPT = "swept"
# Paths between motions are checked once an order is found.
_WITHOUT_TRAVELS = Setup(collision=(SWEPT,), options={SWEPT: {"check_travel": False}})
# Words of reasons for which a part does not stay.
_FALLS = (
    "would tip off",
    "has nothing beneath it",
    "' tips towards",
    "' slides towards",
    "' falls",
)
# Shares of the time limit after which no part gets another tool, and at which trials end, so that
# an order of what passed is found.
_RETOOLED_SHARE, _TRIED_SHARE = 0.5, 0.65
# Shares at which the search for an order ends, that for an order of parts that had one before, and
# its check with all paths: a task with the parts up to there is checked in the time that is left.
_SEARCHED_SHARE, _ORDERED_SHARES, _REPLAYED_SHARES = 0.85, (0.87, 0.92), (0.9, 0.95)
# Words of reasons for which a hand has no room.
_HAND_WORDS = ("a finger runs into", "the hand runs into")
# Words of reasons for which an arm does not get to a place, the second half of one included.
_ARM_WORDS = ("the hand cannot point", "of the arm runs into", "the nearest one is")
# Kinds of skills that bring a part or drive a screw, in order.
_KINDS = ("pick", "place", "fasten")


@dataclass(frozen=True, slots=True)
class Failure:
    """Why the arm cannot bring a part or drive a screw.

    Parameters
    ----------
    text
        The skill and the reason, as a clause.
    is_far
        True if a place is out of the arm's reach.
    is_blocked
        True if the part itself is in the way, whichever tool brings it.
    falls
        True if the part does not stay where it is put, unless something holds it.
    """

    text: str
    is_far: bool
    is_blocked: bool = False
    falls: bool = False

    @property
    def is_by_fingers(self) -> bool:
        """True if fingers meet another part with every grasp, so thicker ones do, too."""
        return _has_each(self.text, ("a finger runs into",))

    @property
    def is_by_hand(self) -> bool:
        """True if fingers or hand meet another part with every grasp, so longer ones may not."""
        return _has_each(self.text, _HAND_WORDS)

    @property
    def is_by_arm(self) -> bool:
        """True if the arm does not get to any grasp, so no longer hand does, either."""
        return _has_each(self.text, _ARM_WORDS)


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
    untried
        Parts and screws that a request to stop came before.
    unordered
        Parts and screws in no order that was found before the limits of time or checks.
    conflicts
        Reasons why parts and screws are in no order of all, by name; searched if nothing fails.
    skills
        Skills that bring everything in the order that was found; empty if none was.
    doubt
        Reason why the order is not sure; empty without one.
    is_misled
        True if a skill of the order that was found fails without paths, too, so kept verdicts
        do not hold.
    """

    refusals: Mapping[str, str] = field(default_factory=dict)
    failures: Mapping[str, Failure] = field(default_factory=dict)
    untried: tuple[str, ...] = ()
    unordered: tuple[str, ...] = ()
    conflicts: Mapping[str, Conflict] = field(default_factory=dict)
    skills: tuple[str, ...] = ()
    doubt: str = ""
    is_misled: bool = False


class TaskTrials:
    """Tries the tasks of a product, each with fewer parts or other tools than the one before.

    Parameters
    ----------
    watch
        Progress reports, and requests to stop.

    Attributes
    ----------
    is_late
        True once no more parts and screws are tried, as the time is for their order.
    granted
        Parts and screws that need no further trial.
    """

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._folder = TemporaryDirectory(prefix="skillplan-cad-")
        self._contents: dict[str, str] = {}
        # Meshes by their entries; a file that changes is read anew.
        self._meshes: dict[str, tuple[Mapping[str, Any], MeshConfig]] = {}
        self.granted: set[str] = set()
        # How the arm moved in the trials that were passed.
        self._moved: dict[str, tuple[object, ...]] = {}
        self.is_late = False
        # The order found last, if only of some parts of the task.
        self._found: tuple[str, ...] = ()
        # Verdicts without and with the paths between motions.
        self._known, self._known_whole = VerdictMemory(), VerdictMemory()
        # True once an order lost its end to the time.
        self._is_cut = False
        # False if verdicts of another layout were taken over that may not hold.
        self._is_sure = True

    def __enter__(self) -> TaskTrials:
        return self

    def __exit__(self, *error: object) -> None:
        self._folder.cleanup()

    @property
    def is_hurried(self) -> bool:
        """True once parts are left out rather than tried with further tools."""
        return self.is_late or self._is_over(_RETOOLED_SHARE)

    def renew(self) -> None:
        """Try parts in the first part of the time that is left, in the order of the plan."""
        self._watch.renew()
        self.is_late, self._is_cut, self._found = False, False, ()

    def forget(self, *names: str) -> None:
        """Try parts and screws again."""
        self.granted -= {*names}

    def try_task(
        self,
        document: Mapping[str, Any],
        files: Mapping[str, str],
        order: Sequence[str],
        doubtful: Collection[str] = (),
        known: Collection[str] = (),
        is_final: Callable[[Failure], bool] = lambda failure: False,
    ) -> Trial:
        """Check a task, try each pick, place and fastening when its turn comes, and find an order.

        Parameters
        ----------
        document
            Content of the task file.
        files
            Contents of the mesh files by their path within the folder.
        order
            Names of parts and screws in the order of the plan.
        doubtful
            Names that are tried before all others; if one fails, the others are not tried.
        known
            Names with an order of their own.
        is_final
            Returns True for a failure after which nothing else is tried.
        """
        config = self._check(document, files)
        if isinstance(config, Trial):
            return config
        (task,) = AssemblyDomain().ground(config, "")
        feasibility = make_feasibility(task, _WITHOUT_TRAVELS)
        self._is_sure = self._known.recall(feasibility, boldly=True) and self._is_sure
        try:
            first = [name for name in order if name in doubtful]
            failures: dict[str, Failure] = {}
            for chosen in (first, order):
                for name, failure in self._try_skills(feasibility, config, order, chosen):
                    failures[name] = failure
                    if is_final(failure):
                        return Trial(failures=failures)
                if chosen is first and failures and not self._watch.must_stop():
                    return Trial(failures=failures)
            if not failures and not self.is_late:
                # Later, the order tells which are out of reach.
                self._forget_far(feasibility, config)
                failures |= self._try_skills(feasibility, config, order, order)
            left = [name for name in (*config.parts, *config.screws) if name not in self.granted]
            untried = tuple(
                name
                for name in left
                if name not in failures and not (name in config.parts and config.parts[name].fixed)
            )
            if failures or untried:
                return Trial(failures=failures, untried=untried)
            faults = _list_engine_faults(task, config)
            if faults:
                return Trial(faults)
            trial = self._find_order(task, config, feasibility, order, known)
            if trial.is_misled and not self._watch.must_stop():
                feasibility.close()
                feasibility, self._is_sure = make_feasibility(task, _WITHOUT_TRAVELS), True
                trial = self._find_order(task, config, feasibility, order, known)
            return trial
        finally:
            self._known.keep(feasibility)
            feasibility.close()

    def confirm(
        self, document: Mapping[str, Any], files: Mapping[str, str], order: Sequence[str]
    ) -> Trial:
        """Check a task, and all skills and paths of one order of it; the trial has no others."""
        config = self._check(document, files)
        if isinstance(config, Trial):
            return config
        (task,) = AssemblyDomain().ground(config, "")
        faults = _list_engine_faults(task, config)
        if faults:
            return Trial(faults)
        self._watch.report(f"writing: checking an order with sub-assemblies, {len(order)} parts")
        states = HypotheticalStates(task)
        state, skills = task.initial, list[Skill]()
        for name in order:
            state, more = states.bring(state, name)
            skills += more
        whole = make_feasibility(task, Setup(collision=(SWEPT,)))
        try:
            return _replay(whole, skills)
        finally:
            whole.close()

    def _check(
        self, document: Mapping[str, Any], files: Mapping[str, str]
    ) -> AssemblyConfig | Trial:
        """Return the configuration of a task, or the trial of one that nothing further can try."""
        folder = Path(self._folder.name)
        changed = {name for name, text in files.items() if self._contents.get(name) != text}
        for name in changed:
            path = folder / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(files[name], "utf-8")
            self._contents[name] = files[name]
        domain = AssemblyDomain()
        known = self._use_known_meshes(document, changed)
        try:
            config = domain.Config.model_validate(known, context={"folder": folder})
        except ValidationError as error:
            return _sort_issues(list_schema_issues(error, domain.Config))
        self._keep_meshes(document, config)
        trial = _sort_issues(domain.issues(config))
        is_refused = trial.refusals or trial.failures
        return trial if is_refused or SWEPT not in names("collision") else config

    def _forget_far(self, feasibility: Feasibility, config: AssemblyConfig) -> None:
        """Forget the parts that are out of reach now, as the table is laid out anew."""
        task = feasibility.task
        skills = {skill.name: skill for skill in task.skills}
        for name in sorted(self.granted):
            motions = _list_motions(task, name)
            if self._moved.get(name) == motions:
                continue
            if name in config.parts or name in config.screws:
                turn = _list_facts(task, config, _list_supports(config, name), name)
                if _try_one(feasibility, skills, turn, name) is None:
                    self._moved[name] = motions
                else:
                    self.granted.discard(name)

    def _use_known_meshes(
        self, document: Mapping[str, Any], changed: Iterable[str]
    ) -> dict[str, Any]:
        """Return the document with the meshes that were read before in the place of their files."""
        parts = {}
        for name, entry in document["parts"].items():
            if "meshes" not in entry:
                # Its members give the shape of a sub-assembly.
                parts[name] = entry
                continue
            meshes = []
            for mesh in entry["meshes"]:
                known = self._meshes.get(mesh["file"])
                is_same = known is not None and known[0] == mesh
                if known is None or not is_same or {mesh["file"], mesh.get("pieces")} & {*changed}:
                    meshes.append(mesh)
                else:
                    meshes.append(known[1])
            parts[name] = {**entry, "meshes": meshes}
        return {**document, "parts": parts}

    def _keep_meshes(self, document: Mapping[str, Any], config: AssemblyConfig) -> None:
        for name, part in config.parts.items():
            entries = document["parts"][name].get("meshes")
            if entries is None:
                continue
            for entry, mesh in zip(entries, part.meshes or (), strict=True):
                self._meshes[entry["file"]] = (dict(entry), mesh)

    def _try_skills(
        self,
        feasibility: Feasibility,
        config: AssemblyConfig,
        order: Sequence[str],
        chosen: Sequence[str],
    ) -> Iterator[tuple[str, Failure]]:
        """Yield the chosen parts and screws that the arm cannot bring, each with the reason."""
        task = feasibility.task
        skills = {skill.name: skill for skill in task.skills}
        for name in chosen:
            number = order.index(name)
            if name in self.granted or (name in config.parts and config.parts[name].fixed):
                continue
            if self._watch.must_stop():
                return
            self._watch.report(f"writing: trying {name}, {number + 1} of {len(order)} parts")
            there = _list_facts(task, config, order[:number], name)
            alone = _list_facts(task, config, _list_supports(config, name), name)
            attempted = self._watch.attempt(
                partial(_try_both, feasibility, skills, (there, alone), name), _TRIED_SHARE
            )
            if attempted is None:
                self.is_late = True
                return
            for failure in attempted:
                yield name, failure
            if not attempted:
                self.granted.add(name)
                self._moved[name] = _list_motions(task, name)

    def _find_order(
        self,
        task: Task,
        config: AssemblyConfig,
        feasibility: Feasibility,
        preferred: Sequence[str],
        known: Collection[str],
    ) -> Trial:
        """Return the order of the whole task, or the parts that are in none."""
        needs: dict[str, Collection[str]] = {
            name: part.goal_on or () for name, part in config.parts.items()
        }
        needs |= {name: (screw.through,) for name, screw in config.screws.items()}
        # What a support of its own holds needs no other part beneath it.
        needs |= dict.fromkeys((n for h in config.holders.values() for n in h.parts), ())
        self._watch.report(f"writing: finding an order of {len(task.operations)} parts")
        first = [name for name in self._found if name in task.operations]
        listed = [*first, *(name for name in preferred if name not in first)]
        must_stop = self._must_end_search
        if must_stop() and len(first) == len(task.operations):
            # Most of it was checked with more parts.
            must_stop = partial(self._is_over, _ORDERED_SHARES[self._is_cut])
        order = find_order(task, feasibility, listed, needs, must_stop, kept=known)
        missing = [name for name in task.operations if name not in order.parts]
        self._found = order.parts or self._found
        if order.parts and missing and not order.ended:
            self._is_cut = must_stop != self._must_end_search
            unordered = tuple(name for name in missing if name not in order.conflicts)
            return Trial(conflicts=order.conflicts, unordered=unordered)
        if order.conflicts:
            return Trial(conflicts=order.conflicts)
        if not order.ended:
            if len(first) == len(task.operations):
                return Trial(doubt="its order was found with more parts, and not checked again")
            return Trial(doubt="no order was found in the time or number of checks")
        # With the paths between motions, from the place where the arm is then.
        whole = make_feasibility(task, Setup(collision=(SWEPT,)), feasibility.cache)
        for back_end, other in zip(whole.back_ends, feasibility.back_ends, strict=True):
            back_end.take_over(other)
        self._known_whole.recall(whole)
        try:
            return self._bring_all(whole, order.skills) or _replay(whole, order.skills)
        finally:
            self._known_whole.keep(whole)
            whole.close()

    def _must_end_search(self) -> bool:
        return self._watch.must_stop() or self._is_over(_SEARCHED_SHARE)

    def _is_over(self, share: float) -> bool:
        return self._watch.attempt(lambda: True, share) is None

    def _bring_all(self, feasibility: Feasibility, skills: Sequence[Skill]) -> Trial | None:
        """Return the trial of an order that is refused or not checked to its end, or None."""
        task = feasibility.task
        state = task.initial
        for number, skill in enumerate(skills):
            check = partial(feasibility.verdict, skill, state)
            left = {fact: name for name, fact in task.operations.items() if fact not in state}
            # A task without a checked order is worth more than few of its parts.
            is_half = 2 * len(left) <= len(task.operations)
            share = _REPLAYED_SHARES[self._is_cut or not is_half]
            verdict = self._watch.attempt(check, share)
            if verdict is None and not is_half:
                return Trial(doubt="its paths were not checked in the time")
            if verdict is None:
                self._is_cut = True
                return Trial(unordered=tuple(left.values()))
            if not verdict.is_feasible:
                ahead = [fact for later in skills[number:] for fact in later.prediction.add]
                failed = next((left[fact] for fact in ahead if fact in left), None)
                if skill.kind == "turn" or failed is None:
                    return None
                words = f"fails in the order that was found: {skill.kind}: {verdict.reason}"
                conflict = Conflict(words, (), failed, is_by_hand=False)
                is_misled = not self._is_sure and not _is_feasible_anew(skill, state, task)
                return Trial(conflicts={failed: conflict}, is_misled=is_misled)
            state = skill.prediction_in(state).apply(state)
        return None


def _is_feasible_anew(skill: Skill, state: State, task: Task) -> bool:
    """Return whether a skill is feasible without paths, whatever verdicts were kept."""
    feasibility = make_feasibility(task, _WITHOUT_TRAVELS)
    try:
        return feasibility.verdict(skill, state).is_feasible
    finally:
        feasibility.close()


def list_brought(skills: Iterable[str]) -> list[str]:
    """Return the parts and screws of skills that place or fasten, in order."""
    matches = (re.fullmatch(r"(?:place|fasten)\(([^.)]+).*\)", skill) for skill in skills)
    return [match.group(1) for match in matches if match]


def _replay(feasibility: Feasibility, skills: Sequence[Skill]) -> Trial:
    """Return the trial of an order with all paths between motions."""
    again = replay(SkillModel(feasibility), tuple(skills))
    if again.feasible and again.complete:
        return Trial(skills=tuple(skill.name for skill in skills))
    fault = again.violations[0]
    return Trial(doubt=f"{fault.skill or 'the end'} fails in it: {fault.reason}")


def _list_engine_faults(task: Task, config: AssemblyConfig) -> dict[str, str]:
    """Return why installed engines refuse parts, such as fits that their pieces block."""
    faults: dict[str, str] = {}
    for engine in names("physics"):
        for back_end in Setup(engine, ()).back_ends(task):
            for fact, words in back_end.faults().items():
                part = next((name for name in config.parts if fact == f"placed({name})"), "")
                faults.setdefault(part, f"{engine} refuses it: {words}")
    return faults


def _sort_issues(issues: Iterable[Issue]) -> Trial:
    """Return the trial of a refused task; another grasp may do where one is refused."""
    refusals, failures = dict[str, str](), dict[str, Failure]()
    for issue in issues:
        kind, name, key, *_ = (*map(str, issue.path), "", "", "")
        if kind == "parts" and key == "grasp":
            failures.setdefault(name, Failure(issue.message, is_far=False))
        else:
            refusals.setdefault(name if kind in ("parts", "screws") else "", issue.message)
    return Trial(refusals, failures)


def _list_supports(config: AssemblyConfig, name: str) -> list[str]:
    """Return the parts and screws that must be in place before a part or screw."""
    supports = _list_earlier(config, name)
    if name in config.screws:
        return [*supports, config.screws[name].through]
    waiting = [name]
    while waiting:
        for other in config.parts[waiting.pop()].goal_on or ():
            if other in config.parts and other not in supports:
                supports.append(other)
                waiting.append(other)
    return supports


def _list_earlier(config: AssemblyConfig, name: str) -> list[str]:
    """Return the parts and screws that go in before the turn to the orientation of one."""
    goes_in = {part: entry.orientation for part, entry in config.parts.items()}
    goes_in |= {screw: entry.orientation for screw, entry in config.screws.items()}
    for workholder in config.workholders.values():
        names, own = [*workholder.orientations], goes_in[name]
        if workholder.in_order and own in names:
            earlier = names[: names.index(own)]
            return [other for other, orientation in goes_in.items() if orientation in earlier]
    return []


def _list_motions(task: Task, name: str) -> tuple[object, ...]:
    """Return the arm, and the skills that bring a part or drive a screw, with their tools."""
    starts = tuple(f"{kind}({name}{end}" for kind in _KINDS for end in (")", "."))
    own = [skill for skill in task.skills if skill.name.startswith(starts)]
    names = {skill.parameters.get("tool") for skill in own}
    arms = (
        replace(robot, places={}, tools=tuple(tool for tool in robot.tools if tool.name in names))
        for robot in task.scene.robots
    )
    return (*arms, *map(describe_motion, own))


def _list_facts(task: Task, config: AssemblyConfig, before: Sequence[str], name: str) -> set[str]:
    """Return the facts that hold when a part's turn comes, with the hand over the home place."""
    owner = config.parts[name] if name in config.parts else config.screws[name]
    facts = {f"tool({owner.tool})", "hand_free", "at(home)", "fixed"}
    for part, entry in config.parts.items():
        placed = entry.fixed or part in before
        facts.add(f"placed({part})" if placed else f"at_start({part})")
    facts |= {f"fastened({screw})" for screw in config.screws if screw in before}
    facts |= {fact for fact in task.initial if fact.startswith(("holds(", "turned("))}
    turned = find_turned(config, owner.orientation)
    if turned is not None:
        others = {fact for fact in facts if fact.startswith(f"{turned.partition('.')[0]}.")}
        facts = facts - others | {turned}
    return facts & set(task.facts.names)


def find_turned(config: AssemblyConfig, orientation: str | None) -> str | None:
    """Return the fact of an orientation; None without one."""
    for name, workholder in config.workholders.items():
        if orientation in workholder.orientations:
            return f"turned({name}.{orientation})"
    return None


def _try_both(
    feasibility: Feasibility, skills: Mapping[str, Skill], states: Iterable[set[str]], name: str
) -> list[Failure]:
    """Return why the arm cannot bring a part in the last of some states; empty if it can in one."""
    failures = []
    for facts in states:
        failure = _try_one(feasibility, skills, facts, name)
        if failure is None:
            return []
        failures = [failure]
    return failures


def _try_one(
    feasibility: Feasibility, skills: Mapping[str, Skill], facts: set[str], name: str
) -> Failure | None:
    """Return why the arm cannot bring a part or drive a screw, or None."""
    state: State = feasibility.task.facts.of(*facts)
    labels = [f".{fact.rpartition('.')[2][:-1]}" for fact in facts if fact.startswith("turned(")]
    names = [f"{kind}({name}{label})" for kind in _KINDS for label in ("", *labels)]
    chain = [skills[skill_name] for skill_name in names if skill_name in skills]
    if chain[0].kind == "pick" and chain[0].applicable(state):
        # Without paths of the arm for each grasp, which take a hundred times as long.
        place, held = chain[1], chain[0].prediction.apply(state)
        refusal = feasibility.refuse_early(place, held) if place.applicable(held) else None
        if refusal is not None:
            return _describe(refusal, "place", name)
    for skill in chain:
        kind = skill.kind
        if not skill.applicable(state):
            # A part on another at the start comes later.
            return None
        verdict = feasibility.verdict(skill, state)
        if not verdict.is_feasible:
            return _describe(verdict, kind, name)
        state = skill.prediction.apply(state)
    return None


def _describe(verdict: Verdict, kind: str, name: str) -> Failure:
    """Return why a skill that brings a part is refused."""
    ways: Mapping[str, str] = verdict.evidence.get("ways", {"": verdict.reason})
    return Failure(
        f"{kind}: {verdict.reason}",
        "missed_by_m" in verdict.evidence
        or all("the hand cannot point" in reason for reason in ways.values()),
        all(
            f"{name} runs into" in reason and "insertion" not in reason for reason in ways.values()
        ),
        tells_fall("; ".join(ways.values())),
    )


def tells_fall(text: str) -> bool:
    """Return whether all reasons in a text, separated by semicolons, are that a part falls."""
    return _has_each(text, _FALLS)


def _has_each(text: str, options: Sequence[str]) -> bool:
    """Return whether each clause of a text, separated by semicolons, has one of some words."""
    return all(any(words in clause for words in options) for clause in text.split("; "))
