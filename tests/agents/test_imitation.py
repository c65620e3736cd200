"""DAgger: what is asked, what is kept, and that it learns."""

import numpy as np
import pytest

from orchid_uav.agents.deployed_actor import LocalActor
from orchid_uav.agents.imitation.dagger import Dagger
from orchid_uav.agents.imitation.examples import Examples, remove_shards
from orchid_uav.agents.imitation.tasks import DRAWN, Variety, draw_task
from orchid_uav.envs import Parameters

STUDENT = {
    "uav.flight": "station",
    "uav.observation": "informed",
    "network.episode_slots": 20,
}
TINY = {"worlds": 4, "batch_size": 64, "gradient_steps": 20, "hidden_sizes": (24,)}


def student(**settings) -> Dagger:
    return Dagger(Parameters().with_overrides(STUDENT), **{**TINY, **settings})


class TestTasks:
    def test_they_differ_in_all_that_they_should(self):
        world = Parameters().with_overrides(STUDENT)
        generator = np.random.default_rng(0)
        drawn = [draw_task(world, generator, Variety()) for _ in range(300)]
        assert {task.network.uav_count for task in drawn} == set(range(4, 11))
        users = [task.network.user_count for task in drawn]
        assert 50 <= min(users) < 60
        assert 190 < max(users) <= 200
        assert {task.deployment.init for task in drawn} == {"balanced", "kmeans", "random"}
        for share, wanted in (
            (lambda task: task.network.user_speed_mps == 0.0, 0.2),
            (lambda task: task.sensing.delay_s > 0.0, 0.7),
            (lambda task: task.sensing.flight_error_std_m > 0.0, 0.7),
            (lambda task: task.network.distribution == "tcp", 0.7),
            (lambda task: bool(task.network.failures), 0.15),
        ):
            assert np.mean([share(task) for task in drawn]) == pytest.approx(wanted, abs=0.1)
        assert all(task.uav == world.uav for task in drawn)

    def test_no_configured_failure_and_no_number_of_masts_makes_one_impossible(self):
        masts = [[20.0 * index, 50.0] for index in range(45)]
        world = Parameters().with_overrides(
            {**STUDENT, "network.failures": ["5@3"], "gbs.positions_m": masts}
        )
        generator = np.random.default_rng(0)
        drawn = [draw_task(world, generator, Variety(failing=0.0)) for _ in range(200)]
        assert all(not task.network.failures for task in drawn)
        assert min(task.network.user_count for task in drawn) >= 49

    def test_they_differ_in_nothing_but_what_is_said_to_be_drawn(self):
        def flat(task):
            return {
                f"{section}.{key}": value
                for section, values in task.model_dump().items()
                for key, value in values.items()
            }

        world = Parameters().with_overrides(STUDENT)
        generator, base, changed = np.random.default_rng(0), flat(world), set()
        for _ in range(50):
            task = flat(draw_task(world, generator, Variety()))
            changed |= {key for key in task if task[key] != base[key]}
        assert changed == set(DRAWN)


class TestExamples:
    def test_the_newest_are_kept_and_files_of_older_ones_are_named_no_more(self, tmp_path):
        examples = Examples(10, 2, 1)
        for iteration in range(1, 5):
            rows = np.full((4, 2), iteration, np.float16)
            examples.add(iteration, rows, rows[:, :1], tmp_path)
        assert examples.count == 10
        kept, counts = np.unique(examples.actions, return_counts=True)
        assert dict(zip(kept.tolist(), counts.tolist(), strict=True)) == {2: 2, 3: 4, 4: 4}
        assert [shard.iteration for shard in examples.shards] == [2, 3, 4]
        again = Examples(10, 2, 1)
        again.restore(examples.document(), tmp_path)
        np.testing.assert_array_equal(again.actions, examples.actions)
        np.testing.assert_array_equal(again.observations, examples.observations)
        assert again.document() == examples.document()

    @pytest.mark.parametrize("harm", ["missing", "other", "numbers"])
    def test_what_is_not_what_was_written_is_told(self, tmp_path, harm):
        examples = Examples(10, 2, 1)
        rows = np.ones((4, 2), np.float16)
        examples.add(1, rows, rows[:, :1], tmp_path)
        document = examples.document()
        file = tmp_path / "1.safetensors"
        if harm == "missing":
            file.unlink()
        elif harm == "other":
            file.write_bytes(file.read_bytes()[:-1] + b"x")
        else:
            document["total"] = 9
        with pytest.raises((OSError, ValueError)):
            Examples(10, 2, 1).restore(document, tmp_path)

    def test_files_before_and_after_are_removed(self, tmp_path):
        for iteration in range(1, 7):
            (tmp_path / f"{iteration}.safetensors").touch()
        (tmp_path / "mine.txt").touch()
        remove_shards(tmp_path, before=3)
        remove_shards(tmp_path, after=5)
        assert sorted(path.name for path in tmp_path.iterdir()) == [
            *(f"{iteration}.safetensors" for iteration in (3, 4, 5)),
            "mine.txt",
        ]


class TestDagger:
    def test_every_flight_gives_examples_however_seldom_they_are_taken(self):
        learner = student(label_every=1000)
        for iteration in range(1, 5):
            learner.iterate()
            assert learner.examples.total >= iteration * TINY["worlds"]

    def test_it_learns_what_the_teacher_does(self):
        learner = student()
        losses = []
        for _ in range(8):
            learner.iterate()
            losses.append(learner.loss)
        still = np.square(learner.examples.actions[: learner.examples.count].astype(float)).mean()
        assert losses[-1] < 0.8 * still  # of what doing nothing would lose

    def test_equal_seeds_give_equal_bits_and_others_do_not(self):
        first, second, third = student(), student(), student(seed=1)
        for learner in (first, second, third):
            for _ in range(2):
                learner.iterate()
        for one, same, other in zip(
            *(learner.actor_layers() for learner in (first, second, third)), strict=True
        ):
            np.testing.assert_array_equal(one[0], same[0])
            assert (one[0] != other[0]).any()

    def test_it_goes_on_bit_for_bit(self, tmp_path):
        whole, parts = student(capacity=3000), student(capacity=3000)
        for _ in range(3):
            whole.iterate()
        for _ in range(2):
            parts.iterate(tmp_path)
        document, tensors = parts.training_state()
        resumed = student(capacity=3000)
        specs = resumed.training_state_specs(document)
        assert {name: set(found) for name, found in specs.items()} == {
            name: set(found) for name, found in tensors.items()
        }
        resumed.restore_training_state(document, tensors, tmp_path)
        metrics = resumed.iterate(tmp_path)
        assert metrics["coverage"] > 0.5
        for one, other in zip(whole.actor_layers(), resumed.actor_layers(), strict=True):
            np.testing.assert_array_equal(one[0], other[0])
            np.testing.assert_array_equal(one[1], other[1])

    def test_what_is_deployed_is_what_flew(self):
        learner = student()
        learner.iterate()
        seen = np.random.default_rng(0).normal(size=(7, 98)).astype(np.float32)
        actor = LocalActor(learner.actor_layers(), learner.exploration_log_std())
        np.testing.assert_allclose(actor.act(seen), learner.act(seen), atol=1e-5)

    def test_the_rate_falls_geometrically(self):
        learner = student(iterations=3, learning_rate=(1e-2, 1e-4), gradient_steps=1)
        rates = []
        for _ in range(4):
            learner.iterate()
            rates.append(learner.rate)
        np.testing.assert_allclose(rates, [1e-2, 1e-3, 1e-4, 1e-4])
