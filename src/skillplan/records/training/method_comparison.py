"""Methods side by side: scores, performance profiles, probabilities of improvement.

Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice" (2021).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from skillplan.records import schemas
from skillplan.records.interval import (
    Estimate,
    Profile,
    performance_profile,
    probability_of_improvement,
    stratified_iqm,
)
from skillplan.records.training.result import TrainingResult, score_of
from skillplan.solvers.learning.learner import MODEL_BASED

THRESHOLDS = tuple(hundredths / 100 for hundredths in range(101))
"""Scores tau of performance profiles in documents."""


@dataclass(frozen=True)
class Method:
    """Runs of one method on one or several tasks.

    Parameters
    ----------
    tasks
        Hash and part of each task, in order.
    scores
        Scores of the runs on each task; an incomplete run scores 0.
    deterministic
        True if seeds are not samples.
    """

    name: str
    run_dirs: tuple[str, ...]
    tasks: tuple[tuple[str, str], ...]
    scores: tuple[tuple[float, ...], ...]
    deterministic: bool = False

    @property
    def runs(self) -> int:
        """Number of runs on all tasks."""
        return sum(map(len, self.scores))

    @property
    def score_iqm(self) -> Estimate | None:
        """Interquartile mean of the scores of all runs."""
        estimate = stratified_iqm(self.scores)
        return estimate.bare if estimate is not None and self.deterministic else estimate

    def profile(self, thresholds: Sequence[float] = THRESHOLDS) -> Profile:
        """Return the share of runs above each score."""
        profile = performance_profile(self.scores, thresholds)
        return replace(profile, low=None, high=None) if self.deterministic else profile

    def improvement(self, other: Method) -> Estimate | None:
        """Return the probability that a run of this method scores above one of the other.

        None if the methods have runs on different tasks.
        """
        if set(self.tasks) != set(other.tasks):
            return None
        theirs = dict(zip(other.tasks, other.scores, strict=True))
        estimate = probability_of_improvement(self.scores, [theirs[task] for task in self.tasks])
        return estimate.bare if self.deterministic or other.deterministic else estimate


@dataclass(frozen=True)
class MethodComparison:
    """Methods side by side, after Agarwal et al. (2021)."""

    methods: tuple[Method, ...]

    @property
    def improvements(self) -> list[tuple[Method, Method, Estimate]]:
        """Each pair of methods with the probability that the first one scores above the second."""
        pairs = [
            (first, second, first.improvement(second))
            for place, first in enumerate(self.methods)
            for second in self.methods[place + 1 :]
        ]
        return [(first, second, known) for first, second, known in pairs if known is not None]

    def document(self) -> dict[str, Any]:
        """Return the comparison as JSON values."""
        return {
            "methods": [
                {
                    "name": method.name,
                    "run_dirs": list(method.run_dirs),
                    "runs": method.runs,
                    "deterministic": method.deterministic,
                    "score_iqm": _document(method.score_iqm),
                    "profile": method.profile().document(),
                }
                for method in self.methods
            ],
            "improvements": [
                {"method": first.name, "than": second.name, "probability": _document(probability)}
                for first, second, probability in self.improvements
            ],
        }


def compare_methods(documents: Sequence[Mapping[str, Any]]) -> MethodComparison | None:
    """Compare the runs of trainings by their scores; None if an optimum is not proved.

    Trainings of one learner with the same options on different tasks are one method; options that
    the task determined do not count. If a method has several trainings on one task, each training
    is a method. A training that is given twice counts once.

    Parameters
    ----------
    documents
        Documents ``skillplan.training/1``, also of earlier versions.
    """
    documents = _drop_repeated(documents)
    if any(document["optimum"] is None or not document["runs"] for document in documents):
        return None
    names = _name_methods(documents)
    tasks = [_identify_task(document) for document in documents]
    alone = len(set(zip(names, tasks, strict=True))) < len(names)
    groups: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        key = f"{documents[place]['run_dir']}: {name}" if alone else name
        groups.setdefault(key, []).append(place)
    return MethodComparison(
        tuple(
            Method(
                name,
                tuple(str(documents[place]["run_dir"]) for place in group),
                tuple(tasks[place] for place in group),
                tuple(_read_scores(documents[place]) for place in group),
                any(documents[place].get("deterministic", False) for place in group),
            )
            for name, group in groups.items()
        )
    )


def _identify_task(document: Mapping[str, Any]) -> tuple[str, str]:
    return document["task"]["sha256"], document["task"]["name"]


def _drop_repeated(documents: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the documents without those of a folder, task and learner that came before."""
    keys = [
        (document["run_dir"], _identify_task(document), document["solver"])
        for document in documents
    ]
    return [document for at, document in enumerate(documents) if keys[at] not in keys[:at]]


def _name_methods(documents: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the learner of each training, with the options in which its trainings differ."""
    learners = [
        f"{document['solver']}{MODEL_BASED if document['options'].get('planning') else ''}"
        for document in documents
    ]
    settings = [_list_set_options(document, documents) for document in documents]
    names = []
    for learner, own in zip(learners, settings, strict=True):
        alike = [kept for name, kept in zip(learners, settings, strict=True) if name == learner]
        every = dict.fromkeys(option for kept in alike for option in kept)
        shown = [
            f"{option}={own.get(option, 'derived')}"
            for option in every
            if len({kept.get(option, "derived") for kept in alike}) > 1
        ]
        names.append(f"{learner} ({', '.join(shown)})" if shown else learner)
    return names


def _list_set_options(
    document: Mapping[str, Any], documents: Sequence[Mapping[str, Any]]
) -> dict[str, str]:
    """Return the options of a training as JSON, without those that the task determined.

    Before version 0.4 trainings do not tell them apart. Then an option that differs between
    trainings on different tasks only counts as determined by the task.
    """
    alike = [other for other in documents if other["solver"] == document["solver"]]
    options = {
        name: json.dumps(value, sort_keys=True).strip('"')
        for name, value in document["options"].items()
    }
    if all(other.get("derived_options") is not None for other in alike):
        derived = set(document["derived_options"])
        return {name: value for name, value in options.items() if name not in derived}
    pairs = [
        (first["options"], second["options"])
        for at, first in enumerate(alike)
        for second in alike[at + 1 :]
        if _identify_task(first) == _identify_task(second)
    ]
    return {
        name: value
        for name, value in options.items()
        if any(first.get(name) != second.get(name) for first, second in pairs)
    }


def _read_scores(document: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the scores of the runs; those of an earlier version follow from its costs."""
    optimum = document["optimum"]
    return tuple(score_of(run["cost"], optimum) for run in document["runs"])


def make_trainings_document(results: Sequence[TrainingResult]) -> dict[str, Any]:
    """Return the document ``skillplan.trainings/1`` of several trainings."""
    rows = [result.document() for result in results]
    comparison = compare_methods(rows)
    return {
        "schema": schemas.TRAININGS,
        "rows": rows,
        **({} if comparison is None else comparison.document()),
    }


def _document(estimate: Estimate | None) -> dict[str, Any] | None:
    return None if estimate is None else estimate.document()
