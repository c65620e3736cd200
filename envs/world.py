"""B independent worlds, stepped together."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orchid_uav.envs import channel
from orchid_uav.envs.arrays import ACTION_SIZE, Constants, Worlds, state_size
from orchid_uav.envs.compilation import specialised
from orchid_uav.envs.dynamics import begin_episodes, step_worlds
from orchid_uav.envs.extensions import Extensions, checked, own_path_loss
from orchid_uav.envs.knowledge.counterfactuals import shifts_m
from orchid_uav.envs.knowledge.informed import INFORMED_SIZE, inform_worlds
from orchid_uav.envs.metrics import EPISODE_METRICS, SLOT_METRICS, SUMMED_OVER_SLOTS
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.seeds import FLIGHT_SENSING_STREAM, world_seeds
from orchid_uav.envs.sharing import equal_share, user_rate_bps
from orchid_uav.envs.starts.stations import spread_out
from orchid_uav.envs.starts.topologies import Topologies, draw_topology
from orchid_uav.envs.threads import parts_of, run_each
from orchid_uav.envs.users import check_user_positions

_IS_SUMMED = np.array([name in SUMMED_OVER_SLOTS for name in EPISODE_METRICS])


def _check(
    name: str, values: NDArray[np.float64], shape: tuple[int, ...], limits: NDArray[np.float64]
) -> None:
    if values.shape != shape:
        raise ValueError(f"{name} has shape {values.shape}, not {shape}")
    if not ((values >= limits[0]) & (values <= limits[1])).all():  # NaN compares false
        raise ValueError(f"{name} is not everywhere within its limits: {limits.tolist()}")


class WorldBatch:
    """B worlds × N UAVs × M users as arrays.

    Every world owns a generator, so given the same actions its course depends on its own seed
    alone, whatever B is. ``step`` has no Python loop over worlds, UAVs or users; ``reset`` loops
    over the worlds that begin, as K-Means runs once for each.

    Args:
        parameters: the network; Table I by default.
        worlds: number B of worlds.
        seed: a seed for the batch, from which :func:`world_seeds` makes one per world, or the
            worlds' own seeds. Without, the worlds are seeded from the operating system.
        user_positions_m: the caller's own users, (M, 2) in m: every episode begins with them, and
            their number replaces ``network.user_count``.
        threads: over which the worlds of large batches are divided; changes no number. One by
            default, as trainings are better run side by side.
        own: the caller's own parts, see :class:`Extensions`.

    Raises:
        ValueError: seeds, user positions or parts that do not fit.
    """

    def __init__(
        self,
        parameters: Parameters | None = None,
        worlds: int = 1,
        seed: int | Sequence[int] | None = None,
        user_positions_m: ArrayLike | None = None,
        threads: int = 1,
        **own: Unpack[Extensions],
    ) -> None:
        parameters = parameters or Parameters()
        for name, number in (("worlds", worlds), ("threads", threads)):
            if number < 1:
                raise ValueError(f"{name} is {number}: at least 1 is needed")
        self.threads = threads
        self._given_users_m = None
        if user_positions_m is not None:
            self._given_users_m = check_user_positions(user_positions_m, parameters)
            parameters = parameters.with_overrides({"network.user_count": len(self._given_users_m)})
        self.parameters = parameters
        self.constants = Constants.of(parameters)
        self.air_to_ground_path_loss_db = own.get("air_to_ground_path_loss_db")
        self._own_path_loss = None
        if self.air_to_ground_path_loss_db is not None:
            self._own_path_loss = own_path_loss(self.air_to_ground_path_loss_db, self.constants)
            self.constants = self.constants._replace(link=self._own_path_loss.link)
        self._begin_episodes = self.specialised(begin_episodes)
        self._step_worlds = self.specialised(step_worlds)
        self._observe, self._extra_reward = own.get("observe"), own.get("extra_reward")
        self.own_observation_size: int | None = None
        """Numbers in an observation of the caller's own."""
        self.world_count = worlds
        self.uav_count = parameters.network.uav_count
        self.user_count = parameters.network.user_count
        self.mast_count = len(parameters.gbs_positions_m)
        self.state_size = state_size(self.uav_count)
        self.progress = 0.0
        self.arrays = Worlds.zeros(self.constants, worlds, self.uav_count, self.user_count)
        self.start_shift_m = np.zeros((worlds, self.uav_count))
        """How far each UAV starts from where it was put, as stations keep apart (M38), (B, N)."""
        self.arrays.slot[:] = parameters.network.episode_slots  # no episode has begun
        self._shadowing_db = np.zeros((worlds, self.mast_count, self.user_count))
        self._forgotten_slots = np.zeros(worlds, np.int64)
        self.generators = [np.random.default_rng(0)] * worlds
        self.seed(seed)
        if self._observe is not None:
            trial = WorldBatch(
                parameters,
                seed=0,
                user_positions_m=self._given_users_m,
                air_to_ground_path_loss_db=self.air_to_ground_path_loss_db,
            )
            trial.reset()
            seen = checked("observe", self._observe(trial), (1, self.uav_count, -1), np.float32)
            self.own_observation_size = seen.shape[-1]

    def seed(self, seed: int | Sequence[int] | None, worlds: ArrayLike | None = None) -> None:
        """Give the given worlds, or all, new generators; takes effect at the next reset.

        A world's seed does not depend on which others are given.
        """
        if seed is None:
            seeds: Sequence[int | None] = [None] * self.world_count
        elif isinstance(seed, int | np.integer):
            seeds = world_seeds(int(seed), self.world_count)
        else:
            seeds = seed
        if len(seeds) != self.world_count:
            raise ValueError(f"{len(seeds)} seeds for {self.world_count} worlds")
        chosen = range(self.world_count) if worlds is None else np.asarray(worlds, np.int64)
        for world in chosen:
            self.generators[world] = np.random.default_rng(seeds[world])

    def set_progress(self, progress: float) -> None:
        """Training progress tau of the weight schedules, clipped to 1 (decision M9)."""
        if not progress >= 0.0:
            raise ValueError(f"training progress is {progress}: it lies in [0, 1]")
        self.progress = min(float(progress), 1.0)

    def reset(self, worlds: ArrayLike | None = None) -> None:
        """Begin a new episode in the given worlds (indices), or in all: new users, Phase I."""
        chosen = np.arange(self.world_count) if worlds is None else np.asarray(worlds, np.int64)
        self.use_topology(self.draw_topologies(chosen), chosen)

    def draw_topologies(self, worlds: ArrayLike | None = None) -> Topologies:
        """Draw what new episodes of the given worlds, or of all, would begin with.

        Worlds of equal seeds that differ in nothing but reward, shares, start or a policy draw the
        same users, targets, shadowing and walks.
        """
        chosen = np.arange(self.world_count) if worlds is None else np.asarray(worlds, np.int64)
        drawn = Topologies.empty(len(chosen), self.uav_count, self.user_count, self.mast_count)
        for row, world in enumerate(chosen):
            draw_topology(
                drawn,
                row,
                self.parameters,
                self.constants,
                self._given_users_m,
                self.generators[world],
                self._begin_episodes,
            )
        return drawn

    def use_topology(self, topologies: Topologies, worlds: ArrayLike | None = None) -> None:
        """Begin an episode on given topologies, one for each of the given worlds, or of all."""
        chosen = np.arange(self.world_count) if worlds is None else np.asarray(worlds, np.int64)
        arrays, uav = self.arrays, self.parameters.uav
        area_size_m = self.constants.area_size_m
        self.users_m[chosen] = topologies.users_m
        arrays.target_users[chosen] = topologies.target_users
        # A centroid of users at the border may lie beyond it by a rounding error.
        arrays.positions_m[chosen, :, :2] = np.clip(topologies.start_m, 0.0, area_size_m)
        self._keep_stations_apart(chosen)
        if not self.constants.senses_truth:
            for world, key in zip(chosen, topologies.walk_keys, strict=True):
                arrays.sensing_error_m[world] = self._sensing_error_m(int(key))
        arrays.positions_m[chosen, :, 2] = uav.initial_altitude_m
        arrays.transmit_powers_w[chosen] = uav.start_power_w
        arrays.walk_key[chosen] = topologies.walk_keys
        self._shadowing_db[chosen] = topologies.shadowing_db
        self._begin(chosen)

    def place(
        self,
        positions_m: ArrayLike,
        transmit_powers_w: ArrayLike | None = None,
        target_users: ArrayLike | None = None,
    ) -> None:
        """Place all UAVs by hand, instead of where Phase I puts them, before the first slot.

        Args:
            positions_m: (B, N, 3), inside the flight box.
            transmit_powers_w: (B, N), within the limits; by default as they are.
            target_users: (B, M) or (M,), whom the UAVs are there for; by default as it is.

        Raises:
            ValueError: a shape or a value that does not fit.
            RuntimeError: an episode has gone on already, or none has begun.
        """
        if self.arrays.slot.any():
            raise RuntimeError("UAVs can be placed only between reset() and the first step()")
        uav = self.parameters.uav
        positions = np.asarray(positions_m, np.float64)
        low = (0.0, 0.0, uav.min_altitude_m)
        high = (*self.constants.area_size_m, uav.max_altitude_m)
        _check("positions_m", positions, self.arrays.positions_m.shape, np.array([low, high]))
        powers_w = self.arrays.transmit_powers_w
        if transmit_powers_w is not None:
            powers_w = np.asarray(transmit_powers_w, np.float64)
            limits = np.array([uav.min_transmit_power_w, uav.max_transmit_power_w])
            _check("transmit_powers_w", powers_w, self.arrays.transmit_powers_w.shape, limits)
        targets = self.arrays.target_users
        if target_users is not None:
            targets = np.broadcast_to(np.asarray(target_users, np.bool_), targets.shape)
        self.arrays.transmit_powers_w[:] = powers_w
        self.arrays.target_users[:] = targets
        self.arrays.positions_m[:] = positions
        chosen = np.arange(self.world_count)
        self._keep_stations_apart(chosen)
        self._begin(chosen)

    def _keep_stations_apart(self, chosen: NDArray[np.int64]) -> None:
        """Move UAVs that begin to stations that keep their distance (M38)."""
        if not self.constants.flies_stations:
            return
        margin_m = self.constants.circle_radius_m
        low_m = np.array([margin_m, margin_m])
        high_m = self.constants.area_size_m - low_m
        for world in chosen:
            wanted_m = self.arrays.positions_m[world, :, :2].copy()
            starts_m = spread_out(wanted_m, self.constants.centre_spacing_m, low_m, high_m)
            self.arrays.positions_m[world, :, :2] = starts_m
            self.start_shift_m[world] = np.linalg.norm(starts_m - wanted_m, axis=1)

    def _sensing_error_m(self, walk_key: int) -> NDArray[np.float64]:
        """Error of one episode on the users' positions in flight, (2, M) (M39)."""
        generator = np.random.default_rng([walk_key, FLIGHT_SENSING_STREAM])
        std_m = self.parameters.sensing.flight_error_std_m
        return generator.normal(0.0, std_m, (2, self.user_count))

    def _begin(self, chosen: NDArray[np.int64]) -> None:
        self._forgotten_slots[chosen] = 0
        links = self.uav_count * self.user_count
        run_each(
            lambda part: self._begin_episodes(self.constants, self.arrays, chosen[part]),
            parts_of(len(chosen), links, self.threads),
        )

    def divide(self, function: Callable[[slice, Worlds], None]) -> None:
        """Call a function with ranges of worlds and views of their arrays, side by side."""
        parts = parts_of(self.world_count, self.uav_count * self.user_count, self.threads)
        if len(parts) == 1:
            function(parts[0], self.arrays)
        else:
            run_each(lambda part: function(part, self.arrays.part(part)), parts)

    def step(self, actions: ArrayLike) -> None:
        """Move every world on by one slot; the outcome is in ``arrays``.

        Args:
            actions: (B, N, 4), clipped to [-1, 1]: x, y, z, transmit power.

        Raises:
            ValueError: wrong shape, or a number that is not finite.
            RuntimeError: an episode is over, or none has begun.
        """
        wanted = np.ascontiguousarray(actions, dtype=np.float64)
        shape = (self.world_count, self.uav_count, ACTION_SIZE)
        if wanted.shape != shape:
            raise ValueError(f"actions have shape {wanted.shape}, not (worlds, UAVs, 4) = {shape}")
        if not np.isfinite(wanted).all():
            raise ValueError("an action is not a finite number")
        if self.finished.any():
            raise RuntimeError("an episode is over or has not begun: call reset() first")
        self.divide(
            lambda part, worlds: self._step_worlds(
                self.constants, worlds, wanted[part], self.progress
            )
        )
        if self._extra_reward is not None:
            shape = self.arrays.rewards.shape
            extra = checked("extra_reward", self._extra_reward(self), shape, np.float64)
            self.arrays.rewards[:] += extra
            self.arrays.episode_sums[:, 0] += extra.mean(axis=1)

    def observations(self) -> NDArray[np.float32]:
        """What every UAV sees now, (B, N, O): of the caller's own, else as configured."""
        if self._observe is None or self.own_observation_size is None:
            if self.parameters.uav.observation == "informed":
                return self.informed_observations()
            return self.arrays.observations
        shape = (self.world_count, self.uav_count, self.own_observation_size)
        return checked("observe", self._observe(self), shape, np.float32)

    def informed_observations(self) -> NDArray[np.float32]:
        """What every UAV knows of its users and neighbours now, (B, N, INFORMED_SIZE) (M40)."""
        seen = np.empty((self.world_count, self.uav_count, INFORMED_SIZE), np.float32)
        inform, moves_m = self.specialised(inform_worlds), shifts_m()
        self.divide(lambda part, worlds: inform(self.constants, worlds, moves_m, seen[part]))
        return seen

    def specialised(self, compiled: Callable[..., None]) -> Callable[..., None]:
        """A compiled function of these worlds' air-to-ground channel; itself for the built-in."""
        if self._own_path_loss is None:
            return compiled
        return specialised(compiled, self._own_path_loss.compiled, self._own_path_loss.digest)

    def step_except(self, resting: NDArray[np.bool_], actions: ArrayLike) -> None:
        """Step all worlds but those of ``resting`` (B,), which stay as they are."""
        if not resting.any():
            self.step(actions)
        elif not resting.all():
            arrays: Any = self.arrays  # of several kinds
            kept = [array[resting] for array in arrays]  # copies
            flown = np.asarray(actions)
            self.step(np.where(resting[:, None, None], 0.0, flown))
            for array, before in zip(arrays, kept, strict=True):
                array[resting] = before

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """All that the worlds' further course depends on: plain values, and copies of arrays."""
        document = {
            "progress": self.progress,
            "generators": [generator.bit_generator.state for generator in self.generators],
        }
        return document, {name: array.copy() for name, array in self._stored().items()}

    def restore(self, document: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a state that :meth:`state` of a batch with the same parameters gave.

        Raises:
            ValueError: a value that cannot be.
        """
        stored = self._stored()
        generators = document["generators"]
        if set(arrays) != set(stored) or len(generators) != self.world_count:
            raise ValueError("the state is that of other worlds")
        greatest = {
            "slot": self.parameters.network.episode_slots,
            "association": self.uav_count - 1,
            "loads": self.user_count,
        }
        for name, array in stored.items():
            given = arrays[name]
            if (given.shape, given.dtype) != (array.shape, array.dtype):
                raise ValueError(f"{name} is {given.dtype} of shape {given.shape}")
            # The compiled step takes indices on trust.
            if not np.isfinite(given).all() or given.max() > greatest.get(name, np.inf):
                raise ValueError(f"{name} holds values that cannot be")
        if (arrays["slot"] < 0).any() or (arrays["association"] < -1).any():
            raise ValueError("a slot or an association is negative")
        users_m = arrays["users_m"].transpose(0, 2, 1)
        if (users_m < 0).any() or (users_m > self.constants.area_size_m).any():
            raise ValueError("a user is outside the area")
        self.set_progress(document["progress"])
        for generator, state in zip(self.generators, generators, strict=True):
            generator.bit_generator.state = state
        for name, array in stored.items():
            array[...] = arrays[name]
        if not self.constants.flies_stations:
            self.arrays.stations_m[:] = self.arrays.positions_m[..., :2]
            self.arrays.station_velocities_mps[:] = self.arrays.velocities_mps[..., :2]

    def _stored(self) -> dict[str, NDArray[Any]]:
        # Checkpoints know the users' coordinates by the name that they had in the first version.
        former = {"user_coordinates_m": "users_m"}
        idle = set()  # as versions without stations, failures and sensing in flight stored it
        if not self.constants.flies_stations:
            idle |= {"stations_m", "station_velocities_mps"}
        if not len(self.constants.outages):
            idle |= {"in_service"}
        if self.constants.senses_truth:
            idle |= {"known_coordinates_m", "known_velocities_mps", "sensing_error_m", "past_users"}
        arrays = {
            former.get(name, name): array
            for name, array in self.arrays._asdict().items()
            if name not in idle
        }
        # … and one mast's shadowing without an axis of masts.
        shadowing_db = self._shadowing_db[:, 0] if self.mast_count == 1 else self._shadowing_db
        return arrays | ({"shadowing_db": shadowing_db} if self.mast_count else {})

    @property
    def known_users_m(self) -> NDArray[np.float64]:
        """Horizontal user positions as UAVs know them in flight, (B, M, 2), a view (M39)."""
        return self.arrays.known_coordinates_m.transpose(0, 2, 1)

    @property
    def users_m(self) -> NDArray[np.float64]:
        """Horizontal user positions, (B, M, 2): a view of ``arrays.user_coordinates_m``."""
        return self.arrays.user_coordinates_m.transpose(0, 2, 1)

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Worlds whose episode has reached its time limit, (B,)."""
        return self.arrays.slot >= self.parameters.network.episode_slots

    def episode_metrics(self, world: int) -> dict[str, float]:
        """An episode's metrics so far, by the names of ``EPISODE_METRICS``."""
        sums = self.arrays.episode_sums[world]
        slots = max(int(self.arrays.slot[world] - self._forgotten_slots[world]), 1)
        return dict(
            zip(EPISODE_METRICS, np.where(_IS_SUMMED, sums, sums / slots).tolist(), strict=True)
        )

    def forget_metrics(self) -> None:
        """Let the metrics of all episodes begin here, as if no slot had been flown."""
        self.arrays.episode_sums[:] = 0.0
        self._forgotten_slots[:] = self.arrays.slot

    def slot_metrics(self, world: int) -> dict[str, float]:
        """The last slot's fleet metrics, by the names of ``SLOT_METRICS``."""
        return dict(zip(SLOT_METRICS, self.arrays.metrics[world].tolist(), strict=True))

    def gbs_rates_bps(self) -> NDArray[np.float64]:
        """Rates (B, M) of the users that masts serve, 0 for others (decisions M4 and M45)."""
        return self.mast_service()[1]

    def mast_service(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The mast that serves each user, -1 for others, and the rates there, 0 for others.

        A user that is not a target belongs to the mast that it receives best, which shares its
        bandwidth equally among those of its users that reach the required SNR (decisions M4 and
        M45). Both are (B, M).
        """
        gbs, radio = self.parameters.gbs, self.parameters.channel
        masts_m = self.constants.gbs_positions_m
        if not len(masts_m):
            nobodys = (self.world_count, self.user_count)
            return np.full(nobodys, -1), np.zeros(nobodys)
        apart_m = self.arrays.user_coordinates_m[:, None] - masts_m[:, :2, None]
        distance_m = np.sqrt((apart_m**2).sum(axis=2) + masts_m[:, 2:] ** 2)
        loss_db = channel.ground_path_loss_db(
            distance_m, radio.carrier_frequency_hz, gbs.path_loss_exponent, self._shadowing_db
        )
        power_w = channel.received_power_w(self.constants.gbs_transmit_power_w, 0.0, loss_db)
        own_mast = channel.strongest_transmitter(power_w.swapaxes(0, 1))
        noise_w = radio.noise_power_w(gbs.access_bandwidth_hz)
        snr = channel.signal_to_noise_ratio(power_w.max(axis=1), noise_w)
        served = ~self.arrays.target_users & (snr >= self.parameters.required_snr)
        is_of_mast = own_mast[:, None] == np.arange(self.mast_count)[:, None]
        loads = (is_of_mast & served[:, None]).sum(axis=2)
        share = equal_share(np.maximum(np.take_along_axis(loads, own_mast, axis=1), 1))
        efficiency = channel.spectral_efficiency(snr)
        rates = user_rate_bps(share, gbs.access_bandwidth_hz, efficiency)
        return np.where(served, own_mast, -1), np.where(served, rates, 0.0)

    def snapshot(self, world: int = 0) -> dict[str, NDArray[np.generic] | int]:
        """Copies of one world's state for renderers and checkers; valid from slot 0 on.

        ``users_m`` (M, 2), ``target_users`` (M,), ``uav_positions_m`` (N, 3),
        ``uav_velocities_mps`` (N, 3), ``transmit_powers_w`` (N,), ``association`` (M,) with -1
        where no UAV serves the user, ``rates_bps`` (M,) with the masts' rates for their users,
        ``gbs_positions_m`` (G, 3), ``gbs_position_m`` (3,) where there is one mast, and ``slot``.
        """
        arrays, masts_m = self.arrays, self.constants.gbs_positions_m
        only = {"gbs_position_m": masts_m[0].copy()} if self.mast_count == 1 else {}
        return {
            "users_m": self.users_m[world].copy(),
            "target_users": arrays.target_users[world].copy(),
            "uav_positions_m": arrays.positions_m[world].copy(),
            "uav_velocities_mps": arrays.velocities_mps[world].copy(),
            "transmit_powers_w": arrays.transmit_powers_w[world].copy(),
            "association": arrays.association[world].copy(),
            "rates_bps": arrays.rates_bps[world] + self.gbs_rates_bps()[world],
            **only,
            "gbs_positions_m": masts_m.copy(),
            "slot": int(arrays.slot[world]),
        }
