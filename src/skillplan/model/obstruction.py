"""Why no plan exists: what is in the way in every state that can be reached.

After a proof that there is no plan, every verdict on the way is known; what is said here is read
off them, so that back ends whose answers are dear need not be asked again.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict


@dataclass
class _Tries:
    """What became of one skill wherever its precondition held."""

    states: int = 0
    verdicts: Counter[tuple[str, str]] = field(default_factory=Counter)

    def note(self, verdict: Verdict) -> None:
        self.states += 1
        self.verdicts[verdict.stage, verdict.reason] += 1


def obstruction(model: SkillModel, most_states: int = 20_000) -> str | None:
    """Return which skill towards the goal fails in every state that can be reached, and why.

    Parameters
    ----------
    model
        Of a task without a plan; its verdicts should be known.
    most_states
        Larger tasks are not gone through.

    Returns
    -------
    str or None
        None where no single skill is to blame: every one succeeds somewhere, but never in an
        order that leads to the goal; or where there are too many states.
    """
    seen = {model.initial}
    queue = [model.initial]
    tries: dict[str, _Tries] = {}
    succeeded: set[str] = set()
    for state in queue:
        for skill in model.applicable(state):
            verdict = model.verdict(state, skill)
            if not verdict.is_feasible:
                tries.setdefault(skill.name, _Tries()).note(verdict)
                continue
            succeeded.add(skill.name)
            for _, following in model.transition(state, skill).outcomes:
                if following not in seen:
                    seen.add(following)
                    queue.append(following)
        if len(seen) > most_states:
            return None
    blocked = [
        skill
        for skill in model.task.skills
        if skill.name in tries and skill.name not in succeeded and _matters(model, skill, seen)
    ]
    if not blocked:
        return None
    return "; ".join(_sentence(skill, tries[skill.name]) for skill in blocked)


def _matters(model: SkillModel, skill: Skill, seen: set[State]) -> bool:
    """Whether the skill brings about something that is never reached otherwise."""
    gained = [fact for effect in skill.effects for fact in effect.add]
    return any(all(fact not in state for state in seen) for fact in gained)


def _sentence(skill: Skill, tries: _Tries) -> str:
    (stage, reason), count = tries.verdicts.most_common(1)[0]
    where = "the only state" if tries.states == 1 else f"all {tries.states} states"
    often = "" if count == tries.states else f" (in {count} of them)"
    return f"{skill.name} fails in {where} in which it can be tried: {stage}: {reason}{often}"
