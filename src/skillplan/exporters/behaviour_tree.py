"""A plan as a behaviour tree in the XML of BehaviorTree.CPP, version 4.

Each skill is a subtree of its kind. It succeeds at once if the skill is done. Otherwise it checks
the precondition, executes the skill and checks the postcondition, with a recovery after every
failure and a limited number of attempts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from html import escape
from typing import ClassVar

from pydantic import Field

from skillplan.exporters.exporter import (
    Exporter,
    Handover,
    Identifiers,
    PlannedSkill,
    format_decimal,
    note_arrivals,
    note_zones,
    quote,
    states_torques,
)
from skillplan.task import back_end

# Characters that XML cannot hold, that attributes turn into blanks, or that would name an entry of
# the blackboard.
_UNSAID = re.compile(r"[\\{\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufffe\uffff]")
_WRITTEN = re.compile(r"\\u([0-9a-f]{4})")

PORTS = {
    "skill": "name of the skill in the task file",
    "subject": "object of the skill, such as a part",
    "tool": "tool that it uses",
    "from_place": "place of the robot before",
    "to_place": "place of the robot afterwards",
    "requires": "facts that must hold before, separated by semicolons",
    "forbids": "facts that must not hold before",
    "achieves": "facts that hold afterwards",
    "ends": "facts that do not hold afterwards",
    "cost": "cost in the task's unit",
    "duration_s": "duration [s]",
}
# Port of a plan with screws whose torque is stated.
_TORQUE_PORT = {"torque_nm": "tightening torque of a screw [N m]"}

_SKILL_TREE = """\
  <BehaviorTree ID="{tree}">
    <Fallback>
      <SkillDone/>
      <RetryUntilSuccessful num_attempts="{attempts}">
        <Sequence>
          <SkillApplicable/>
          <Fallback>
            <Sequence>
              <Execute_{tree}/>
              <SkillDone/>
            </Sequence>
            <ForceFailure>
              <Recover_{tree}/>
            </ForceFailure>
          </Fallback>
        </Sequence>
      </RetryUntilSuccessful>
    </Fallback>
  </BehaviorTree>
"""


class BehaviourTreeExporter(Exporter):
    """A behaviour tree for BehaviorTree.CPP 4 and Groot, with retries and recovery a skill."""

    name: ClassVar[str] = "btcpp"
    suffix: ClassVar[str] = ".xml"

    class Options(back_end.Options):
        """Options of behaviour trees."""

        attempts: int = Field(
            default=2, ge=1, le=100, description="number of attempts at a skill [-]"
        )

    options: Options

    def refuses(self, handover: Handover) -> str | None:
        """Refuse chance after which a skill cannot be tried again."""
        for skill in handover.skills:
            for outcome in skill.skill.outcomes_in(skill.before)[1:]:
                if not skill.skill.applicable(outcome.apply(skill.before)):
                    return (
                        f"after {skill.skill.name} has failed by chance it cannot be tried again, "
                        "and the tree follows planned plan. Take the chance out of the task file"
                    )
        return None

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return that failed skills are tried again, and that zones are left out."""
        zones = (*note_arrivals(handover), *note_zones(handover))
        if not handover.chance:
            return zones
        return (f"a skill that fails by chance is tried {self.options.attempts} times", *zones)

    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return the tree with the models of its nodes."""
        kinds = dict.fromkeys(planned.skill.kind for planned in handover.skills)
        trees = Identifiers(kinds, {"plan"})
        names = Identifiers(dict.fromkeys(planned.skill.name for planned in handover.skills))
        lines = ['<?xml version="1.0" encoding="UTF-8"?>', *_write_head(handover)]
        lines.append('<root BTCPP_format="4" main_tree_to_execute="plan">')
        lines.append('  <BehaviorTree ID="plan">\n    <Sequence>')
        for skill in handover.skills:
            given = " ".join(
                f'{key}="{escape(value)}"'
                for key, value in (_list_ports(skill) | _list_torque(skill, handover)).items()
            )
            tree, name = trees[skill.skill.kind], names[skill.skill.name]
            lines.append(f'      <SubTree ID="{tree}" name="{name}" {given}/>')
        lines.append("    </Sequence>\n  </BehaviorTree>")
        text = "\n".join(lines) + "\n"
        for kind in kinds:
            text += _SKILL_TREE.format(tree=trees[kind], attempts=self.options.attempts)
        ports = PORTS | (_TORQUE_PORT if states_torques(handover) else {})
        models = "\n".join(_write_models([trees[kind] for kind in kinds], ports))
        return {"plan.xml": f"{text}  <TreeNodesModel>\n{models}\n  </TreeNodesModel>\n</root>\n"}


def escape_text(name: str) -> str:
    """Return a text for an attribute, with escapes for characters that XML cannot hold."""
    return _UNSAID.sub(lambda match: f"\\u{ord(match[0]):04x}", name)


def unescape_text(text: str) -> str:
    """Return the text that `escape_text` was given."""
    return _WRITTEN.sub(lambda match: chr(int(match[1], 16)), text)


def _write_head(handover: Handover) -> Iterator[str]:
    task = handover.task
    cost = sum(skill.step.cost for skill in handover.skills)
    # Two hyphens would end the comment.
    name = quote(task.name).replace("-", "\\u002d") if "--" in task.name else quote(task.name)
    yield f"<!-- Plan of {name}, written by skillplan."
    yield f"     {len(handover.skills)} skills, cost {task.cost_text(cost)}. Nodes to register: the"
    yield "     actions Execute_KIND and Recover_KIND, and the conditions SkillApplicable and"
    yield "     SkillDone; each finds its ports in the blackboard of its subtree. -->"


def _list_ports(planned: PlannedSkill) -> dict[str, str]:
    condition, outcome = (
        planned.skill.condition(planned.before),
        planned.skill.prediction_in(planned.before),
    )
    # Only facts that held before can be seen to end.
    ended = outcome.delete & planned.before
    values = (
        planned.skill.name,
        planned.subject,
        planned.tool,
        planned.origin,
        planned.destination,
        ";".join(condition.requires),
        ";".join(condition.forbids),
        ";".join(outcome.add),
        ";".join(ended),
        format_decimal(planned.step.cost),
        format_decimal(planned.step.duration_s),
    )
    return dict(zip(PORTS, map(escape_text, values), strict=True))


def _list_torque(planned: PlannedSkill, handover: Handover) -> dict[str, str]:
    """Return the torque of a skill, empty where it has none; no port if no skill has one."""
    if not states_torques(handover):
        return {}
    torque_nm = planned.torque_nm
    return {"torque_nm": "" if torque_nm is None else format_decimal(torque_nm)}


def _write_models(trees: list[str], ports: Mapping[str, str]) -> Iterator[str]:
    for tree in trees:
        yield from _write_model("SubTree", tree, ports, defaults=False)
        yield from _write_model("Action", f"Execute_{tree}", ports)
        yield from _write_model("Action", f"Recover_{tree}", ports)
    for name in ("SkillApplicable", "SkillDone"):
        yield from _write_model("Condition", name, ports)


def _write_model(
    kind: str, name: str, ports: Mapping[str, str], *, defaults: bool = True
) -> Iterator[str]:
    yield f'    <{kind} ID="{name}">'
    for port, meaning in ports.items():
        default = f' default="{{{port}}}"' if defaults else ""
        yield f'      <input_port name="{port}" type="std::string"{default}>{meaning}</input_port>'
    yield f"    </{kind}>"
