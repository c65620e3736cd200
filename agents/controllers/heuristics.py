"""Rules that need no learning: hover, circle, restart Phase I, follow the users."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from orchid_uav.agents.controllers.controller import Actions, act_towards, no_actions
from orchid_uav.envs.deployment import gbs_aware_kmeans, kmeans_centroids
from orchid_uav.envs.dynamics import begin_episodes
from orchid_uav.envs.kinematics import chord, circling_displacement_m
from orchid_uav.envs.propulsion import circling_speed_mps, load_factor
from orchid_uav.envs.starts.balanced import most_balanced, restarts_of
from orchid_uav.envs.starts.topologies import Topologies
from orchid_uav.envs.world import WorldBatch

Floats = NDArray[np.float64]

LOITER_RADIUS_M = 40.0
RESTARTS = 30


class Hover:
    """Stays where Phase I puts it; with the power it begins with this is the zero action.

    Args:
        full_power: begin, and stay, at the greatest transmit power instead.
    """

    def __init__(self, full_power: bool = False) -> None:
        self.full_power = full_power

    def begin(self, world: WorldBatch) -> None:
        """Set the transmit power."""
        if self.full_power:
            arrays, greatest_w = world.arrays, world.parameters.uav.max_transmit_power_w
            world.place(arrays.positions_m, np.full_like(arrays.transmit_powers_w, greatest_w))

    def act(self, world: WorldBatch) -> Actions:
        """No action at all."""
        return no_actions(world)


class Loiter:
    """Circles its start at the speed of least propulsion power, with full transmit power.

    Args:
        radius_m: of the circle, less where the area has no room for it; a turn's bank angle is
            ``bank_angle_deg(speed, radius)``.
    """

    def __init__(self, radius_m: float = LOITER_RADIUS_M) -> None:
        if not radius_m > 0.0:
            raise ValueError(f"radius_m is {radius_m}: it is above 0")
        self.radius_m = radius_m

    def begin(self, world: WorldBatch) -> None:
        """Take the present positions as the centres of the circles."""
        self.speed_mps = circling_speed_mps(world.parameters)
        self.circle_m = circle_radius_m(world, self.radius_m)
        self.centres_m = self._inside(world, world.arrays.positions_m[..., :2])

    def _inside(self, world: WorldBatch, centres_m: Floats) -> Floats:
        """Centres moved away from the borders as far as a whole circle needs."""
        high_m = np.array(world.constants.area_size_m) - self.circle_m
        return np.clip(centres_m, self.circle_m, high_m)

    def act(self, world: WorldBatch) -> Actions:
        """On along the circle, or towards it."""
        step_m = self.speed_mps * world.parameters.network.slot_s
        return act_towards(world, self._displacement_m(world, step_m), power_change=1.0)

    def _displacement_m(self, world: WorldBatch, step_m: float) -> Floats:
        relative_m = world.arrays.positions_m[..., :2] - self.centres_m
        moves_m = circling_displacement_m(
            relative_m[..., 0], relative_m[..., 1], self.circle_m, *chord(self.circle_m, step_m)
        )
        return np.stack(moves_m, axis=-1)


class BalancedLoiter(Loiter):
    """Loiters at the best of several K-Means runs by load JFI + rate JFI.

    Args:
        restarts: K-Means++ runs, the world's own Phase I not counted, which also takes part.
        seed: of the restarts.
        keeps_targets: cluster the target users anew, and leave the others to the GBS as they are.
            False restarts Phase I as a whole, which also chooses anew whom the UAVs serve: not
            the task that the other methods have.
        radius_m: of the circle.
    """

    def __init__(
        self,
        restarts: int = RESTARTS,
        seed: int = 0,
        keeps_targets: bool = True,
        radius_m: float = LOITER_RADIUS_M,
    ) -> None:
        super().__init__(radius_m)
        self.restarts = restarts
        self.seed = seed
        self.keeps_targets = keeps_targets

    def begin(self, world: WorldBatch) -> None:
        """Place the UAVs at the best start found."""
        positions_m = world.arrays.positions_m.copy()
        targets = world.arrays.target_users.copy()
        for index in range(world.world_count):
            starts_m, candidates = candidate_starts(
                world, index, self.restarts, self.seed, self.keeps_targets
            )
            best = most_balanced(
                world.parameters,
                world.constants,
                world.users_m[index],
                candidates,
                starts_m,
                world.specialised(begin_episodes),
            )
            positions_m[index, :, :2] = starts_m[best]
            targets[index] = candidates[best]
        world.place(positions_m, target_users=targets)
        super().begin(world)


def candidate_starts(
    world: WorldBatch, index: int, restarts: int, seed: int, keeps_targets: bool = True
) -> tuple[Floats, NDArray[np.bool_]]:
    """Starts (1 + restarts, N, 2) in m of one world, its own first, and target users with each."""
    users_m = world.users_m[index]
    targets = world.arrays.target_users[index]
    starts_m = [world.arrays.positions_m[index, :, :2].copy()]
    target_sets = [targets.copy()]
    for restart_seed in restarts_of(world.arrays.walk_key[index], restarts, seed):
        if keeps_targets and not targets.any():
            starts_m.append(starts_m[0])  # nobody to serve, so that no start is better
            target_sets.append(targets)
        elif keeps_targets:
            starts_m.append(kmeans_centroids(users_m[targets], world.uav_count, restart_seed))
            target_sets.append(targets)
        else:
            phase_one = gbs_aware_kmeans(
                users_m, world.uav_count, world.parameters.gbs_positions_m, restart_seed
            )
            starts_m.append(phase_one.uav_positions_m)
            target_sets.append(phase_one.target_users)
    return np.stack(starts_m), np.stack(target_sets)


def repeat_topology(world: WorldBatch, index: int, count: int) -> Topologies:
    """The present users and UAV positions of one world, ``count`` times."""
    arrays = world.arrays
    return Topologies(
        users_m=np.repeat(world.users_m[index][None], count, axis=0),
        target_users=np.repeat(arrays.target_users[index][None], count, axis=0),
        start_m=np.repeat(arrays.positions_m[index, :, :2][None], count, axis=0),
        shadowing_db=np.zeros((count, world.mast_count, world.user_count)),
        walk_keys=np.repeat(arrays.walk_key[index], count),
    )


class Track(Loiter):
    """Follows the target users: K-Means again every ``period_s``, then loiters on arrival.

    K-Means goes on from the present centres, so that users who stay do not move the fleet; a
    Hungarian assignment sends each centre the UAV with which the sum of the distances is least.

    Args:
        period_s: seconds between two clusterings.
        radius_m: of the circles.
        altitude_m: to climb to, within the flight box; by default it stays where it begins.
    """

    def __init__(
        self,
        period_s: float = 10.0,
        radius_m: float = LOITER_RADIUS_M,
        altitude_m: float | None = None,
    ) -> None:
        super().__init__(radius_m)
        self.period_s = period_s
        self.altitude_m = altitude_m

    def act(self, world: WorldBatch) -> Actions:
        """Towards the newest centre, or round it."""
        period_slots = max(1, round(self.period_s / world.parameters.network.slot_s))
        slot = int(world.arrays.slot[0])
        if slot and slot % period_slots == 0 and world.parameters.network.user_speed_mps > 0.0:
            self._follow(world)
        actions = super().act(world)
        scale_m = world.parameters.uav.displacement_scale_m[2]
        if self.altitude_m is not None and scale_m > 0.0:
            missing_m = self.altitude_m - world.arrays.positions_m[..., 2]
            actions[..., 2] = np.clip(missing_m / scale_m, -1.0, 1.0)
        return actions

    def _follow(self, world: WorldBatch) -> None:
        for index in range(world.world_count):
            targets = world.arrays.target_users[index]
            if targets.sum() < world.uav_count:
                continue
            users_m = world.known_users_m[index][targets]
            centres_m = kmeans_centroids(users_m, world.uav_count, start_m=self.centres_m[index])
            positions_m = world.arrays.positions_m[index, :, :2]
            distances_m = np.linalg.norm(positions_m[:, None] - centres_m[None], axis=-1)
            uavs, centres = linear_sum_assignment(distances_m)
            self.centres_m[index, uavs] = centres_m[centres]
        self.centres_m = self._inside(world, self.centres_m)


def circle_radius_m(world: WorldBatch, radius_m: float) -> float:
    """The radius wanted, or less where the area has no room for it."""
    return min(radius_m, 0.5 * min(world.constants.area_size_m))


def bank_angle_deg(speed_mps: float, radius_m: float) -> float:
    """Bank of a level turn: its load factor is 1 / cos(bank)."""
    return math.degrees(math.acos(1.0 / load_factor(speed_mps**2 / radius_m)))
