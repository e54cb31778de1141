"""Expensive back ends for tests: importable, so that other processes can make them, too."""

from __future__ import annotations

import ctypes
import os
import random
import signal
import sys
import time
from pathlib import Path

from pydantic import Field

from skillplan.collision import Detector
from skillplan.physics import Engine
from skillplan.task import Verdict
from skillplan.task import back_end as back_ends


class Options(back_ends.Options):
    """What the fakes are told."""

    log: str = Field(default="", description="a folder in which every check leaves a file")
    seed: int = Field(default=0, description="what the rules are drawn from [-]")
    wait_s: float = Field(default=0.0, description="how long a check takes [s]")
    fail_on: str = Field(default="", description="the skill on which it misbehaves")
    how: str = Field(default="", description="how it misbehaves there")
    once: bool = Field(default=False, description="whether it does so the first time only")


def checks_in(log):
    """Return the checks made, sorted, as (back end, skill, bits, process)."""
    return sorted(tuple(path.name.split(" ")[:4]) for path in Path(log).iterdir())


class _Ruled:
    """Rules drawn at random: a decision list over facts, the same in every process."""

    def check(self, skill, state):
        self._note(skill, state)
        if self.options.wait_s:
            time.sleep(self.options.wait_s)
        if skill.name == self.options.fail_on:
            self._misbehave(skill)
        facts = state.facts
        rng = random.Random(f"{self.name} {self.options.seed} {skill.name}")
        names = [*facts.names]
        rng.shuffle(names)
        seen = facts.none
        # Follows a path of a decision tree: what it rests on is exactly what it looked at.
        for name in names[: rng.randrange(0, 4)]:
            seen |= facts.of(name)
            if name in state and rng.random() < 0.4:
                break
        present, absent = seen & state, seen - state
        luck = random.Random(f"{self.name} {skill.name} {present} {absent}").random()
        evidence = {"luck": luck, "facts": tuple(present)}
        if luck < 0.25:
            return Verdict.infeasible(f"bad luck: {luck}", present, absent, evidence)
        if luck < 0.32:
            return Verdict.unknown("no idea", evidence)
        return Verdict.feasible(present, absent, evidence)

    def _note(self, skill, state):
        if self.options.log:
            count = time.monotonic_ns()
            name = f"{self.name} {skill.name} {state.bits} {os.getpid()} {count}"
            (Path(self.options.log) / name).touch()

    def _misbehave(self, skill):
        created = [item for item in checks_in(self.options.log) if item[1] == skill.name]
        if self.options.once and len(created) > 1:
            return
        if self.options.how == "raise":
            raise RuntimeError("the simulator has gone away")
        if self.options.how == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.options.how == "exit":
            os._exit(7)
        if self.options.how == "hang":
            time.sleep(600)


class ExpensiveEngine(_Ruled, Engine):
    """An expensive engine."""

    name = "expensive-engine"
    expected_s = 0.5
    expensive = True
    Options = Options


class ExpensiveDetector(_Ruled, Detector):
    """An expensive detector, which is queried after the engine."""

    name = "expensive-detector"
    expected_s = 1.0
    expensive = True
    Options = Options


class CheapDetector(_Ruled, Detector):
    """A cheap detector, which is queried first."""

    name = "cheap-detector"
    Options = Options


class TalkingEngine(ExpensiveEngine):
    """Prints to stdout, also as a library in C does."""

    name = "talking-engine"

    def check(self, skill, state):
        """Print and rule."""
        sys.stdout.write("numActiveThreads = 0\n")
        sys.stdout.flush()
        ctypes.CDLL(None).puts(b"pthread_join completed")
        ctypes.CDLL(None).fflush(None)
        sys.stderr.write("to stderr\n")
        return super().check(skill, state)


class StartlessEngine(ExpensiveEngine):
    """Starts in the process in which it was first made only."""

    name = "startless-engine"
    at_home = os.environ.setdefault("SKILLPLAN_TEST_HOME", str(os.getpid())) == str(os.getpid())

    def __init__(self, task, options=None):
        if not self.at_home:
            raise OSError("no licence for a second process")
        super().__init__(task, options)


class SharingDetector(ExpensiveDetector):
    """Reads what the engine beside it remembers, and says so in its evidence."""

    name = "sharing-detector"

    def beside(self, others):
        """Note the others."""
        self.others = [other.name for other in others]

    @property
    def basis(self):
        """What the others are."""
        return {"beside": sorted(getattr(self, "others", ()))}

    def check(self, skill, state):
        """Rule on nothing but who is there."""
        self._note(skill, state)
        return Verdict.feasible(
            state.facts.none, state.facts.none, {"beside": ",".join(self.others)}
        )
