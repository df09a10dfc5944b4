"""Action terms: from a policy's numbers to the targets of the joints."""

from __future__ import annotations

import ast
from dataclasses import replace

import numpy as np
import pytest
from dm_control import composer
from hypothesis import given
from hypothesis import strategies as st

from tests.walkers.robots import DELAYED, EXPLICIT, NATIVE, Drive, dog
from walkerkit.actuators import ActuatorCmd, BuiltinMotorActuatorCfg, BuiltinVelocityActuatorCfg
from walkerkit.walkers.actions import (
    ActionTerm,
    Commander,
    FullRangeAction,
    JointEffortAction,
    JointPositionAction,
    Joints,
    JointVelocityAction,
    RelativeJointPositionAction,
)

NAMES = ("left_hip", "left_knee", "right_hip", "right_knee")
DEFAULT = np.array([0.1, -0.2, 0.3, -0.4])
POSITION, VELOCITY, EFFORT = "position_target", "velocity_target", "effort_target"
ANY = frozenset({POSITION, VELOCITY, EFFORT})
FREE = np.tile([-np.inf, np.inf], (4, 1))


def joints(*, takes=(ANY,) * 4, ranges=FREE, speeds=np.inf, efforts=np.inf):
    return Joints(
        names=NAMES,
        default=DEFAULT,
        ranges=np.asarray(ranges, dtype=float),
        takes=tuple(map(frozenset, takes)),
        speeds=np.broadcast_to(np.asarray(speeds, dtype=float), 4),
        efforts=np.broadcast_to(np.asarray(efforts, dtype=float), 4),
    )


def commander(*terms, **known):
    return Commander(terms, joints(**known))


def numbers(low=-1e6, high=1e6):
    return st.floats(low, high, allow_nan=False)


def per_joint(each):
    """A number for all joints, one per expression, or one per name."""
    return st.one_of(
        each,
        st.fixed_dictionaries({".*_hip": each, ".*_knee": each}),
        st.fixed_dictionaries(dict.fromkeys(NAMES, each)),
    )


def value_at(numbers, name):
    if not isinstance(numbers, dict):
        return numbers
    return next(
        v for key, v in numbers.items() if key == name or key == ".*" + name[-len(key) + 2 :]
    )


bounds = st.lists(numbers(), min_size=2, max_size=2, unique=True).map(sorted).map(tuple)
action_values = st.lists(numbers(-1e200, 1e200), min_size=4, max_size=4)
TERMS = {
    POSITION: JointPositionAction,
    VELOCITY: JointVelocityAction,
    EFFORT: JointEffortAction,
}


class TestLaw:
    """target = clip(offset + scale · action), whatever the numbers."""

    @given(
        target=st.sampled_from([*TERMS]),
        scale=per_joint(numbers()),
        offset=per_joint(numbers()),
        clip=st.none() | per_joint(bounds),
        action=action_values,
        from_default=st.booleans(),
    )
    def test_of_every_term(self, target, scale, offset, clip, action, from_default):
        options = {"use_default_offset": from_default} if target == POSITION else {}
        term = TERMS[target](
            joint_names_expr=(".*",), scale=scale, offset=offset, clip=clip, **options
        )
        asked = getattr(commander(term).command(action), target)
        for i, name in enumerate(NAMES):
            start = DEFAULT[i] if options.get("use_default_offset") else 0.0
            wanted = (value_at(offset, name) + start) + value_at(scale, name) * action[i]
            if clip is not None:
                low, high = value_at(clip, name)
                wanted = min(max(wanted, low), high)
            assert asked[i] == wanted

    @given(
        scale=per_joint(numbers(0.01, 100)),
        offset=per_joint(numbers(-10, 10)),
        action=st.lists(numbers(-1, 1), min_size=4, max_size=4),
    )
    def test_has_an_inverse(self, scale, offset, action):
        bound = commander(JointPositionAction(joint_names_expr=(".*",), scale=scale, offset=offset))
        np.testing.assert_allclose(bound.action(bound.command(action)), action, atol=1e-11)

    def test_inverse_of_what_makes_no_difference_is_zero(self):
        bound = commander(JointPositionAction(joint_names_expr=(".*",), scale=0.0))
        np.testing.assert_array_equal(bound.action(bound.rest()), np.zeros(4))

    def test_inverse_is_not_clipped_and_fills_what_is_left_out(self):
        bound = commander(
            JointPositionAction(joint_names_expr=(".*_hip",), scale=0.5),
            JointVelocityAction(joint_names_expr=(".*_knee",), scale=2.0),
        )
        cmd = ActuatorCmd(position_target=DEFAULT + 5.0)
        np.testing.assert_allclose(bound.action(cmd), [10, 10, 0, 0])
        assert commander().action(cmd).shape == (0,)

    def test_is_unbounded_without_a_clip(self):
        cmd = commander(JointPositionAction(joint_names_expr=(".*",), scale=0.25)).command([12] * 4)
        np.testing.assert_allclose(cmd.position_target, DEFAULT + 3.0)

    @pytest.mark.parametrize("clip", [None, {".*_hip": (-1, 1)}])
    def test_asks_for_nothing_that_is_not_finite(self, clip):
        term = JointVelocityAction(joint_names_expr=(".*",), scale=1e9, clip=clip)
        with pytest.raises(
            ValueError, match=r"-1e\+300 for 'left_knee' asks for a velocity_target"
        ):
            commander(term).command([0, -1e300, 0, 0])
        bounded = JointVelocityAction(joint_names_expr=(".*",), scale=1e9, clip=(-3, 4))
        asked = commander(bounded).command([1e300, -1e300, 0, 0]).velocity_target
        np.testing.assert_array_equal(asked, [4, -3, 0, 0])


