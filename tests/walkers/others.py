"""What any robot that others wrote has to do as a walker, whatever its file is like."""

from __future__ import annotations

import mujoco
import numpy as np
from dm_control import composer, mjcf

from tests.walkers.robots import Drive, without_camera
from walkerkit.actuators import (
    ActuatorCmd,
    BuiltinMotorActuatorCfg,
    BuiltinPositionActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    XmlMotorActuatorCfg,
)
from walkerkit.walkers import MjcfWalker


def driven(model):
    """Names of the joints that have an actuator, in the order of the actuators."""
    return tuple(model.joint(model.actuator_trnid[i, 0]).name for i in range(model.nu))


def scalar(model):
    """Names of the hinges and slides, in kinematic order."""
    return [model.joint(i).name for i in range(model.njnt) if model.jnt_type[i] >= 2]


def gentle(model, names):
    """Gains that explicit integration bears, of each joint, for the inertia that it moves."""
    inertia = {name: 1 / model.dof_invweight0[model.joint(name).dofadr[0]] for name in names}
    h = model.opt.timestep
    stiffness = {name: 0.02 * each / h**2 for name, each in inertia.items()}
    return stiffness, {name: 0.2 * each / h for name, each in inertia.items()}


def mixed(model, names):
    """Explicit, native, and delayed behind a DC motor, in turns."""
    stiffness, damping = gentle(model, names)

    def gains(chosen):
        return {
            "joint_names_expr": tuple(chosen),
            "stiffness": {name: stiffness[name] for name in chosen},
            "damping": {name: damping[name] for name in chosen},
        }

    cfgs = [IdealPdActuatorCfg(**gains(names[::3]))]
    if names[1::3]:
        cfgs.append(BuiltinPositionActuatorCfg(**gains(names[1::3])))
    if names[2::3]:
        motor = DcMotorActuatorCfg(
            **gains(names[2::3]), saturation_effort=50.0, velocity_limit=40.0, effort_limit=30.0
        )
        cfgs.append(DelayedActuatorCfg(base_cfg=motor, delay_max_lag=2))
    return cfgs


def check_steps(path, model):
    """Its own actuators replaced, in an arena, with resets; the order of joints is the model's."""
    names = driven(model) or tuple(scalar(model))
    walker = MjcfWalker.from_file(path, mixed(model, names))
    in_order = [name for name in scalar(model) if name in names]
    assert list(walker.actuator_group.joint_names) == in_order
    assert not walker.drivetrain.kept
    walker.observables.enable_all()
    without_camera(walker)
    task = Drive(walker, timestep=model.opt.timestep, substeps=5)
    environment = composer.Environment(task, random_state=0, strip_singleton_obs_buffer_dim=True)
    random_state = np.random.RandomState(1)
    for _ in range(2):
        environment.reset()
        physics = environment.physics
        compiled = physics.model.ptr
        prefix = walker.mjcf_model.full_identifier
        group = walker.actuator_group
        assert [compiled.joint(i).name for i in group.joint_ids] == [prefix + n for n in in_order]
        for element, name in zip(group.elements, in_order, strict=True):
            actuator = compiled.actuator(element.full_identifier)
            assert compiled.joint(actuator.trnid[0]).name == prefix + name
        hold = walker.action_for()
        for _ in range(40):
            action = hold + random_state.uniform(-0.1, 0.1, hold.shape)
            timestep = environment.step([action])
            for name, value in timestep.observation.items():
                assert np.isfinite(value).all(), name
        seen = timestep.observation[f"{prefix}joints_pos"]
        addresses = [
            compiled.joint(prefix + joint.name).qposadr[0] for joint in walker.observable_joints
        ]
        np.testing.assert_array_equal(seen, physics.data.qpos[addresses])


def check_trajectory(path, model, steps=500, tolerance=1e-9):
    """Its own motors taken over: it moves as the plain model does, to the last digits.

    A robot that floats does so in an arena with the file's options, and without the file's scene.
    One without motors gets some, which rest.
    """
    names = driven(model)
    taken_over = XmlMotorActuatorCfg(joint_names_expr=names) if names else None
    motors = taken_over or BuiltinMotorActuatorCfg(joint_names_expr=(".*",), effort_limit=1.0)
    walker = MjcfWalker.from_file(path, motors)
    root, reference = walker.mjcf_model, model
    if walker.floating:
        reference = without_world(path)
        arena = composer.Arena()
        walker.create_root_joints(arena.attach(walker))
        root = arena.mjcf_model
        root.option.noslip_iterations = 0
        root.option.cone = "pyramidal"
        del root.compiler.boundmass, root.compiler.boundinertia
    root.option.timestep = model.opt.timestep
    physics = mjcf.Physics.from_mjcf_model(root)
    walker.after_compile(physics, None)
    with physics.reset_context():
        physics.data.qpos[:] = reference.qpos0
        walker.actuator_group.reset()
    data = mujoco.MjData(reference)
    order = [walker.actuator_group.joint_names.index(name) for name in names]
    effort = reference.actuator_gear[:, 0] * reference.actuator_gainprm[:, 0]
    limit = np.where(reference.actuator_ctrllimited, reference.actuator_ctrlrange[:, 1], 1.0)
    random_state = np.random.RandomState(0)
    for _ in range(steps):
        data.ctrl[:] = 0.3 * limit * random_state.uniform(-1, 1, reference.nu)
        asked = np.zeros(len(walker.actuator_group.joint_names))
        asked[order] = effort * data.ctrl
        walker.command = ActuatorCmd(effort_target=asked)
        walker.before_substep(physics, random_state)
        physics.step()
        mujoco.mj_step(reference, data)
        np.testing.assert_allclose(physics.data.qpos, data.qpos, atol=tolerance, rtol=0)
    assert np.abs(data.qpos - reference.qpos0).max() > 0.01


def without_world(path):
    """The model of a file without what is fixed to its world."""
    spec = mujoco.MjSpec.from_file(str(path))
    world = spec.worldbody
    for element in (*world.geoms, *world.lights, *world.cameras):
        spec.delete(element)
    return spec.compile()
