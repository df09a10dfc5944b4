"""A floor to stand on: the smallest composer task that hands its action to a walker."""

from dm_control import composer
from dm_control.locomotion.arenas import floors


class OnFloor(composer.Task):
    """Walkers on a floor, one action for all of them in a row.

    Args:
        walkers: the walkers.
        positions: where each is attached, for those that do not float.
    """

    def __init__(self, *walkers, positions=None, control_timestep=0.02, physics_timestep=0.002):
        self.walkers = walkers
        self._arena = floors.Floor()
        for i, walker in enumerate(walkers):
            frame = self._arena.attach(walker)
            walker.create_root_joints(frame)
            if positions is not None:
                frame.pos = positions[i]
        self.set_timesteps(control_timestep, physics_timestep)

    @property
    def root_entity(self):
        return self._arena

    def before_step(self, physics, action, random_state):
        first = 0
        for walker in self.walkers:
            last = first + walker.action_spec.shape[0]
            walker.apply_action(physics, action[first:last], random_state)
            first = last

    def get_reward(self, physics):
        return 0.0


def on_floor(*walkers, seed=0, **options):
    """An environment of walkers on a floor, after its first reset."""
    environment = composer.Environment(
        OnFloor(*walkers, **options), random_state=seed, strip_singleton_obs_buffer_dim=True
    )
    environment.reset()
    return environment