class TestRelative:
    Q = np.array([0.5, -0.5, 1.0, 2.0])

    def test_counts_from_where_the_joints_are(self):
        bound = commander(
            JointVelocityAction(joint_names_expr=("left_.*",)),
            RelativeJointPositionAction(
                joint_names_expr=("right_.*",), scale=0.2, offset=0.01, clip=(-0.3, 0.3)
            ),
        )
        cmd = bound.command([0, 0, 0.5, -9], positions=self.Q)
        np.testing.assert_allclose(
            cmd.position_target, [DEFAULT[0], DEFAULT[1], 1.0 + 0.11, 2.0 - 0.3]
        )
        np.testing.assert_allclose(bound.action(cmd, self.Q)[2:], [0.5, -0.31 / 0.2])

    def test_of_a_batch(self):
        bound = commander(RelativeJointPositionAction(joint_names_expr=(".*_hip",)))
        q = np.stack([self.Q, -self.Q, 3 * self.Q])
        cmd = bound.command(np.full((3, 2), 0.1), (3,), q)
        np.testing.assert_allclose(cmd.position_target[:, ::2], q[:, ::2] + 0.1)

    def test_needs_positions(self):
        bound = commander(RelativeJointPositionAction(joint_names_expr=("left_hip",)))
        with pytest.raises(ValueError, match=r"\['left_hip'\] are counted from where"):
            bound.command([0.0])

    def test_of_a_walker_follows_the_joint_at_every_physics_step(self, tmp_path):
        term = RelativeJointPositionAction(joint_names_expr=(".*_hip",), scale=0.1)
        walker = dog(tmp_path, action=term)
        environment = composer.Environment(Drive(walker), random_state=0)
        environment.reset()
        seen, run = [], walker.drivetrain.run

        def watched():
            before = walker.actuator_group.positions
            run()
            seen.append(walker.command.position_target - before)

        walker.drivetrain.run = watched
        n = walker.action_spec.shape[0]
        environment.step([np.r_[np.full(4, 2.0), np.zeros(n - 4)]])
        hips = [name.endswith("hip") for name in walker.actuator_group.joint_names]
        assert len(seen) > 1
        np.testing.assert_allclose(np.array(seen)[:, hips], 0.2, atol=1e-12)
        # A command of someone else's stays.
        mine = ActuatorCmd(position_target=np.zeros(len(hips)))
        walker.command = mine
        run()
        assert walker.command is mine

    def test_inverse_of_a_walker_is_counted_from_the_pose(self, tmp_path):
        term = RelativeJointPositionAction(joint_names_expr=(".*",), scale=0.5)
        walker = dog(tmp_path, action=term)
        environment = composer.Environment(Drive(walker), random_state=0)
        environment.reset()
        q = walker.actuator_group.positions
        wanted = ActuatorCmd(position_target=q + 0.25)
        np.testing.assert_allclose(walker.action_for(wanted)[: len(q)], 0.5, atol=1e-12)


