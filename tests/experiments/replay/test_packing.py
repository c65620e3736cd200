"""Arrays as texts: what comes out again, how exact, and what is refused."""

import base64
import json
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from orchid_uav.experiments.replay.packing import Packed, pack, pack_magnitudes, pack_states

SHAPES = arrays.array_shapes(min_dims=1, max_dims=3, max_side=6)
LENGTHS = st.floats(-1e5, 1e5)


def again(packed):
    """As it is read from a file."""
    return Packed.from_json(json.loads(json.dumps(packed.to_json())))


@given(arrays.arrays(np.float64, SHAPES, elements=LENGTHS), st.sampled_from([0.1, 0.5, 3.0]))
def test_states_come_back_within_half_a_step(values, scale):
    packed = again(pack_states(values, scale))
    assert packed.shape == list(values.shape)
    np.testing.assert_allclose(packed.values(), values, atol=scale / 2 + 1e-9, rtol=0)


@given(arrays.arrays(np.float64, SHAPES, elements=st.floats(0.0, 1e12)))
def test_magnitudes_come_back_within_half_a_ratio(values):
    found = again(pack_magnitudes(values, 1.005)).values()
    assert ((found == 0.0) == (values <= 1.0)).all()
    some = values > 1.0
    apart = np.abs(np.log(found[some] / values[some]))
    # Just above 1, no number but 0 would be nearer than that of one whole step.
    assert (apart[values[some] > 1.005] <= np.log(1.005) / 2 + 1e-9).all()
    assert (apart <= np.log(1.005)).all()


@given(arrays.arrays(np.float32, SHAPES, elements=st.floats(width=32)))
def test_floats_come_back_as_they_were(values):
    np.testing.assert_array_equal(again(pack(values, "float32")).numbers(), values)


def test_the_bytes_are_what_the_page_reads():
    """Worked out by hand: two numbers over three states."""
    packed = pack_states([[10, -1], [12, -1], [11, -5]], 1.0)
    content = zlib.decompress(base64.b64decode(packed.packed))
    assert content == bytes([10, 0, 0, 0, 255, 255, 255, 255, 2, 255, 0, 252])
    assert (packed.type, packed.shape, packed.series) == ("int8", [3, 2], True)
    assert zlib.decompress(base64.b64decode(pack([1.0], "float32").packed)) == b"\0\0\x80\x3f"


@pytest.mark.parametrize(("step", "kind"), [(127, "int8"), (-129, "int16"), (40_000, "int32")])
def test_the_type_is_the_shortest_that_holds_all_differences(step, kind):
    packed = pack_states([[0.0], [step]], 1.0)
    assert packed.type == kind
    np.testing.assert_array_equal(packed.values(), [[0.0], [step]])


@pytest.mark.parametrize("value", [np.nan, np.inf, 3e9])
def test_what_cannot_be_written_is_refused(value):
    with pytest.raises(ValueError, match="not finite, or too large"):
        pack_states([[0.0], [value]], 1.0)
    with pytest.raises(ValueError, match="do not fit into uint8"):
        pack([0, 256], "uint8")
    with pytest.raises(ValueError, match="not finite"):
        pack_magnitudes([[np.nan]], 1.005)
    with pytest.raises(ValueError, match="no state"):
        pack_states(np.empty((0, 3)), 1.0)


def test_what_was_changed_is_refused():
    packed = pack_states([[0.0, 1.0]], 1.0)
    longer = packed.model_copy(update={"shape": [2, 2]})
    with pytest.raises(ValueError, match="has not the 10 bytes"):
        longer.numbers()
    bomb = base64.b64encode(zlib.compress(bytes(10**7), 9)).decode()
    with pytest.raises(ValueError, match="has not the 8 bytes"):
        packed.model_copy(update={"packed": bomb}).numbers()
    for shape in ([10**6, 10**6], [-1]):
        with pytest.raises(ValueError, match="cannot have the shape"):
            packed.model_copy(update={"shape": shape}).numbers()
