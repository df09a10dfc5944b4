"""Whether the effect that was hidden to break a policy is the one that is blamed.

Two policies, each with a robot and its bench:

| policy | what breaks it | what is hidden beside it and does not |
|---|---|---|
| a trot, which looks at nothing | a weak drive | late targets, friction, armature |
| one that balances a rod by what it observes | late targets | friction, armature |

Every seed draws sizes, what is beside, motions and noise. The logs of the bench are diagnosed with
all of these effects to choose from, and the policy is rolled out. Once more without what breaks
it, nothing may be blamed.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
from dm_control import composer

from benchmarks import Row
from walkerkit import gap
from walkerkit.tasks import TrackJoints
from walkerkit.walkers import MjcfWalker

SEEDS, QUICK_SEEDS, REQUIRED = 10, 1, 9
QUIET_SEEDS = 3  # in which nothing that breaks it is hidden
EFFECTS = ("command_delay", "effort_limit", "coulomb_friction", "armature")
EPISODES = 4
Hide = Callable[[mujoco.MjSpec, np.random.Generator], None]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A policy, its robot and its bench.

    Attributes:
        name: what it is of.
        breaker: the effect that breaks the policy.
        hide: puts it into a robot or its bench, at a size that is drawn.
        robot: makes the model in which the policy runs.
        bench: makes the model that is logged and diagnosed.
        log: logs a bench, from its file and a seed.
        policy: makes the policy, from the file of the model in which it runs.
        environment: as `gap.policy_gap` takes it.
        beside: what may be hidden and does not break it, by effect.
    """

    name: str
    breaker: str
    hide: Hide
    bench: Callable[[], mujoco.MjSpec]
    robot: Callable[[], mujoco.MjSpec]
    log: Callable[[Path, int], list[gap.Recording]]
    policy: Callable[[Path], Any]
    environment: Callable[[Any], composer.Environment]
    beside: dict[str, Hide]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What came of one seed.

    Attributes:
        named: the effects of the diagnosis.
        blamed: those that break the policy.
        seconds: wall time.
    """

    named: tuple[str, ...]
    blamed: tuple[str, ...]
    seconds: float


def run(*, quick: bool) -> list[Row]:
    """All seeds of both policies, with what breaks them and without."""
    seeds = range(QUICK_SEEDS if quick else SEEDS)
    rows, vain, tried = [], 0, 0
    for case in (trotting(), balancing()):
        trials = [_told(case, seed, trial(case, seed, broken=True)) for seed in seeds]
        right = sum(one.blamed == (case.breaker,) for one in trials)
        seconds = np.median([one.seconds for one in trials])
        rows.append(
            Row(
                what=f"{case.name}: {case.breaker}, hidden to break it, is blamed alone",
                result=f"{right} of {len(trials)} seeds, {seconds:.0f} s each",
                required=f"{REQUIRED} of {SEEDS}",
            )
        )
        without = seeds[:QUIET_SEEDS]
        quiet = [_told(case, seed, trial(case, seed, broken=False)) for seed in without]
        vain += sum(bool(one.blamed) for one in quiet)
        tried += len(quiet)
    rows.append(
        Row(
            what="nothing that breaks it is hidden: something is blamed",
            result=f"{vain} of {tried} seeds",
            required="0",
        )
    )
    return rows


def trial(case: Case, seed: int, *, broken: bool) -> Trial:
    """Hides, logs, diagnoses and rolls out.

    Args:
        case: the policy.
        seed: of everything.
        broken: whether what breaks the policy is hidden.
    """
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model, bench, real = (folder / f"{one}.xml" for one in ("robot", "bench", "real"))
        model.write_text(case.robot().to_xml())
        bench.write_text(case.bench().to_xml())
        spec, random = case.bench(), np.random.default_rng(seed)
        beside = [*case.beside][random.integers(len(case.beside))]
        case.beside[beside](spec, random)
        if broken:
            case.hide(spec, random)
        real.write_text(spec.to_xml())
        result = gap.diagnose(bench, case.log(real, seed), effects=EFFECTS)
        named = tuple(one.effect for one in result.effects)
        blamed: tuple[str, ...] = ()
        if named:
            blamed = gap.policy_gap(
                case.environment,
                case.policy(model),
                result,
                model=model,
                episodes=EPISODES,
                seed=1000 * seed,
            ).blamed
    return Trial(named=named, blamed=blamed, seconds=time.perf_counter() - start)


def _told(case: Case, seed: int, one: Trial) -> Trial:
    named, blamed = (", ".join(some) or "nothing" for some in (one.named, one.blamed))
    print(f"{case.name}, seed {seed}: named {named}; blamed {blamed}; {one.seconds:.0f} s")
    return one


# What is hidden


def _late(lowest: float, highest: float) -> Hide:
    def hide(spec: mujoco.MjSpec, random: np.random.Generator) -> None:
        delay = random.uniform(lowest, highest)
        step = spec.option.timestep
        for servo in spec.actuators:
            servo.delay, servo.interp = delay, 1
            servo.nsample = int(np.ceil(delay / step)) + 1

    return hide


def _weak(name: str, lowest: float, highest: float) -> Hide:
    def hide(spec: mujoco.MjSpec, random: np.random.Generator) -> None:
        limit = random.uniform(lowest, highest)
        spec.actuator(name).forcerange = [-limit, limit]

    return hide


def _more(attribute: str, joints: Sequence[str], lowest: float, highest: float) -> Hide:
    def hide(spec: mujoco.MjSpec, random: np.random.Generator) -> None:
        for name in joints:
            joint = spec.joint(name)
            setattr(joint, attribute, getattr(joint, attribute) + random.uniform(lowest, highest))

    return hide


# The trot, which is that of the example


def trotting() -> Case:
    """The quadruped of examples/policy.py."""
    example = _example()
    return Case(
        name="trot",
        breaker="effort_limit",
        hide=_weak(f"{example.LEG}_calf", 2.5, 4.5),
        robot=example.quadruped,
        bench=lambda: example.on_a_bench(example.quadruped()),
        log=example.logged,
        policy=example.TrotPolicy,
        environment=example.make_environment,
        beside={
            "command_delay": _late(0.006, 0.02),
            "coulomb_friction": _more("frictionloss", example.MOVED, 0.3, 1.0),
            "armature": _more("armature", example.MOVED, 0.005, 0.02),
        },
    )


def _example() -> ModuleType:
    folder = str(Path(__file__).resolve().parent.parent / "examples")
    sys.path.insert(0, folder)
    try:
        import policy
    finally:
        sys.path.remove(folder)
    return policy  # type: ignore[no-any-return]


# A rod that is balanced, and hangs where it is logged

_ROD = """<mujoco model="rod">
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body name="rod" pos="0 0 1">
    <joint name="hinge" axis="0 1 0" damping="0.02" armature="0.005"/>
    <geom type="capsule" fromto="0 0 0 0 0 {tip}" size="0.02" mass="1" contype="0" conaffinity="0"/>
  </body></worldbody>
  <actuator><position name="hinge" joint="hinge" kp="2" kv="0.02" ctrlrange="-6 6"
    forcerange="-12 12"/></actuator>