class TestEncoderBias:
    @given(
        bias=per_joint(numbers(-3, 3)),
        scale=per_joint(numbers(0.1, 10)),
        action=st.lists(numbers(-5, 5), min_size=4, max_size=4),
    )
    def test_is_what_the_joint_is_asked_for_less(self, bias, scale, action):
        plain = {"joint_names_expr": (".*",), "scale": scale, "clip": (-2.0, 2.0)}
        biased = commander(JointPositionAction(**plain, encoder_bias=bias))
        wanted = commander(JointPositionAction(**plain)).command(action).position_target
        cmd = biased.command(action)
        off = np.array([value_at(bias, name) for name in NAMES])
        np.testing.assert_allclose(cmd.position_target, wanted - off, atol=1e-12)
        again = biased.command(biased.action(cmd)).position_target
        np.testing.assert_allclose(again, cmd.position_target, atol=1e-12)


class TestDefaultOffset:
    @pytest.mark.parametrize(("use", "start"), [(True, DEFAULT), (False, np.zeros(4))])
    def test_is_where_positions_count_from(self, use, start):
        term = JointPositionAction(joint_names_expr=(".*",), scale=0.5, use_default_offset=use)
        asked = commander(term).command(np.zeros(4)).position_target
        np.testing.assert_array_equal(asked, start)

    def test_is_on_unless_it_is_switched_off(self):
        assert JointPositionAction(joint_names_expr=(".*",)).use_default_offset


class TestSharing:
    def test_terms_take_the_numbers_one_after_the_other(self):
        bound = commander(
            JointVelocityAction(joint_names_expr=("right_.*",), scale=3.0),
            JointPositionAction(joint_names_expr=("left_knee", "left_hip"), scale=2.0),
        )
        assert bound.names == ("right_hip", "right_knee", "left_hip", "left_knee")
        assert bound.size == 4
        cmd = bound.command([0.1, 0.2, 0.3, 0.4])
        np.testing.assert_allclose(cmd.velocity_target, [0, 0, 0.3, 0.6])
        np.testing.assert_allclose(
            cmd.position_target, [DEFAULT[0] + 0.6, DEFAULT[1] + 0.8, DEFAULT[2], DEFAULT[3]]
        )
        assert cmd.effort_target is None

    def test_joints_that_no_term_moves_hold_their_default(self):
        cmd = commander(JointPositionAction(joint_names_expr=("left_hip",))).command([1.0])
        np.testing.assert_array_equal(cmd.position_target[1:], DEFAULT[1:])
        np.testing.assert_array_equal(commander().command([]).position_target, DEFAULT)

    def test_of_one_joint_by_two_targets(self):
        bound = commander(
            JointPositionAction(joint_names_expr=(".*",)),
            JointEffortAction(joint_names_expr=("left_hip",), scale=4.0),
        )
        assert bound.names == (*NAMES, "left_hip")
        np.testing.assert_array_equal(bound.command([0] * 4 + [0.5]).effort_target, [2, 0, 0, 0])

    def test_of_one_target_by_two_terms_is_refused(self):
        one = JointPositionAction(joint_names_expr=("left_.*",))
        other = JointPositionAction(joint_names_expr=(".*_hip",))
        with pytest.raises(
            ValueError, match=r"two action terms set the position_target of 'left_hip': make"
        ) as caught:
            commander(one, other)
        advice = ast.literal_eval(str(caught.value).split("joint_names_expr=")[1])
        mended = JointPositionAction(joint_names_expr=advice)
        assert {*commander(mended, other).names} == {"left_knee", "left_hip", "right_hip"}
        with pytest.raises(ValueError, match="leave one of the two out"):
            commander(one, one)

    def test_one_command_does_not_reach_into_the_next(self):
        bound = commander(JointPositionAction(joint_names_expr=(".*",)))
        first = bound.command(np.ones(4)).position_target
        kept = first.copy()
        bound.command(-np.ones(4))
        np.testing.assert_array_equal(first, kept)
        np.testing.assert_array_equal(bound.rest().position_target, DEFAULT)


