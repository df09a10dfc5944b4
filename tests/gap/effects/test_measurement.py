"""Between the joint and its log."""

import numpy as np
import pytest

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import CHANNELS, Machine
from walkerkit.gap.recordings.segments import Segment, cut, windows
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.trials import Trials


class TestEncoderOffset(EffectContract):
    name = "encoder_offset"

    def plant(self, machine):
        machine.offset[1] = 0.047
        return {"knee": [0.047]}


class TestEncoderGain(EffectContract):
    name = "encoder_gain"

    def plant(self, machine):
        # A servo of 1.06 q is one of 1.06 times the gains whose targets are as much smaller.
        knee = machine.model.actuator("k")
        knee.gainprm[0], knee.biasprm[1:3] = 1.06 * 30, (-1.06 * 30, -1.06 * 1)

        def smaller(now):
            now.target[1] /= 1.06

        machine.controller = smaller
        machine.shown = lambda q: q * [1, 1.06]
        return {"knee": [0.06]}


class TestClockSkew(EffectContract):
    name = "clock_skew"

    def plant(self, machine):
        machine.clock = 1.004
        return {"*": [0.004]}


class TestKinematicError(EffectContract):
    name = "kinematic_error"
    idle = ("periods", "phase")

    def plant(self, machine):
        machine.shown = lambda q: q + [0, 0.004] * np.sin(12 * q + 0.7)
        return {"knee": [0.004, 12, 0.7]}


class TestClock:
    """A clock that runs away from that of the targets, in windows far into the log."""

    @pytest.mark.parametrize("rate", [1.006, 0.994])
    @pytest.mark.parametrize("length", [None, 0.5])
    def test_windows_start_where_the_robot_was(self, plain, rate, length):
        robot, _ = plain
        machine = Machine(robot)
        machine.clock = rate
        recording = machine.log()
        replay = Replay(robot, cut([recording], length), CHANNELS)
        trials = Trials(robot, 2)
        for skew in trials.clock_skew.values():
            skew[1] = rate - 1
        late = (
            replay.time_of_row + np.array([s.start for s in replay.segments])[replay.segment_of_row]
        )
        # Beyond the last target nothing is known of what the robot did.
        known = late / rate < recording.time[-1]
        gap = (replay.predict(trials) - replay.measured)[:, known]
        blind, right = np.sqrt(np.mean(gap[:, :, :2] ** 2, axis=(1, 2)))
        assert right < 0.03 * blind
        assert right < 3e-4

    def test_clocks_agree_at_the_beginning_of_the_whole_log(self, plain):
        robot, recording = plain
        trials = Trials(robot, 1)
        for skew in trials.clock_skew.values():
            skew += 0.01
        (segment,) = windows(recording.between(2.0, 3.0), 1.0)
        first = int(np.searchsorted(recording.time, segment.start))
        same = Segment(recording=recording, first=first, last=first + segment.last - segment.first)
        part, of_whole, blind = (
            Replay(robot, [some], CHANNELS).predict(one)[..., :2]
            for some, one in ((segment, trials), (same, trials), (same, Trials(robot, 1)))
        )
        np.testing.assert_allclose(part, of_whole, atol=1e-3)
        assert np.abs(blind - of_whole).max() > 0.02