</mujoco>
"""
_FALLEN = 0.5  # rad
_NOISE = {"position": 5e-4, "velocity": 0.01, "effort": 0.01}


class Balance(composer.Task):  # type: ignore[misc]
    """Two seconds of a rod upright on its hinge; a fall ends it."""

    def __init__(self, walker: Any):
        self.walker = walker
        self._arena = composer.Arena()
        self._arena.attach(walker)
        self.set_timesteps(
            control_timestep=0.01, physics_timestep=walker.mjcf_model.option.timestep
        )
        for name in ("joints_pos", "joints_vel"):
            walker.observables.as_dict(fully_qualified=False)[name].enabled = True

    @property
    def root_entity(self) -> Any:
        """The world."""
        return self._arena

    def initialize_episode(self, physics: Any, random_state: Any) -> None:
        """Leans it a little."""
        physics.bind(self.walker.observable_joints).qpos = random_state.uniform(-0.1, 0.1, 1)

    def action_spec(self, physics: Any) -> Any:
        """The walker's."""
        del physics
        return self.walker.action_spec

    def before_step(self, physics: Any, action: Any, random_state: Any) -> None:
        """Hands the action to the walker."""
        self.walker.apply_action(physics, action, random_state)

    def get_reward(self, physics: Any) -> float:
        """1 while it is upright."""
        return float(np.cos(physics.bind(self.walker.observable_joints).qpos[0]))

    def should_terminate_episode(self, physics: Any) -> bool:
        """It has fallen."""
        return bool(abs(physics.bind(self.walker.observable_joints).qpos[0]) > _FALLEN)

    def get_discount(self, physics: Any) -> float:
        """0 on a fall."""
        return 0.0 if self.should_terminate_episode(physics) else 1.0


def balancing() -> Case:
    """A rod that a policy keeps upright, through a servo that is too soft to do so alone."""
    return Case(
        name="balance",
        breaker="command_delay",
        hide=_late(0.05, 0.08),
        robot=lambda: mujoco.MjSpec.from_string(_ROD.format(tip=0.5)),
        bench=lambda: mujoco.MjSpec.from_string(_ROD.format(tip=-0.5)),
        log=_logged,
        policy=lambda model: _balances,
        environment=lambda robot: composer.Environment(Balance(robot.walker()), time_limit=2.0),
        beside={
            "coulomb_friction": _more("frictionloss", ("hinge",), 0.01, 0.04),
            "armature": _more("armature", ("hinge",), 0.005, 0.02),
        },
    )


def _balances(timestep: Any) -> Any:
    """A target against lean and speed: the servo's 2 N·m/rad times 6 rad is an action of 1."""
    lean, speed = (float(np.ravel(value)[0]) for value in timestep.observation.values())
    return np.clip([-3.0 * lean - 0.2 * speed], -1.0, 1.0)


def _logged(model: Path, seed: int) -> list[gap.Recording]:
    random = np.random.default_rng(seed)
    found = []
    for excitation in ("steps", "chirp", "multisine"):
        task = TrackJoints(
            MjcfWalker.from_file(model), excitation=excitation, seconds=5.0, max_velocity=6.0
        )
        environment = composer.Environment(task, random_state=seed)
        log = gap.record(environment, every="physics_step")
        columns = {
            name: values + random.normal(0.0, _NOISE.get(name.partition("/")[2], 0.0), len(values))
            for name, values in log.columns.items()
        }
        found.append(gap.Recording(name=excitation, time=log.time, columns=columns))
    return found
