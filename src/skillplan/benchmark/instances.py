"""Instances of the benchmark: package data of every kind of task, with optima and their proofs."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterable, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from skillplan.domains.domain import Name, Strict
from skillplan.errors import OptionError, name_hint
from skillplan.files.json_file import parse_json
from skillplan.files.schema_errors import list_schema_issues
from skillplan.pipeline import registry
from skillplan.pipeline.examples import CONFIG_FOLDERS
from skillplan.pipeline.setup import Setup, load_problem
from skillplan.records import schemas
from skillplan.task.task import Task

PROOF_GAP = 1e-5
"""Gap of cost and bound that counts as a proof, as a fraction: a planner rounds costs."""

# A wheel holds the instances of tests with the other files.
_FOLDERS = (*CONFIG_FOLDERS, CONFIG_FOLDERS[1].parent / "tests" / "instances")


class Proof(Strict):
    """A code that proved the optimum."""

    by: str = Field(description="solver or planner")
    version: str = Field(description="distribution and version")
    method: str = Field(default="", description="method that proved the bound")
    cost: float = Field(ge=0, description="cost that it proved to be least, in the task's unit")
    wall_s: float = Field(ge=0, description="duration [s]")


class Spread(Strict):
    """Results of one learner that differ by the seed alone."""

    agent: str = Field(description="the learner")
    runs: int = Field(ge=2, description="number of seeds")
    solved: float = Field(ge=0, le=1, description="share of the runs with a plan")
    gap: float = Field(ge=0, le=1, description="mean gap to the optimum; 1 without a plan")
    gap_sd: float = Field(ge=0, description="standard deviation of the gap over the runs")
    time_limit_s: float = Field(gt=0, description="time limit of a run [s]")


class Instance(Strict):
    """A task with its proved optimum."""

    name: Name = Field(description="unique name")
    suite: Name = Field(description="suite that it belongs to")
    generate: dict[str, Any] | None = Field(
        default=None, description="parameters of the generator of the kind of task"
    )
    file: str | None = Field(default=None, description="task file of skillplan")
    task: dict[str, Any] | None = Field(default=None, description="content of a task file")
    part: str | None = Field(default=None, description="task of a chain")
    collision: list[str] = Field(default=[], description="detectors; default: the file's choice")
    learning: bool = Field(default=False, description="whether it is a learning task")
    sha256: str = Field(default="", description="hash of the task")
    status: Literal["optimal", "infeasible", "open"] = Field(
        default="open", description="what is proved"
    )
    optimum: float | None = Field(default=None, ge=0, description="least cost")
    unit: str = Field(default="", description="unit of the cost")
    proofs: list[Proof] = Field(default=[], description="codes that proved the optimum")
    noise: list[Spread] = Field(default=[], description="noise floor of a learning task")
    kind: str = Field(default="", description="kind of task", exclude=True)

    @property
    def proof_text(self) -> str:
        """Return who proved the optimum: two codes, or one."""
        names = " and ".join(proof.by for proof in self.proofs)
        return {0: "open", 1: f"one proof: {names}"}.get(len(self.proofs), names)

    @property
    def setup(self) -> Setup:
        """Return the back ends of the instance, which do not depend on the installation."""
        return Setup("kinematic", tuple(self.collision))

    def load(self) -> Task:
        """Return the task.

        Raises
        ------
        OptionError
            If the instance has no source or a missing file, or its task has changed.
        TaskError
            If its task file has faults.
        """
        if [self.generate, self.file, self.task].count(None) != 2:
            raise OptionError(f"{self.name}: give one of the keys generate, file and task.")
        with tempfile.TemporaryDirectory(prefix="skillplan-benchmark-") as folder:
            if self.file is None:
                path = Path(folder) / f"{self.name}.yaml"
                path.write_text(self._text(), encoding="utf-8")
            else:
                path = self._find_file(self.file)
            task = load_problem(path).part(self.part)
        if self.sha256 and task.sha256 != self.sha256:
            raise OptionError(
                f"{self.name}: its task has changed: {task.sha256[:12]} instead of "
                f"{self.sha256[:12]}. Prove it again: skillplan benchmark --prove."
            )
        return task

    def _text(self) -> str:
        if self.generate is None:
            return json.dumps(self.task)
        return registry.InstalledDomains()[self.kind].generate(self.generate)

    def _find_file(self, name: str) -> Path:
        for folder in _FOLDERS:
            if (folder / name).is_file():
                return folder / name
        raise OptionError(f"{self.name}: {name} is not part of this installation.")


class InstanceFile(Strict):
    """The document of one kind of task."""

    document: Literal["skillplan.benchmark-instances/1"] = Field(alias="schema")
    instances: list[Instance] = Field(description="the instances of a kind of task")


def load_instances() -> list[Instance]:
    """Return the instances of all installed kinds of task, by suite and name.

    Raises
    ------
    OptionError
        If the data of a kind are damaged, or two instances have the same name.
    PluginError
        If a kind is broken.
    """
    instances: dict[str, Instance] = {}
    for kind, domain in registry.InstalledDomains().items():
        text = domain.benchmark()
        for instance in () if text is None else parse_instances(text, kind):
            if instance.name in instances:
                raise OptionError(
                    f"Two instances of the benchmark have the name {instance.name!r}: of "
                    f"{instances[instance.name].kind} and {kind}."
                )
            instances[instance.name] = instance
    return list(instances.values())


def parse_instances(text: str, kind: str) -> list[Instance]:
    """Return the instances of a document ``skillplan.benchmark-instances/1``.

    Raises
    ------
    OptionError
        If it is not such a document.
    """
    try:
        document = InstanceFile.model_validate(parse_json(text))
    except ValidationError as error:
        issue = list_schema_issues(error, InstanceFile)[0]
        raise OptionError(f"The benchmark of {kind} is damaged: {issue}") from None
    except ValueError as error:
        raise OptionError(f"The benchmark of {kind} is not JSON: {error}.") from None
    return [each.model_copy(update={"kind": kind}) for each in document.instances]


def format_instances(instances: Iterable[Instance]) -> str:
    """Return the document of instances, one on each line."""
    lines = [
        json.dumps(each.model_dump(mode="json", exclude_defaults=True), allow_nan=False)
        for each in instances
    ]
    head = json.dumps({"schema": schemas.BENCHMARK_INSTANCES})[:-1]
    return f'{head}, "instances": [\n' + ",\n".join(lines) + "\n]}\n"


def choose_instances(
    instances: Sequence[Instance], suites: Sequence[str], pattern: str | None
) -> list[Instance]:
    """Return the instances of some suites, all if none is named, that match a pattern.

    Parameters
    ----------
    pattern
        Shell patterns of names, separated by commas; None for all.

    Raises
    ------
    OptionError
        If a suite is unknown, or no instance matches.
    """
    known = list(dict.fromkeys(each.suite for each in instances))
    for suite in suites:
        if suite not in known:
            raise OptionError(f"No suite {suite!r}. {name_hint(suite, known)}")
    chosen = [each for each in instances if not suites or each.suite in suites]
    if pattern is not None:
        patterns = pattern.split(",")
        chosen = [each for each in chosen if any(fnmatch(each.name, p) for p in patterns)]
        if not chosen:
            names = [each.name for each in instances]
            raise OptionError(f"--only {pattern}: no instance matches. {name_hint(pattern, names)}")
    return chosen


def hash_instances(instances: Iterable[Instance]) -> str:
    """Return the hash of names, tasks and optima, which submissions state."""
    facts = sorted([each.name, each.sha256, each.optimum] for each in instances)
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()
