"""Injected collisions do collide, and near misses do not, by geometry."""

import pytest
from hypothesis import given, settings

from example_count import examples
from situations import assembly, config_content, crowded_assemblies
from skillplan.collision import sweep_hits, world_boxes
from skillplan.physics import choose_grasp, plan_linear_motions
from skillplan.robots import FINGER_PROFILE_M, HAND_HALF_LENGTH_M, HAND_UNDERSIDE_M, TIP_M
from skillplan.task import Body, Box, Event, GraspKind, Pose
from skillplan.trials import (
    LEAST_HIT_M,
    OBSTACLE,
    Truth,
    find_standing_boxes,
    inject_collisions,
    inject_near_misses,
    is_possible,
)


@pytest.fixture(scope="module")
def board():
    """The paper's board."""
    return assembly(config_content("inverter_board"))


def initial(task, name):
    """Return a skill and the initial state."""
    return task.skill(name), task.initial


def after(task, *names):
    """Return the state that skills lead to, feasible or not."""
    state = task.initial
    for name in names:
        state = task.skill(name).prediction.apply(state)
    return state


def swept_by_hand(motion, grasp):
    """Return boxes that fingers and palm surely pass through on the way down, in their frame."""
    half_width_m, _, thick_m = FINGER_PROFILE_M[0][1:]
    gap_m = grasp.width_m / 2 + 0.004
    length_m = thick_m - 0.004
    finger = (length_m, 2 * half_width_m, 0.040)
    boxes = [Box(finger, (side * (gap_m + length_m / 2), 0.0, 0.020)) for side in (1, -1)]
    palm_m = TIP_M - HAND_UNDERSIDE_M
    boxes.append(Box((2 * HAND_HALF_LENGTH_M, 0.0634, 0.050), (0.0, 0.0, palm_m + 0.025)))
    hand = Body("hand", tuple(boxes), (), 1.0)
    return world_boxes(hand, Pose.upright(motion.tip, motion.closing_yaw_rad))


def hits(trial, task):
    """Whether a block in the scene is hit by hand or part, coming down to where it acts."""
    (motion,) = plan_linear_motions(task, trial.skill, trial.state)
    body = task.scene.body(motion.visit.subject)
    block = trial.task.scene.body(OBSTACLE)
    obstacles = world_boxes(block, block.placement(trial.state).pose)
    moving = []
    grasp = choose_grasp(body)
    if grasp.kind is GraspKind.JAWS:
        moving += swept_by_hand(motion, grasp)
    if motion.visit.event is Event.RELEASE:
        pose = Pose.upright(motion.visit.position, motion.visit.yaw_rad)
        moving += world_boxes(body, pose)
    by = (0.0, 0.0, motion.above[2] - motion.tip[2])
    return any(sweep_hits(sweep, by, other, 0.0) for sweep in moving for other in obstacles)


class TestInjectedCollisions:
    @pytest.mark.parametrize("skill", ["pick(switch_1)", "pick(transformer)", "pick(clock)"])
    def test_a_block_beside_a_part_is_in_the_way_of_a_finger_or_the_palm(self, board, skill):
        """Whatever the side and the depth."""
        trials = list(inject_collisions(board, *initial(board, skill)))
        blocks = [item for item in trials if item.kind in ("beside", "light, beside", "tall")]
        assert 6 <= len(blocks)
        assert all(hits(trial, board) for trial in blocks)
        assert {Truth.COLLISION} == {trial.truth for trial in trials}

    def test_a_block_under_the_edge_is_hit_by_the_part(self, board):
        """By 3 mm at least in every direction."""
        state = after(board, "pick(pcb)", "place(pcb)", "pick(switch_1)")
        skill = board.skill("place(switch_1)")
        part = board.scene.body("switch_1")
        goal = world_boxes(part, part.placements[-1].pose)
        for trial in inject_collisions(board, skill, state):
            if "under the part" in trial.kind:
                block = trial.task.scene.body(OBSTACLE)
                (box,) = world_boxes(block, block.placement(state).pose)
                assert any(sweep_hits(target, (0, 0, 0.1), box, LEAST_HIT_M) for target in goal)

    def test_of_two_parts_one_may_stand_where_the_other_belongs(self, board):
        """Only where they would really overlap: a bridge goes over what it spans."""
        placed = ("pick(pcb)", "place(pcb)", "pick(switch_1)", "place(switch_1)", "pick(switch_2)")
        state = after(board, *placed)
        trials = inject_collisions(board, board.skill("place(switch_2)"), state)
        messages = [trial.fault for trial in trials if trial.kind == "place taken"]
        assert ["switch_1 stands where switch_2 belongs"] == messages
        over = ("pick(pcb)", "place(pcb)", "pick(transformer)", "place(transformer)", "pick(brace)")
        trials = inject_collisions(board, board.skill("place(brace)"), after(board, *over))
        assert not [trial for trial in trials if trial.kind == "place taken"]

    @settings(max_examples=examples(60))
    @given(crowded_assemblies())
    def test_the_world_with_an_obstacle_is_possible_and_overlaps_nowhere(self, content):
        """Blocks stand on the table or on a part, clear of everything but what comes."""
        task = assembly(content)
        for skill in task.skills:
            if not skill.applicable(task.initial):
                continue
            before = is_possible(find_standing_boxes(task, task.initial))
            trials = [
                *inject_collisions(task, skill, task.initial),
                *inject_near_misses(task, skill, task.initial),
            ]
            for trial in trials:
                standing = find_standing_boxes(trial.task, trial.state)
                assert is_possible(standing) >= before
                block = standing.get(OBSTACLE)
                if block is None:
                    continue
                others = [boxes for name, boxes in standing.items() if name != OBSTACLE]
                for box in (box for boxes in others for box in boxes):
                    assert not sweep_hits(block[0], (0.0, 0.0, 0.0), box, 2e-5)

    def test_the_block_stays_while_the_skill_runs(self, board):
        """Before and after the skill a fact says where it is."""
        for skill in board.skills:
            if skill.applicable(board.initial):
                following = skill.prediction.apply(board.initial)
                for trial in inject_collisions(board, skill, board.initial):
                    if any(body.name == OBSTACLE for body in trial.task.scene.bodies):
                        block = trial.task.scene.body(OBSTACLE)
                        assert block.placement(board.initial)
                        assert block.placement(board.initial).pose == (
                            block.placement(following).pose
                        )

    def test_staging_is_deterministic(self, board):
        """The same trials in the same order."""
        first, second = (
            list(inject_collisions(board, *initial(board, "pick(brace)"))) for _ in range(2)
        )
        assert first == second
        assert len({trial.fault for trial in first}) == len(first)


class TestNearMisses:
    @pytest.mark.parametrize("skill", ["pick(switch_1)", "pick(transformer)", "pick(clock)"])
    def test_nothing_hits_the_block(self, board, skill):
        """Neither finger nor palm nor part."""
        trials = list(inject_near_misses(board, *initial(board, skill)))
        assert 2 <= len(trials)
        for trial in trials:
            assert Truth.LEGITIMATE is trial.truth
            assert not hits(trial, board)
