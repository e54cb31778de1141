"""The figures of a stored result, and the files beside it, against what its plans come to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from skillplan.domains.load import Problem
from skillplan.errors import OptionError, SearchStopped
from skillplan.files.regular_file import read_bytes
from skillplan.judge.claim_check import ARITHMETIC, stopped_words
from skillplan.judge.document_check import differences, leaves
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.derivation import Replayed, derived_chain, derived_result
from skillplan.pipeline.policy_check import policies_fault
from skillplan.pipeline.setup import Setup
from skillplan.records.certificate import Claim, Outcome
from skillplan.records.chain_result import ChainResult
from skillplan.records.origin import Origin
from skillplan.records.result import Result
from skillplan.records.stored.policy_file import read_policies
from skillplan.records.stored.result_file import StoredResult
from skillplan.records.stored.result_folder import POLICIES, RESULT, file_beside, result_path
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task

_MOST_SHOWN = 5
_LATER_KEYS = (
    *("proved_by", "simulation", "not_checked", "policy", "dwells_from"),
    *("reachable", "relax", "sampling"),
)
MISSING = "is missing beside the result"
_MOST_BYTES = 64 * 1024 * 1024

SavedTables = Callable[[Result | ChainResult, Task], Mapping[str, str]]
"""Returns the text of the tables that lie beside a result, by the name of the file."""


class RecordCheck:
    """Checks all that a result says beyond its plans, once these have been replayed.

    Parameters
    ----------
    path
        Where the result is.
    stored
        The result.
    problem
        What it solves.
    setup
        The back ends that it names.
    model
        Returns a model of a task, for what policies choose.
    stop
        When to give up.
    """

    def __init__(
        self,
        path: str,
        stored: StoredResult,
        problem: Problem,
        setup: Setup,
        model: Callable[[Task], SkillModel],
        stop: Stop,
    ) -> None:
        self._path = path
        self._stored = stored
        self._problem = problem
        self._setup = setup
        self._model = model
        self._stop = stop

    def claims(
        self,
        document: Mapping[str, Any],
        replayed: Mapping[str, Replayed],
        tables: SavedTables,
    ) -> Iterator[Claim]:
        """Yield whether every figure of the document, and of the files beside, is as it should be.

        Parameters
        ----------
        document
            The result, as it was read.
        replayed
            Its tasks with their plans, by name.
        tables
            Returns what the tables beside it should hold.
        """
        if self._stop.interrupted:
            yield Claim("record", Outcome.NOT_CHECKED, "interrupted", ARITHMETIC, open=False)
            return
        expected = len([*self._stored.stages, *(self._stored.sequences or ())]) or 1
        parts = list(replayed.values())
        if len(parts) < expected or not all(one.sound for one in parts):
            words = "follows from the plans, and those do not hold"
            yield Claim("record", Outcome.NOT_CHECKED, words, ARITHMETIC, open=False)
            return
        origin = None if self._stored.origin is None else self._stored.origin.origin()
        try:
            derived = self._derived(parts, origin)
        except ValueError as error:
            yield Claim("record", Outcome.FAILS, f"does not go together: {error}", ARITHMETIC)
            return
        should = derived.document()
        should.pop("schema")
        if origin is None and "origin" not in document:
            should.pop("origin")
        _fit_to_version(should, document)
        amiss = list(differences(document, should))
        words = "; ".join(amiss[:_MOST_SHOWN])
        words += f"; and {len(amiss) - _MOST_SHOWN} more" if len(amiss) > _MOST_SHOWN else ""
        outcome = Outcome.FAILS if amiss else Outcome.HOLDS
        yield Claim("record", outcome, words or f"{leaves(should)} entries", ARITHMETIC)
        yield from self._table_claims(tables(derived, parts[-1].task))
        yield from self._policy_claims(replayed)

    def _derived(self, replayed: list[Replayed], origin: Origin | None) -> Result | ChainResult:
        if self._stored.is_chain:
            return derived_chain(self._problem, self._stored, replayed, self._setup, origin)
        return derived_result(replayed[0], self._setup, self._stored.solver, origin)

    def _table_claims(self, tables: Mapping[str, str]) -> Iterator[Claim]:
        for name, text in tables.items():
            path = file_beside(self._path, name)
            if path is None:
                if result_path(self._path).name == RESULT:
                    yield Claim(name, Outcome.NOT_CHECKED, MISSING, ARITHMETIC)
                continue
            try:
                found = read_bytes(path, _MOST_BYTES, within=path.parent).decode("utf-8")
            except (OSError, UnicodeDecodeError) as error:
                words = f"cannot be read: {getattr(error, 'strerror', None) or 'it is no text'}"
                yield Claim(name, Outcome.FAILS, words, ARITHMETIC)
                continue
            fault = _line_fault(found.splitlines(), text.splitlines())
            outcome = Outcome.FAILS if fault else Outcome.HOLDS
            yield Claim(name, outcome, fault or "as the result says", ARITHMETIC)

    def _missing_policies(self, replayed: Mapping[str, Replayed]) -> Iterator[Claim]:
        """Yield the claim of policies that are missing; essential if outcomes are uncertain."""
        planned = [one for one in replayed.values() if one.walked is not None]
        if not all(one.task.deterministic for one in planned):
            words = f"{MISSING}: the plan shows nominal outcomes, the policy decides on the others"
            yield Claim(POLICIES, Outcome.NOT_CHECKED, words, ARITHMETIC, open=False)
        elif self._stored.policy:
            yield Claim(POLICIES, Outcome.NOT_CHECKED, MISSING, ARITHMETIC)

    def _policy_claims(self, replayed: Mapping[str, Replayed]) -> Iterator[Claim]:
        path = file_beside(self._path, POLICIES)
        if path is None:
            yield from self._missing_policies(replayed)
            return
        header = {"sha256": self._problem.sha256, "solver": self._stored.solver}
        try:
            fault = policies_fault(
                read_policies(str(path), within=str(path.parent)),
                header,
                replayed,
                self._model,
                self._stop,
            )
        except OptionError as error:
            fault = str(error)
        except (SearchStopped, TimeoutError):
            words = stopped_words(self._stop)
            yield Claim(POLICIES, Outcome.NOT_CHECKED, words, ARITHMETIC)
            return
        outcome = Outcome.FAILS if fault else Outcome.HOLDS
        words = fault or "take the way of the plan; all choices can be executed"
        yield Claim(POLICIES, outcome, words, ARITHMETIC)


def _fit_to_version(should: dict[str, Any], document: Mapping[str, Any]) -> None:
    """Remove keys that results of older versions lack, also from the parts of a chain.

    The policy of a task is compared with policies.json, not with the plan.
    """
    parts = [*(document.get("stages") or ()), *(document.get("sequences") or ())]
    claimed = [part.get("policy") is True for part in parts]
    should["policy"] = any(claimed) if parts else document.get("policy")
    for key in _LATER_KEYS:
        if key not in document:
            should.pop(key, None)
    for key in ("sequences", "stages"):
        for part, own in zip(should.get(key, ()), document.get(key) or (), strict=False):
            _fit_to_version(part, own)


def _line_fault(found: list[str], should: list[str]) -> str:
    for number, (one, other) in enumerate(zip(found, should, strict=False), start=1):
        if one != other:
            return f"line {number} is {other!r}, claimed {one!r}"
    if len(found) != len(should):
        return f"has {len(found)} lines, not {len(should)}"
    return ""