class TestRefusals:
    @pytest.mark.parametrize(
        ("options", "error", "text"),
        [
            ({"joint_names_expr": "hip"}, TypeError, "tuple of expressions"),
            ({"joint_names_expr": ()}, ValueError, "joint_names_expr is empty"),
            ({"joint_names_expr": ("*",)}, ValueError, "no regular expression"),
            ({"scale": np.nan}, ValueError, "scale"),
            ({"scale": "big"}, TypeError, "scale"),
            ({"offset": {".*": np.inf}}, ValueError, "offset"),
            ({"clip": 3.0}, TypeError, r"clip should be \(low, high\), got 3.0"),
            ({"clip": (1, 1)}, ValueError, r"clip should rise from low to high, got \(1, 1\)"),
            ({"clip": (np.nan, 1)}, ValueError, "clip should rise"),
            ({"clip": {".*_hip": (2, 1)}}, ValueError, r"clip\['\.\*_hip'\] should rise"),
        ],
    )
    def test_of_the_term(self, options, error, text):
        with pytest.raises(error, match=text):
            JointPositionAction(**{"joint_names_expr": (".*",), **options})

    @pytest.mark.parametrize(
        ("options", "text"),
        [
            ({"joint_names_expr": ("left_hop",)}, "'left_hop' matches none of.*did you mean"),
            ({"joint_names_expr": ("left_.*", "left_hip")}, "'left_hip' is matched by"),
            ({"scale": {".*_hip": 1.0}}, "scale has no number for 'left_knee', 'right_knee'"),
            ({"offset": {".*": 1.0, "left_hip": 2.0}}, "offset: 'left_hip' is matched by"),
            ({"clip": {"toe": (0, 1)}}, "clip: 'toe' matches none"),
        ],
    )
    def test_of_the_joints(self, options, text):
        term = JointPositionAction(**{"joint_names_expr": (".*",), **options})
        with pytest.raises(ValueError, match=text):
            commander(term)

    def test_of_a_target_that_the_actuator_cannot_follow(self):
        takes = ({POSITION}, {EFFORT}, {POSITION}, {EFFORT})
        with pytest.raises(
            ValueError,
            match=r"JointVelocityAction: the actuator of 'left_hip' cannot follow a "
            r"velocity_target, it takes \['position_target'\]",
        ):
            commander(JointVelocityAction(joint_names_expr=(".*",)), takes=takes)

    @pytest.mark.parametrize("term", [0.5, "hips", JointPositionAction])
    def test_of_what_is_no_term(self, term, tmp_path):
        with pytest.raises(TypeError, match=r"action should be an action term or several, got"):
            dog(tmp_path, action=term)

    def test_base_is_abstract(self):
        with pytest.raises(TypeError, match="abstract"):
            ActionTerm()


