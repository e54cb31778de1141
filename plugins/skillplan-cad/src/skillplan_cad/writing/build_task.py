"""Build the task of a product: write it, try it, and leave out what the arm cannot bring."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from dataclasses import replace
from functools import partial

import numpy as np

from skillplan_cad.nests.task_nest import Coming, NestChoice
from skillplan_cad.planning.assembly_plan import AssemblyPlan
from skillplan_cad.planning.bearing import (
    ATTITUDES,
    Bearing,
    find_bearing,
    find_best_bearing,
    hold_mates,
    list_required,
    list_straight,
)
from skillplan_cad.planning.turns import add_turns, list_placed
from skillplan_cad.planning.watch import Watch
from skillplan_cad.product import Product
from skillplan_cad.relation import LeftOut, Reason, Relation
from skillplan_cad.writing.heading import choose_heading
from skillplan_cad.writing.held_part import KnownHolds, PartHolds
from skillplan_cad.writing.pieces_proof import Cuts, PieceProof, ProvedPieces
from skillplan_cad.writing.task_document import (
    Places,
    SharedMeshes,
    TaskWriter,
    WrittenTask,
    find_indirect_parts,
    list_undriven,
)
from skillplan_cad.writing.trial import Failure, TaskTrials, Trial, list_brought, tells_fall
from skillplan_cad.writing.upright import place_turned, place_upright

# Number of further orientations, which are tried if the arm brings less than a share of the parts.
_MOST_ORIENTATIONS, _ENOUGH = 1, 0.8
# Shares of the time limit at which writing is interrupted: at first, and with tried parts alone.
_STOPPED_SHARES = 0.97, 1.05
# Reasons of parts that may be brought in another orientation.
_RETRIED = ("no grasp", "unreachable", "no order")
# Words of a place that the arm does not reach, and those with which `check` begins about it.
_FAR, _FAR_OFF = ", which reaches ", "out of reach"
# Cosine of two directions that are one.
_ALONG = 0.999


def build_task(
    product: Product,
    relation: Relation,
    plan: AssemblyPlan,
    robot: str = "panda",
    bearing: Bearing | None = None,
    without: Mapping[str, LeftOut] | None = None,
    remarks: Mapping[str, Sequence[str]] | None = None,
    others: Iterable[Bearing] | None = None,
    watch: Watch | None = None,
    longer: str | None = None,
    *,
    holding: bool = False,
    known: KnownHolds | None = None,
    cuts: Cuts | None = None,
    nesting: bool = False,
    turning: bool = False,
    heading: bool = False,
) -> WrittenTask:
    """Write the task of assembling a product with one arm, so that `check` accepts it.

    Leaves out parts that lack support, need more than a straight move, come from below, are refused
    by `check`, that the arm cannot bring, or that are in no order of the others, and what depends
    on those. `document` is empty if no part remains.

    Parameters
    ----------
    robot
        Name of an arm in skillplan.
    bearing
        Supports of the parts; default: the orientation in which most parts stand.
    without
        Parts to leave out, with the reasons.
    remarks
        Clauses about parts, which are listed with the limits of one arm.
    others
        Other orientations, which are tried if the arm brings few of the parts that stand; default:
        all, or none if `bearing` is given.
    watch
        Progress reports, and requests to stop: parts that were not tried then are left out.
    longer
        Another arm, tried in the best orientation if parts are out of reach; None for none.
    holding
        True if parts that do not stay may be held by supports of their own, as in `bearing`.
    known
        Tools and grasps that were found before.
    cuts
        Pieces of parts that were found before, also in other products.
    nesting
        True if a base that later parts would push aside stands in a nest.
    turning
        True if a workholder may turn the product, which takes supports.
    heading
        True if the product may stand turned about the vertical, for what goes in level.
    """
    watch = watch or Watch()
    cuts, known = cuts or Cuts(), known or KnownHolds()

    def build(
        bearing: Bearing,
        arm: str,
        rival: WrittenTask | None = None,
        early: Collection[str] = (),
    ) -> WrittenTask:
        if heading:
            bearing = replace(bearing, heading=choose_heading(product, relation, bearing, arm))
        builder = _TaskBuilder(
            product,
            relation,
            plan,
            arm,
            bearing,
            remarks or {},
            known,
            early=early,
            holding=holding,
            nests=NestChoice(relation, bearing.up, bearing.heading) if nesting else None,
        )
        without: Mapping[str, LeftOut] = absent
        with TaskTrials(watch) as trials:
            trials.renew()
            for share in _STOPPED_SHARES:
                make = partial(builder.build, without, cuts, trials, watch, rival)
                task = watch.attempt(make, share)
                if task is not None:
                    return builder.improve(task, absent, cuts, trials, watch)
                # Once more with the parts that passed their trial.
                without = builder.list_untried(trials)
        everything = _list_unexamined(part.name for part in product) | absent
        return _write_nothing(product, bearing, everything)

    absent = dict(without or {})
    if others is None:
        ups = () if bearing is not None else ATTITUDES.values()
        others = (find_bearing(product, relation, up, absent, holding=holding) for up in ups)
    first = plain = bearing or find_best_bearing(product, relation, absent, holding=holding)
    if holding:
        base = plan.base if turning else None
        first = _hold_between(product, relation, plain, absent, base)
    best = build(first, robot)
    most = _weigh(product, best.names)
    enough = _ENOUGH * _weigh(product, _list_promised(relation, first))
    promised_by = [
        (other, _list_promised(relation, other, best))
        for other in ((plain, *others) if most < enough and not watch.must_stop() else ())
        if other.up != plain.up or (other is plain and first.between)
    ]
    promised_by.sort(
        key=lambda pair: -_weigh(product, pair[1] & list_straight(relation, pair[0])),
    )
    for other, promised in promised_by[:_MOST_ORIENTATIONS]:
        if _weigh(product, promised) > most and not watch.must_stop():
            task = build(other, robot, best)
            if _is_better(product, task, best):
                best, most = task, _weigh(product, task.names)

    def turn(task: WrittenTask) -> WrittenTask:
        if not (turning and holding) or watch.must_stop():
            return task
        return _turn_product(product, relation, plan, task, absent, build, watch, longer)

    best = turn(best)
    far = [name for name, reason in best.left_out.items() if reason.kind == "unreachable"]
    if longer is not None and longer != robot and far and not watch.must_stop():
        up = best.bearing.up
        again = (
            first
            if first.up == up
            else find_bearing(product, relation, up, absent, holding=holding)
        )
        # After a turn, the best task may have more parts than stand without one.
        if _weigh(product, _list_promised(relation, again)) > _weigh(product, best.names):
            task = build(again, longer, best)
            if _is_better(product, task, best):
                best = turn(task)
    return best


def _hold_between(
    product: Product, relation: Relation, plain: Bearing, absent: Collection[str], base: str | None
) -> Bearing:
    """Return a bearing that holds parts in between if it brings more than a plain one.

    It brings more further parts than further supports.

    Parameters
    ----------
    base
        Part by which a workholder turns the product of the plain one; None for no turns.
    """

    def improves(bearing: Bearing) -> bool:
        names, known = (list_placed(relation, option, absent) for option in (further, bearing))
        is_spared = len(names) - len(known) > len(further.held) - len(bearing.held)
        return is_spared and _weigh(product, names) > _weigh(product, known)

    further = find_bearing(product, relation, plain.up, absent, holding=True, between=True)
    if not improves(plain):
        return plain
    turned = plain if base is None else add_turns(product, relation, plain, absent, base)
    return further if improves(turned) else plain


def _turn_product(
    product: Product,
    relation: Relation,
    plan: AssemblyPlan,
    task: WrittenTask,
    absent: Collection[str],
    build: Callable[[Bearing, str, WrittenTask, Collection[str]], WrittenTask],
    watch: Watch,
    longer: str | None,
) -> WrittenTask:
    """Return a task that turns the product if it has more of the parts, or else the given one.

    First, the parts of the given task keep their orientation, unless they shut out others after the
    turn. Then parts that would need fewer supports after it wait, if that leaves out no part. The
    station takes room: another arm is tried if that has no more parts, or some are out of reach.
    """
    robot = task.document["robot"]["model"] if task.document else None
    later = _list_retried(task)
    up, between = task.bearing.up, task.bearing.between
    best = task

    def find(gone: Collection[str]) -> Bearing:
        missing = {*absent, *gone, *later}
        return find_bearing(product, relation, up, missing, holding=True, between=between)

    def add(bearing: Bearing, gone: Collection[str], early: Collection[str]) -> Bearing:
        waiting = {name: why for name, why in later.items() if name not in gone}
        return add_turns(product, relation, bearing, {*absent, *gone}, plan.base, waiting, early)

    def improves(names: Set[str], held: Collection[str]) -> bool:
        if best is task:
            return _weigh(product, names) > _weigh(product, task.names)
        return names >= best.names.keys() and len(held) < len(best.bearing.held)

    def promises(turned: Bearing, gone: Collection[str]) -> bool:
        names = list_placed(relation, turned, {*absent, *gone})
        return bool(turned.turned) and improves(names, turned.held)

    plain = find(())
    for early in (task.names.keys(), set[str]()):
        turned = add(plain, (), early)
        if not (promises(turned, ()) and robot) or watch.must_stop():
            break
        further = build(turned, robot, task, early)
        is_whole = _is_better(product, further, task)
        left_out = {n: why for n, why in further.left_out.items() if n not in absent}
        is_short = not is_whole or any(map(_is_far, left_out.values()))
        # No arm brings what no tool holds, or what fingers have no room for.
        stuck = {name for name, why in left_out.items() if why.kind == "no grasp"}
        may_help = best is task and longer != robot and is_short and not watch.must_stop()
        if longer and may_help and promises(add(find(stuck), stuck, early), stuck):
            rival = further if is_whole else task
            other = build(turned, longer, rival, early)
            if _is_better(product, other, rival):
                further, robot = other, longer
        is_ordered = bool(further.skills) or not best.skills
        is_better = is_ordered and improves(further.names.keys(), further.bearing.held)
        if further.doubt.startswith("turn(") or not is_better:
            break
        best = further
    return best


def _list_retried(task: WrittenTask) -> dict[str, LeftOut]:
    """Return the left-out parts that may be brought in another orientation, with reasons."""
    return {name: why for name, why in task.left_out.items() if why.kind in _RETRIED}


def _is_far(reason: LeftOut) -> bool:
    return reason.kind == "unreachable" or _FAR in reason.text


def _is_better(product: Product, task: WrittenTask, best: WrittenTask) -> bool:
    """Return whether a task has more of the parts, and an order if the best one has."""
    is_ordered = bool(task.skills) or not best.skills
    return is_ordered and _weigh(product, task.names) > _weigh(product, best.names)


def _list_promised(
    relation: Relation, bearing: Bearing, tried: WrittenTask | None = None
) -> set[str]:
    """Return the parts that stand, and the screws that can be driven then.

    Parameters
    ----------
    tried
        Task in another orientation: parts that the arm could not bring fail again upside down, and
        screws unless they come from above.
    """
    promised = {*bearing.order, *(relation.driven - bearing.undriven.keys())}
    if tried is None:
        return promised
    up = np.asarray(bearing.up)
    is_parallel = abs(float(up @ np.asarray(tried.bearing.up))) > _ALONG
    for name, reason in tried.left_out.items():
        fastener = relation.fastener(name) if name in relation.driven else None
        from_above = fastener is not None and float(up @ np.asarray(fastener.axis)) > _ALONG
        repeats = (fastener is not None or is_parallel) and not from_above
        if repeats and reason.kind in ("no grasp", "unreachable", "follows"):
            promised.discard(name)
    return promised


def _weigh(product: Product, names: Collection[str]) -> float:
    """Return the sum of the shares of some parts in the number and in the mass of all."""
    whole_kg = sum(part.mass_kg for part in product)
    mass_kg = sum(part.mass_kg for part in product if part.name in names)
    return round(len(set(names)) / len(product) + mass_kg / whole_kg, 6)


class _TaskBuilder:
    """Builds the task in one orientation."""

    def __init__(
        self,
        product: Product,
        relation: Relation,
        plan: AssemblyPlan,
        robot: str,
        bearing: Bearing,
        remarks: Mapping[str, Sequence[str]],
        known: KnownHolds,
        *,
        early: Collection[str],
        holding: bool,
        nests: NestChoice | None,
    ) -> None:
        self._holding, self._given = holding, relation
        # A workholder carries a product in the air, where no nest stands.
        self._nests = None if bearing.turned else nests
        self._turning = bool(bearing.turned)
        self._product, self._plan, self._robot, self._remarks = product, plan, robot, remarks
        self._indirect = find_indirect_parts(plan)
        self._known = known
        self._absent: dict[str, LeftOut] = {}
        # Parts that fail in the first orientation, and are tried after a turn.
        self._later: dict[str, LeftOut] = {}
        # Parts that do not wait for a turn to save supports.
        self._early = early
        self._begin(bearing)

    def _begin(self, bearing: Bearing) -> None:
        """Forget the tools that were chosen in other orientations."""
        self._bearing = self._first = bearing
        mates = hold_mates(self._given, *bearing.ups) if self._holding else self._given
        self._relation = mates
        base, up = self._plan.base, bearing.up
        self._holds = PartHolds(self._product, mates, base, up, self._robot, self._known)
        # Parts that fall in a trial, so supports hold them.
        self._falling: list[str] = []
        # Parts that are in no order with the first tool that holds them.
        self._conflicting: dict[str, dict[str, LeftOut]] = {}
        # Task names by part of the last task.
        self._names: Mapping[str, str] = {}
        self._shared = SharedMeshes()
        # Layout of the last task.
        self._places: Places | None = None
        self._proof: PieceProof | None = None

    def build(
        self,
        without: Mapping[str, LeftOut],
        cuts: Cuts,
        trials: TaskTrials,
        watch: Watch,
        rival: WrittenTask | None = None,
    ) -> WrittenTask:
        """Write the task again with fewer parts until it passes its trial.

        Parameters
        ----------
        rival
            Task in another orientation or with another arm: the task is given up if it cannot have
            more of the parts. The parts that the rival lacks are tried first.
        """
        self._absent |= without
        if self._turning and rival is not None:
            self._later = _list_retried(rival)
        return self._write_until_passed(cuts, trials, watch, rival)

    def _write_until_passed(
        self, cuts: Cuts, trials: TaskTrials, watch: Watch, rival: WrittenTask | None
    ) -> WrittenTask:
        while (task := self._write(cuts, trials, watch, rival)) is None:
            trials.granted.clear()
            self._begin(self._bearing)
        return task

    def improve(
        self,
        task: WrittenTask,
        absent: Collection[str],
        cuts: Cuts,
        trials: TaskTrials,
        watch: Watch,
    ) -> WrittenTask:
        """Return a task with further parts as long as some were not examined, and time is left.

        Parameters
        ----------
        absent
            Names of parts that no task has.
        """
        while task.names and not watch.must_stop():
            late = {
                name
                for name, reason in self._absent.items()
                if reason.kind == "not examined" and name not in absent
            }
            if not late:
                break
            trials.renew()
            self._absent = {n: why for n, why in self._absent.items() if n not in late}
            self._leave_out({})
            # The further parts may go in between the others.
            rival = replace(task, skills=())
            make = partial(self._write_until_passed, cuts, trials, watch, rival)
            further = watch.attempt(make, _STOPPED_SHARES[0])
            if further is None:
                break
            if not _is_better(self._product, further, task):
                reasons = {n: further.left_out.get(n, why) for n, why in task.left_out.items()}
                return task.explain(reasons)
            task = further
        return task

    def _write(
        self, cuts: Cuts, trials: TaskTrials, watch: Watch, rival: WrittenTask | None
    ) -> WrittenTask | None:
        """Return the task; None if parts go in in other orientations than before."""
        if self._proof is None:
            parts, bearing = self._product.parts, self._bearing
            upright = place_turned(parts, bearing.ups, bearing.turned, (0.0, 0.0), bearing.heading)
            self._proof = PieceProof(
                self._product, self._relation, self._plan, upright, cuts, watch
            )
        least_weight = 0.0 if rival is None else _weigh(self._product, rival.names)
        while True:
            if not self._is_in_same_poses():
                return None
            unheld = self._holds.choose(self._bearing)
            if unheld:
                self._leave_out(unheld)
                continue
            if self._holds.fixed and self._turning:
                # No workholder turns what no hand brings.
                self._turning = False
                self._leave_out({})
                continue
            left_out = self._list_left_out()
            kept = {part.name for part in self._product} - left_out.keys()
            late = kept - self._names.keys() if self._names and trials.is_hurried else ()
            if late:
                # Parts that stand now would change the layout of those that passed their trial.
                self._leave_out(_list_unexamined(late))
                continue
            is_empty = not kept - self._holds.fixed.keys() or not kept - self._relation.driven
            if is_empty or _weigh(self._product, kept) <= least_weight:
                return _write_nothing(self._product, self._bearing, left_out)
            writer = TaskWriter(
                self._product,
                self._relation,
                self._plan,
                self._bearing,
                self._robot,
                left_out,
                self._remarks,
                self._holds,
                self._shared,
                self._places,
            )
            if writer.places.without:
                words = "finds no place within the arm's reach"
                far = writer.places.without
                self._leave_out({name: LeftOut(name, "no place", words) for name in far})
                continue
            self._seat(writer, watch)
            self._names = writer.names
            task = writer.write(self._proof)
            if self._places is None:
                # Trials share the time that pieces leave.
                trials.renew()
            self._places = writer.places
            unfinished = {part.name for part in writer.gripped} - task.pieces.pieces.keys()
            if unfinished:
                self._leave_out(_list_unexamined(unfinished))
                continue
            trial = self._try(task, trials, rival)
            if self._retreat(task, trial) or self._lift(trial):
                trials.forget(*task.names.values())
                continue
            general = trial.refusals.get("")
            if general is not None and len(trial.refusals) == 1:
                return replace(task, faults=(general,))
            more = self._judge(trial, {task.names[name]: name for name in task.names}, trials)
            if more is None:
                self._holds.keep()
                why_no_nest = "" if self._nests is None else self._nests.why_none
                return replace(
                    task, skills=trial.skills, doubt=trial.doubt, why_no_nest=why_no_nest
                )
            self._leave_out(more)

    def _try(self, task: WrittenTask, trials: TaskTrials, rival: WrittenTask | None) -> Trial:
        """Try a task until the nest is in the way.

        First, the parts that its rival lacks, or brings in another orientation.
        """
        listed, known = self._holds.list_order(), list[str]()
        doubtful = set[str]() if rival is None else task.names.keys() - rival.names.keys()
        if rival is not None and rival.bearing.up == self._bearing.up:
            # Parts of the rival keep its order, before those that come after a turn.
            brought = list_brought(rival.skills)
            names = {own: name for name, own in rival.names.items()}
            known = [names[own] for own in brought if names[own] not in self._bearing.turned]
            listed = [*known, *(name for name in listed if name not in known)]
            get_up, get_rivals_up = self._bearing.get_up, rival.bearing.get_up
            doubtful |= {name for name in task.names if get_up(name) != get_rivals_up(name)}
        order = [task.names[name] for name in listed if name in task.names]
        return trials.try_task(
            task.document,
            task.files,
            order,
            [task.names[name] for name in doubtful],
            [task.names[name] for name in known if name in task.names],
            lambda failure: self._is_nest_in(task, failure.text),
        )

    def list_untried(self, trials: TaskTrials) -> dict[str, LeftOut]:
        """Return the parts that were left out, and the parts without a passed trial."""
        untried = {
            part.name
            for part in self._product
            if self._names.get(part.name) not in trials.granted
            and part.name not in self._holds.fixed
        }
        return self._explain_untried(untried) | self._absent

    def _explain_untried(self, names: Iterable[str]) -> dict[str, LeftOut]:
        """Return parts that were not tried with all tools in the time, with the last failure."""
        reasons = _list_unexamined(names)
        for name in reasons:
            failure = self._holds.find_failure(name)
            if failure is not None:
                words = f"was not tried with all tools in the time; before, {failure.text}"
                reasons[name] = LeftOut(name, "not examined", f"{words}; --time-limit sets it")
        return reasons

    def _seat(self, writer: TaskWriter, watch: Watch) -> None:
        """Put the base into a nest if it needs one, and can have one."""
        nests = self._nests
        if nests is None:
            return
        turn, comings = writer.upright.matrix, dict[str, Coming]()
        for part in writer.kept:
            fastener = self._relation.fastener(part.name)
            if fastener is not None and part.name in self._relation.driven:
                x, y, z = fastener.axis
                comings[part.name] = Coming(part, ((-x, -y, -z),))
            else:
                ways = np.array(writer.list_directions(part)) @ turn
                stands = not self._bearing.on[part.name] and part.name not in self._bearing.held
                comings[part.name] = Coming(part, tuple((x, y, z) for x, y, z in ways), stands)
        base = self._holds.base
        if self._bearing.on.get(base) != ():
            # One part may bear all others.
            standing = [name for name, coming in comings.items() if coming.stands]
            base = standing[0] if len(standing) == 1 else ""
        if base not in comings:
            grounded = {name for name, on in self._bearing.on.items() if not on}
            if grounded <= {*self._bearing.held}:
                # Nothing stands on the table: supports hold the product at any height.
                writer.lift(nests.raise_m)
            return
        is_fixed, coming = base in self._holds.fixed, comings.pop(base)
        others = tuple(comings.values())
        nest = nests.choose(writer.name_nest(), coming, others, watch.attempt, is_fixed=is_fixed)
        if nest is not None:
            writer.seat(nest)

    def _is_nest_in(self, task: WrittenTask, text: str) -> bool:
        """Return whether a text names the nest that a task may do without."""
        if task.nest is None or self._nests is None:
            return False
        return re.search(rf"(?<![\w-]){re.escape(task.nest.name)}(?![\w-])", text) is not None

    def _retreat(self, task: WrittenTask, trial: Trial) -> bool:
        """Return whether the arm or a part met the nest; then a shallower one is tried, or none."""
        texts = [
            *trial.refusals.values(),
            *(failure.text for failure in trial.failures.values()),
            *(conflict.text for conflict in trial.conflicts.values()),
        ]
        words = next((text for text in texts if self._is_nest_in(task, text)), None)
        if words is not None and self._nests is not None:
            self._nests.retreat(words)
        return words is not None

    def _lift(self, trial: Trial) -> bool:
        """Return whether the base is tried at another height, for parts that meet the table."""
        if self._nests is None:
            return False
        failures = trial.failures.values()
        is_low = any(
            failure.text.startswith(("place", "fasten")) and "the table" in failure.text
            for failure in failures
        )
        return self._nests.lift(len(failures), is_low=is_low)

    def _list_left_out(self) -> dict[str, LeftOut]:
        reasons = {**self._bearing.why_not, **self._bearing.undriven}
        reasons |= {
            name: self._indirect[name]
            for name, reason in reasons.items()
            if name in self._indirect and reason.kind in ("closed in", "from below")
        }
        left_out = {**reasons, **self._absent}
        there = self._relation.driven - left_out.keys()
        left_out |= list_undriven(self._product, self._relation, there)
        return left_out | _find_loose_screws(self._relation, left_out, self._bearing)

    def _leave_out(self, reasons: Mapping[str, LeftOut]) -> None:
        product, relation, up = self._product, self._given, self._bearing.up
        moved = {
            name: reason
            for name, reason in reasons.items()
            if self._turning
            and reason.kind in _RETRIED
            and self._bearing.get_up(name) == up
            and name not in self._later
        }
        waiting = {n: why for n, why in self._later.items() if n not in reasons and self._turning}
        self._absent |= {**self._later, **reasons}
        self._later = waiting | moved
        self._absent = {n: why for n, why in self._absent.items() if n not in self._later}
        gone = {**self._absent, **self._later}
        holding, between = self._holding, self._bearing.between
        bearing = find_bearing(product, relation, up, gone, holding=holding, between=between)
        if self._turning:
            base, absent = self._plan.base, self._absent
            bearing = add_turns(product, relation, bearing, absent, base, self._later, self._early)
        if not bearing.turned:
            # No turn brings in what waits for one.
            self._absent, self._later = gone, {}
        order, held = bearing.order, bearing.held
        more = [name for name in self._falling if name in order and name not in held]
        heading = self._bearing.heading
        self._bearing = replace(bearing, held=(*held, *more), heading=heading)

    def _is_in_same_poses(self) -> bool:
        """Return whether all parts go in in the orientations that were begun with.

        The last of them may be gone, unless the product does not turn any more.
        """
        now, first, given = self._bearing, self._first, self._given
        names = list_placed(given, now, self._absent)
        known = list_placed(given, first)
        is_same = now.ups == first.ups[: len(now.ups)] and all(
            now.get_up(name) == first.get_up(name) for name in names & known
        )
        if is_same and now.ups != first.ups:
            is_same = bool(now.turned) and (
                hold_mates(given, *now.ups).driven == self._relation.driven
            )
        return is_same

    def _judge(
        self, trial: Trial, names: Mapping[str, str], trials: TaskTrials
    ) -> dict[str, LeftOut] | None:
        """Return the parts to leave out after a trial; None if it passed.

        None are left out if other tools are to be tried.

        Parameters
        ----------
        names
            Product names by task names.
        """
        reasons: dict[str, LeftOut] = {}
        for task_name, words in trial.refusals.items():
            if task_name:
                name = names[task_name]
                kind: Reason = "unreachable" if words.startswith(_FAR_OFF) else "refused"
                reasons[name] = LeftOut(name, kind, f"is refused: {words.removesuffix('.')}")
        is_hurried = trials.is_hurried
        for task_name, failure in trial.failures.items():
            name = names[task_name]
            if failure.falls and self._can_hold(name):
                self._falling.append(name)
            elif not self._holds.take_next(name, failure):
                conflicting = self._take_conflicting(name, task_name, trials)
                reasons |= conflicting or self._holds.give_up(name)
            elif is_hurried:
                reasons |= self._explain_untried([name])
        reasons |= self._explain_untried(names[task_name] for task_name in trial.untried)
        reasons |= _list_unordered(names[task_name] for task_name in trial.unordered)
        for task_name, conflict in trial.conflicts.items():
            name, by = names[task_name], tuple(names[other] for other in conflict.by)
            left_out = LeftOut(name, "no order", conflict.text, by)
            failed = names[conflict.failed]
            falls = f"'{conflict.failed}' " in conflict.text and tells_fall(conflict.text)
            if falls and self._can_hold(failed):
                self._falling.append(failed)
                trials.forget(conflict.failed)
                continue
            may_retool = conflict.is_by_hand and not is_hurried
            retooled = may_retool and self._holds.take_next(
                failed, Failure(conflict.text, is_far=False)
            )
            if retooled:
                self._conflicting.setdefault(failed, {name: left_out})
                trials.forget(conflict.failed)
            else:
                conflicting = self._take_conflicting(failed, conflict.failed, trials)
                reasons |= conflicting or {name: left_out}
        tried = (trial.refusals, trial.failures, trial.untried, trial.conflicts, trial.unordered)
        return reasons if any(tried) else None

    def _can_hold(self, name: str) -> bool:
        return self._holding and name not in (*self._bearing.held, *self._falling)

    def _take_conflicting(
        self, name: str, task_name: str, trials: TaskTrials
    ) -> dict[str, LeftOut] | None:
        """Return the parts to leave out for another, which is tried again then, or None.

        They were in no order with its first tool, and it passed its trial without them.
        """
        conflicting = self._conflicting.pop(name, None)
        if conflicting:
            self._holds.begin_again(name)
            trials.forget(task_name)
        return conflicting


def _list_unexamined(names: Iterable[str]) -> dict[str, LeftOut]:
    words = "was not tried in the time; --time-limit sets it"
    return {name: LeftOut(name, "not examined", words) for name in sorted(names)}


def _list_unordered(names: Iterable[str]) -> dict[str, LeftOut]:
    words = "is in no order that was found in the time or number of checks"
    return {name: LeftOut(name, "not examined", words) for name in sorted(names)}


def _write_nothing(
    product: Product, bearing: Bearing, left_out: Mapping[str, LeftOut]
) -> WrittenTask:
    upright = place_upright(product, bearing.up, (0.0, 0.0))
    pieces = ProvedPieces({}, (), ())
    return WrittenTask({}, {}, {}, {}, left_out, (), upright, pieces, bearing)


def _find_loose_screws(
    relation: Relation, left_out: Mapping[str, LeftOut], bearing: Bearing
) -> dict[str, LeftOut]:
    """Return the screws and nuts that need a part that is left out, each with a reason."""
    loose: dict[str, LeftOut] = {}
    for name in sorted(relation.driven - left_out.keys(), key=relation.index):
        for join in list_required(relation, name, bearing.get_up(name)):
            if join in left_out or join in loose:
                words = f"goes through or into {join}, which is left out"
                loose[name] = LeftOut(name, "follows", words, (join,))
                break
    return loose
