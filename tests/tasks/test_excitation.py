import numpy as np
import pytest

from walkerkit.tasks.excitation import (
    BATTERY,
    Excitation,
    chirp,
    fast_sine,
    micro_sine_on_ramp,
    multisine,
    slow_triangle,
    steps,
)

RATE = 500.0
TIME = np.arange(6000) / RATE
LOWER = np.array([-0.6, 0.1, -2.2])
UPPER = np.array([0.6, 1.5, -0.8])
MIDDLE = (LOWER + UPPER) / 2
HALF = (UPPER - LOWER) / 2
GENTLE = sorted(set(BATTERY) - {"steps"})

each = pytest.mark.parametrize("name", sorted(BATTERY))


def targets(signal, seed=0, time=TIME, lower=LOWER, upper=UPPER, **options):
    rng = np.random.default_rng(seed)
    return signal(time, lower=lower, upper=upper, rng=rng, **options)


def slope(path, time=TIME):
    return np.diff(path, axis=0) / np.diff(time)[:, None]


def share_of_power(path, low, high):
    power = np.abs(np.fft.rfft(path - path.mean(axis=0), axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(path), 1 / RATE)
    band = (frequency >= low) & (frequency <= high)
    return power[band].sum(axis=0) / power.sum(axis=0)


@each
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("max_velocity", [None, 3.0])
def test_stays_in_the_room_and_uses_it(name, seed, max_velocity):
    path = targets(BATTERY[name], seed, max_velocity=max_velocity)
    assert path.shape == (TIME.size, 3)
    assert np.all(np.isfinite(path))
    assert np.all((path >= LOWER) & (path <= UPPER))
    used = np.ptp(path, axis=0) / (UPPER - LOWER)
    assert np.all(used > (0.05 if name == "fast_sine" or max_velocity else 0.6))


@each
def test_starts_and_ends_at_the_middle(name):
    path = targets(BATTERY[name])
    np.testing.assert_allclose(path[0], MIDDLE, atol=1e-9)
    np.testing.assert_allclose(path[-1], MIDDLE, atol=1e-9)


@pytest.mark.parametrize("name", GENTLE)
def test_starts_and_ends_at_rest_without_jumps(name):
    speed = slope(targets(BATTERY[name]))
    assert np.abs(speed[[0, -1]]).max() < 1e-3
    # A jump of the target by a hundredth of the room would be a speed of 5 rooms a second more.
    finer = np.linspace(0, TIME[-1], 4 * TIME.size)
    peak = np.abs(slope(targets(BATTERY[name], time=finer), finer)).max()
    assert peak < 1.05 * np.abs(speed).max()


@each
def test_same_seed_same_targets_other_seed_others(name):
    np.testing.assert_array_equal(targets(BATTERY[name], 3), targets(BATTERY[name], 3))
    assert not np.allclose(targets(BATTERY[name], 3), targets(BATTERY[name], 4))


@each
def test_joints_move_out_of_phase(name):
    path = (targets(BATTERY[name]) - MIDDLE) / HALF
    assert np.abs(np.corrcoef(path.T) - np.eye(3)).max() < 0.9


@each
@pytest.mark.parametrize("bound", [2.0, np.array([1.0, 2.0, 4.0])])
def test_keeps_to_the_velocity_bound(name, bound):
    speed = np.abs(slope(targets(BATTERY[name], max_velocity=bound)))
    assert np.all(speed <= bound * (1 + 1e-9))
    # A bound that nothing exceeds changes nothing.
    free = targets(BATTERY[name])
    loose = targets(BATTERY[name], max_velocity=1e6)
    np.testing.assert_allclose(loose, free, rtol=1e-12)


@each
@pytest.mark.parametrize("joints", [1, 7])
def test_any_number_of_joints_and_a_late_irregular_clock(name, joints):
    rng = np.random.default_rng(5)
    time = 100.0 + np.cumsum(rng.uniform(0.001, 0.009, 400))
    path = targets(BATTERY[name], time=time, lower=np.zeros(joints), upper=np.ones(joints))
    assert path.shape == (400, joints)
    assert np.all((path >= 0) & (path <= 1))
    np.testing.assert_allclose(path[[0, -1]], 0.5, atol=1e-9)


def test_chirp_sweeps_the_promised_octaves():
    path = targets(chirp, start_frequency=0.2, end_frequency=6.0)
    assert share_of_power(path, 0.1, 6.5).min() > 0.98
    # Exponential: the middle of the time is the geometric middle of the band, 1.1 Hz.
    window = slice(2500, 3500)
    crossings = np.diff(np.signbit(path[window] - MIDDLE).astype(int), axis=0).astype(bool)
    measured = crossings.sum(axis=0) / (2 * 1000 / RATE)
    np.testing.assert_allclose(measured, np.sqrt(0.2 * 6.0), atol=0.35)


def test_bounded_chirp_falls_with_frequency_instead_of_shrinking_as_a_whole():
    bounded = targets(chirp, max_velocity=5.0) - MIDDLE
    early, late = np.abs(bounded[1000:3000]).max(axis=0), np.abs(bounded[5000:5500]).max(axis=0)
    assert np.all(early > 0.9 * HALF)
    np.testing.assert_array_less(late, 0.4 * HALF)


def test_multisine_fills_its_band_and_no_two_joints_share_a_tone():
    path = targets(multisine, lowest_frequency=0.5, highest_frequency=5.0, tones=5)
    assert share_of_power(path, 0.4, 5.1).min() > 0.98
    power = np.abs(np.fft.rfft((path - MIDDLE) * np.hanning(TIME.size)[:, None], axis=0)) ** 2
    frequency = np.fft.rfftfreq(TIME.size, 1 / RATE)
    for joint in range(3):
        tones = 0.5 * 10 ** ((np.arange(5) + joint / 3) / 5)
        for tone in tones[tones > 1.5]:
            at = np.abs(frequency - tone).argmin()
            assert np.argmax(power[at]) == joint
        # Equal speed: ten times the frequency is a hundredth of the power.
        assert power[np.abs(frequency - tones[0]).argmin(), joint] > 10 * power[at, joint]


def test_slow_triangle_is_constant_speed_between_reversals():
    speed = slope(targets(slow_triangle, period=4.0))[600:-600]
    expected = 4 * HALF / 4.0
    constant = np.isclose(np.abs(speed), expected, rtol=1e-9)
    assert np.all(constant.mean(axis=0) > 0.99)
    assert np.all((speed > 0).any(axis=0) & (speed < 0).any(axis=0))


def test_steps_jump_at_the_joints_own_times_from_side_to_side():
    path = targets(steps, hold=1.5, smallest=0.3)
    jumps = [np.flatnonzero(np.diff(path[:, j])) for j in range(3)]
    assert len(np.unique(np.concatenate(jumps))) == sum(len(j) for j in jumps)
    for joint, at in enumerate(jumps):
        assert len(at) == 6
        np.testing.assert_allclose(np.diff(at), 1.5 * RATE, atol=1)
        assert TIME[-1] - TIME[at[-1]] >= 1.5
        levels = ((path[:, joint] - MIDDLE[joint]) / HALF[joint])[at[1:]]
        assert np.all(np.abs(levels) > 0.3 - 1e-9)
        assert np.all(levels[1:] * levels[:-1] < 0)


def test_bounded_steps_are_ramps_that_arrive():
    free, bounded = targets(steps), targets(steps, max_velocity=6.0)
    np.testing.assert_allclose(np.abs(slope(bounded)).max(axis=0), 6.0)
    assert np.all(np.isclose(free, bounded).mean(axis=0) > 0.6)


def test_fast_sine_is_one_tone_of_the_promised_size():
    path = targets(fast_sine, frequency=4.0, share=0.2)
    assert share_of_power(path, 3.5, 4.5).min() > 0.99
    np.testing.assert_allclose(np.abs(path - MIDDLE).max(axis=0), 0.2 * HALF, rtol=1e-3)


def test_micro_sine_reverses_all_over_the_room():
    path = targets(micro_sine_on_ramp)
    for joint in range(3):
        turns = np.flatnonzero(np.diff(np.signbit(np.diff(path[500:-500, joint])).astype(int)))
        assert len(turns) >= 2 * 3.0 * 9.5
        visited = np.histogram(path[500:-500][turns, joint], 8, (LOWER[joint], UPPER[joint]))[0]
        assert np.all(visited > 0)


def test_battery_says_what_each_is_for():
    assert len(BATTERY) == 6
    for name, excitation in BATTERY.items():
        assert isinstance(excitation, Excitation)
        assert excitation.name == name == excitation.signal.__name__
        assert 20 < len(excitation.description) <= 88
        assert "\n" not in excitation.description
    with pytest.raises(TypeError):
        BATTERY["other"] = BATTERY["chirp"]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"time": TIME[::-1]}, r"time of shape \(6000,\) must be one row"),
        ({"time": [0.0]}, r"time of shape \(1,\)"),
        ({"time": [0.0, np.nan, 1.0]}, "increasing seconds"),
        ({"lower": LOWER[:2]}, r"lower of shape \(2,\) and upper of shape \(3,\)"),
        ({"lower": UPPER}, "must be below upper"),
        ({"upper": np.full(3, np.inf)}, "give an unlimited joint limits of its own"),
        ({"max_velocity": 0.0}, "max_velocity is 0.0; it must be positive"),
        ({"max_velocity": [1.0, 2.0]}, "one for each of the 3 joints"),
    ],
)
@each
def test_refuses_unusable_rooms(name, changed, message):
    with pytest.raises(ValueError, match=message):
        targets(BATTERY[name], **changed)


@pytest.mark.parametrize(
    ("signal", "options", "message"),
    [
        (chirp, {"start_frequency": 9.0}, "start_frequency 9.0 Hz must lie above 0 and below"),
        (chirp, {"end_frequency": np.inf}, "end_frequency inf Hz"),
        (multisine, {"lowest_frequency": 0.0}, "lowest_frequency 0.0 Hz"),
        (multisine, {"tones": 0}, "tones is 0"),
        (slow_triangle, {"period": 0.0}, "period is 0.0; it must be positive"),
        (steps, {"hold": -1.0}, "hold is -1.0"),
        (steps, {"smallest": 1.5}, "smallest is 1.5"),
        (fast_sine, {"frequency": np.nan}, "frequency is nan"),
        (fast_sine, {"share": 0.0}, "share is 0.0"),
        (micro_sine_on_ramp, {"frequency": 0.0}, "frequency is 0.0"),
        (micro_sine_on_ramp, {"period": -2.0}, "period is -2.0"),
        (micro_sine_on_ramp, {"share": 2.0}, "share is 2.0"),
    ],
)
def test_refuses_unusable_options(signal, options, message):
    with pytest.raises(ValueError, match=message):
        targets(signal, **options)
