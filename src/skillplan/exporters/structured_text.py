"""A plan as a function block in Structured Text of IEC 61131-3, for a PLC."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Final

from skillplan.exporters.exporter import (
    Exporter,
    Handover,
    Identifiers,
    PlannedSkill,
    note_arrivals,
    note_zones,
    quote,
    states_torques,
)

# Default length of texts in controllers.
_LONGEST_TEXT = 80
_ERROR_STEP: Final = -1

_DECLARATIONS = """\
VAR_INPUT
    Execute : BOOL;       // rising: begin; falling: back to the beginning
    Retry : BOOL;         // after an error: do the skill that failed again
    SkillDone : BOOL;     // from the executor: it is done
    SkillError : BOOL;    // from the executor: it has failed
END_VAR
VAR_OUTPUT
    Busy : BOOL;
    Done : BOOL;
    Error : BOOL;
    State : STRING[80] := 'IDLE';      // as PackML names it
    StepNumber : INT := 0;             // 0 idle, 1 to LAST_STEP a skill, beyond it done
    ErrorStep : INT := 0;              // which step has failed
    SkillExecute : BOOL;               // to the executor: begin, and stay until done
    SkillNumber : INT := -1;           // number of the skill in the task file
    SkillName : STRING[80];
    Subject : STRING[80];
    Tool : STRING[80];
    FromPlace : STRING[80];
    ToPlace : STRING[80];
    ExpectedTime : TIME;
{torque}END_VAR
VAR
    Started : BOOL;
END_VAR
"""

_TORQUE = "    Torque : REAL;       // tightening torque of a screw [N m], 0 of other skills\n"

_FRAME = """\
IF NOT Execute THEN
    StepNumber := 0;
    SkillExecute := FALSE;
    Started := FALSE;
END_IF;

CASE StepNumber OF
    0:
        State := 'IDLE';
        IF Execute THEN
            StepNumber := 1;
        END_IF;
{steps}
    {error}:
        State := 'ABORTED';
        IF Retry THEN
            StepNumber := ErrorStep;
        END_IF;
ELSE
    State := 'COMPLETE';
END_CASE;

Busy := StepNumber >= 1 AND StepNumber <= LAST_STEP;
Done := StepNumber > LAST_STEP;
Error := StepNumber = {error};
END_FUNCTION_BLOCK
"""

_STEP = """\
    {number}: // {name}
        State := 'EXECUTE';
        SkillNumber := {action};
        SkillName := '{skill}';
        Subject := '{subject}';
        Tool := '{tool}';
        FromPlace := '{origin}';
        ToPlace := '{destination}';
        ExpectedTime := T#{milliseconds}ms;
{torque}        IF NOT Started THEN
            // The answer to the skill before has to be taken back first.
            IF NOT SkillDone AND NOT SkillError THEN
                SkillExecute := TRUE;
                Started := TRUE;
            END_IF;
        ELSIF SkillError THEN
            SkillExecute := FALSE;
            Started := FALSE;
            ErrorStep := {number};
            StepNumber := {error};
        ELSIF SkillDone THEN
            SkillExecute := FALSE;
            Started := FALSE;
            StepNumber := {following};
        END_IF;
"""


class StructuredTextExporter(Exporter):
    """A function block of IEC 61131-3 that has a PLC step through the plan."""

    name: ClassVar[str] = "st"
    suffix: ClassVar[str] = ".st"

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return that the file holds no times of arrival and no zones."""
        return (*note_arrivals(handover), *note_zones(handover))

    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return the function block."""
        task = handover.task
        block = Identifiers([task.name], prefix="fb_")
        with_torque = states_torques(handover)
        steps = "".join(
            _write_step(skill, number, with_torque=with_torque)
            for number, skill in enumerate(handover.skills, start=1)
        )
        torque = _TORQUE if with_torque else ""
        constant = f"VAR CONSTANT\n    LAST_STEP : INT := {len(handover.skills)};\nEND_VAR\n"
        text = "\n".join(_write_head(handover, block)) + "\n"
        declarations = _DECLARATIONS.format(torque=torque)
        text += f"FUNCTION_BLOCK {block[task.name].upper()}\n{declarations}{constant}\n"
        return {"plan.st": text + _FRAME.format(steps=steps.rstrip("\n"), error=_ERROR_STEP)}


def _write_head(handover: Handover, block: Identifiers) -> Iterator[str]:
    task = handover.task
    cost = sum(skill.step.cost for skill in handover.skills)
    yield f"// Plan of {quote(task.name)}, written by skillplan."
    yield f"// {len(handover.skills)} skills, cost {task.cost_text(cost)}."
    yield "// Handshake: SkillExecute rises and stays; SkillDone or SkillError answers;"
    yield "// SkillExecute falls, and the answer with it. Texts are cut to 80 characters, others"
    yield "// than those of ASCII written as backslash and number; comments have names as they are."
    for line in block.lines():
        yield f"// {line}"


def _write_step(planned: PlannedSkill, number: int, *, with_torque: bool) -> str:
    return _STEP.format(
        number=number,
        following=number + 1,
        error=_ERROR_STEP,
        name=quote(planned.skill.name),
        action=planned.step.action,
        skill=_escape(planned.skill.name),
        subject=_escape(planned.subject),
        tool=_escape(planned.tool),
        origin=_escape(planned.origin),
        destination=_escape(planned.destination),
        milliseconds=round(1000 * planned.step.duration_s),
        torque=f"        Torque := {float(planned.torque_nm or 0.0)};\n" if with_torque else "",
    )


def _escape(name: str) -> str:
    """Return an escaped text of the length that controllers support."""
    plain = name.encode("ascii", "backslashreplace").decode("ascii")[:_LONGEST_TEXT]
    escaped = plain.replace("$", "$$").replace("'", "$'")
    return "".join(c if c.isprintable() else f"${ord(c):02X}" for c in escaped)