class TestFullRange:
    RANGES = ([-1.0, 2.0], [-np.inf, np.inf], [-3.0, -1.0], [-np.inf, np.inf])

    def ends(self, **known):
        bound = commander(FullRangeAction(), **known)
        return [bound.command(np.full(4, value)) for value in (-1.0, 0.0, 1.0)]

    def test_positions_from_end_to_end(self):
        low, middle, high = (cmd.position_target for cmd in self.ends(ranges=self.RANGES))
        np.testing.assert_allclose(low, [-1, DEFAULT[1] - np.pi, -3, DEFAULT[3] - np.pi])
        np.testing.assert_allclose(middle, [0.5, DEFAULT[1], -2, DEFAULT[3]])
        np.testing.assert_allclose(high, [2, DEFAULT[1] + np.pi, -1, DEFAULT[3] + np.pi])

    @given(
        st.lists(bounds, min_size=4, max_size=4), st.lists(numbers(-1, 1), min_size=4, max_size=4)
    )
    def test_never_leaves_the_range(self, ranges, action):
        asked = commander(FullRangeAction(), ranges=ranges).command(action).position_target
        low, high = np.array(ranges).T
        assert ((asked >= low) & (asked <= high)).all()

    def test_velocities_and_efforts(self):
        takes = ({VELOCITY}, {EFFORT}, {VELOCITY, EFFORT}, {EFFORT})
        known = {"speeds": [7, 7, np.inf, 7], "efforts": [3, 4, 3, np.inf]}
        low, middle, high = self.ends(takes=takes, **known)
        np.testing.assert_array_equal(high.velocity_target, [7, 0, 10, 0])
        np.testing.assert_array_equal(high.effort_target, [0, 4, 0, 1])
        np.testing.assert_array_equal(low.velocity_target, -high.velocity_target)
        np.testing.assert_array_equal(low.effort_target, -high.effort_target)
        assert not middle.effort_target.any()
        assert high.position_target is None

    def test_spans_what_is_not_even_about_zero(self):
        known = joints(takes=({EFFORT}, {VELOCITY}, {EFFORT}, {EFFORT}))
        reach = {
            EFFORT: np.array([[-2.0, 10.0], [0, 0], [-np.inf, 4.0], [3.0, 5.0]]),
            VELOCITY: np.array([[0, 0], [-1.0, 3.0], [0, 0], [0, 0]]),
        }
        bound = Commander((FullRangeAction(),), replace(known, reach=reach))
        low, middle, high = (bound.command(np.full(4, value)) for value in (-1.0, 0.0, 1.0))
        np.testing.assert_array_equal(low.effort_target, [-2, 0, -1, 3])
        np.testing.assert_array_equal(middle.effort_target, [4, 0, 0, 4])
        np.testing.assert_array_equal(high.effort_target, [10, 0, 1, 5])
        np.testing.assert_array_equal(
            [low.velocity_target[1], high.velocity_target[1]], [-1.0, 3.0]
        )

    @given(st.lists(numbers(-1e300, 1e300), min_size=4, max_size=4))
    def test_clips_the_action(self, action):
        bound = commander(FullRangeAction(), ranges=self.RANGES)
        np.testing.assert_array_equal(
            bound.command(action).position_target,
            bound.command(np.clip(action, -1, 1)).position_target,
        )

    def test_goes_by_kinematic_order(self):
        takes = ({VELOCITY}, {POSITION}, {EFFORT}, {POSITION})
        bound = commander(FullRangeAction(), takes=takes)
        assert bound.names == NAMES
        np.testing.assert_array_equal(bound.command([0.5, 0, 0, 0]).velocity_target, [5, 0, 0, 0])

    def test_is_what_a_walker_does_by_default(self, tmp_path):
        cfgs = (
            BuiltinVelocityActuatorCfg(joint_names_expr=("f._hip",), damping=0.5),
            BuiltinMotorActuatorCfg(joint_names_expr=("r._hip",), effort_limit=3.0),
            NATIVE,
        )
        spec = dog(tmp_path, actuators=cfgs).action_spec
        assert spec.name.split("\t")[:6] == [
            "fl_hip",
            "fl_knee",
            "fr_hip",
            "fr_knee",
            "rl_hip",
            "rr_hip",
        ]


def test_on_a_walker(tmp_path):
    walker = dog(
        tmp_path,
        actuators=(EXPLICIT, NATIVE, DELAYED),
        action=[
            JointPositionAction(joint_names_expr=(".*_hip",), scale=0.25, clip=(0.3, 0.5)),
            JointEffortAction(joint_names_expr=("fl_hip",), scale=3.0),
        ],
    )
    assert walker.action_spec.name.split("\t") == [
        *("fl_hip", "fr_hip", "rl_hip", "rr_hip", "fl_hip"),
        *("rl_knee", "rr_knee"),
    ]
    environment = composer.Environment(Drive(walker), random_state=0)
    environment.reset()
    walker.apply_action(environment.physics, [1, 0, -1, 0.2, 0.5, 0, 0], None)
    names = walker.actuator_group.joint_names
    asked = dict(zip(names, walker.command.position_target, strict=True))
    assert asked == {
        "fl_hip": 0.5,
        "fl_knee": -0.8,
        "fr_hip": 0.4,
        "fr_knee": -0.8,
        "rl_hip": 0.3,
        "rr_hip": pytest.approx(0.45),
    }
    np.testing.assert_array_equal(walker.command.effort_target, [1.5, 0, 0, 0, 0, 0])
