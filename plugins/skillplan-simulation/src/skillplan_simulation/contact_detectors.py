"""Detectors that read the contacts of an execution: base class, and `contact-pairs`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from pydantic import Field

from skillplan.collision.detector import Detector
from skillplan.plugins.installed import PREFERRED, registered
from skillplan.task import back_end
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan_simulation.record import Record
from skillplan_simulation.simulating_engine import SimulatingEngine
from skillplan_simulation.verdicts import DISPLACEMENT_M, FORCE_N, FRAMES, PairLimits, check_pairs


class WindowOptions(back_end.Options):
    """Options of a detector that averages over the last frames."""

    frames: int = Field(
        default=FRAMES,
        ge=1,
        le=60,
        description="number of frames of 1/60 s over which a force is averaged [-]",
    )


class ContactDetector(Detector):
    """Reads the contacts of an engine's execution.

    The engine in use, or one of its own, shares one execution per query with its detectors. The
    engine alone decides about motions that the arm cannot follow and states that do not stand;
    without an engine in use, the detector does.
    """

    # Slightly less than the engine, so that a collision is named before its consequences.
    expected_s = 0.5
    expensive = True

    Options: ClassVar[type[back_end.Options]] = WindowOptions
    # Class of the engine without another engine; default: the installed one.
    engine_alone: ClassVar[type[SimulatingEngine] | None] = None

    def __init__(self, task: Task, options: back_end.Options | None = None) -> None:
        super().__init__(task, options)
        self._engine: SimulatingEngine | None = None
        self._is_alone = True
        # Without an engine, several detectors share the engine of one of them.
        self._lender: ContactDetector = self

    def refuses(self) -> str | None:
        """Refuse a task if the engine refuses it, or if no engine is installed."""
        if self._lender is self and self._engine is None and self._alone() is None:
            known = " or ".join(f"skillplan-{name}" for name in PREFERRED)
            return f"it reads the contacts of an engine that moves bodies: pip install {known}"
        return self.engine.refuses()

    def faults(self) -> Mapping[str, str]:
        """Return the faults that the engine finds."""
        return self.engine.faults()

    def beside(self, others: Sequence[BackEnd]) -> None:
        """Read the execution of the engine among other back ends."""
        engine = next((other for other in others if isinstance(other, SimulatingEngine)), None)
        self._is_alone = engine is None
        lenders = [self, *(other for other in others if isinstance(other, ContactDetector))]
        self._lender = min(lenders, key=lambda lender: lender.name)
        if engine is not None:
            self._engine, self._lender = engine, self

    @property
    def engine(self) -> SimulatingEngine:
        """Engine whose execution is read. Default: a new engine with default options."""
        if self._lender is not self:
            return self._lender.engine
        if self._engine is None:
            engine = self._alone()
            assert engine is not None, "refused: no engine is installed"
            self._engine = engine(self.task)
        return self._engine

    def _alone(self) -> type[SimulatingEngine] | None:
        """Return the class of engine without another engine."""
        return self.engine_alone or _find_installed_engine()

    @property
    def basis(self) -> Mapping[str, Any]:
        """Version and options of the engine, and whether the engine is queried, too."""
        engine = self.engine
        return {
            "engine": engine.name,
            "version": engine.version,
            "options": engine.options.model_dump(mode="json"),
            "basis": dict(engine.basis),
            "alone": self._is_alone,
        }

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict on the contacts of an execution; see :meth:`BackEnd.check`."""
        if skill.motion is None:
            return Verdict.feasible(self.task.facts.none, self.task.facts.none)
        return self.verdict_on(self.engine.record(skill, state))

    def verdict_on(self, record: Record) -> Verdict:
        """Return the verdict on the record of an execution."""
        present, absent = record.present, record.absent
        if record.upset is None and record.unreachable is None and record.unsettled is None:
            return self.contact_verdict(record)
        if not self._is_alone:
            return Verdict.feasible(present, absent)
        if record.upset is not None:
            return Verdict.unknown(record.upset)
        reason = record.unreachable or record.unsettled or ""
        return Verdict.infeasible(reason, present, absent)

    @abstractmethod
    def contact_verdict(self, record: Record) -> Verdict:
        """Return the verdict on the contacts of an execution that ran to its end."""

    @property
    def parts(self) -> frozenset[str]:
        """Names of the task's bodies."""
        return frozenset(body.name for body in self.task.scene.bodies)


def _find_installed_engine() -> type[SimulatingEngine] | None:
    """Return the engine of ``auto``, or else any engine that executes skills."""
    known = {entry.name: entry for entry in registered("physics")}
    first = [name for name in PREFERRED if name in known]
    for name in [*first, *sorted(set(known) - set(first))]:
        engine = known[name].load()
        if isinstance(engine, type) and issubclass(engine, SimulatingEngine):
            return engine
    return None


class ContactPairsDetector(ContactDetector):
    """A verdict on forces between bodies that should not touch, and on bodies pushed aside.

    A skill is infeasible if the normal force of an unexpected pair, averaged over the last frames,
    exceeds the threshold, or if a body that the skill does not handle moves farther than the
    displacement limit at any moment. Expected contacts are the same for every task: bodies that
    touch when the skill begins, the hand and its part, and released or driven parts with their
    surroundings. So a correct execution reads 0 N, and the threshold may be below the friction of
    the lightest part; a part too light for a measurable force shows its displacement.
    """

    name = "contact-pairs"
    version = "2"

    class Options(WindowOptions):
        """Options of the pairs."""

        threshold_n: float = Field(
            default=FORCE_N,
            gt=0,
            le=100,
            description="mean normal force of an unexpected pair that is a collision [N]",
        )
        displacement_m: float = Field(
            default=DISPLACEMENT_M,
            gt=0,
            le=0.1,
            description="displacement of a body that is not handled that is a collision [m]",
        )

    options: Options

    def contact_verdict(self, record: Record) -> Verdict:
        """Return the verdict; its reason is the first pair or displacement."""
        options = self.options
        limits = PairLimits(options.threshold_n, options.displacement_m, options.frames)
        return check_pairs(record, limits, self.parts)
