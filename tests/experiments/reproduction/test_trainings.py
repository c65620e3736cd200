"""What is trained for the claims: each configuration is the one that its command line makes."""

import json

import pytest

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.reproduction.trainings import TRAININGS, configured


@pytest.mark.parametrize("key", TRAININGS)
def test_the_command_line_makes_the_same_configuration(orchid, key):
    training = TRAININGS[key]
    program, command, *arguments = training.command(seed=17)
    assert (program, command) == ("orchid", "train")
    place = arguments.index("--name")
    assert arguments[place + 1] == key
    del arguments[place : place + 2]  # config show knows no names
    shown = orchid("config", "show", "--json", *arguments)
    assert json.loads(shown.out) == training.config(17).model_dump(mode="json")


def test_an_option_that_is_not_of_training_is_refused():
    with pytest.raises(InputError, match="--sed"):
        configured(["--sed", "3"])
