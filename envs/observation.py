"""What a UAV sees and what the critic sees besides (Section IV-C1; decisions M18 and M19)."""

BACKHAUL_SCALE_DB = 40.0
"""The backhaul SNR above its threshold is divided by this (M18)."""

OBSERVATION_NAMES = (
    "x / D",
    "y / D",
    "altitude within the flight box",
    "transmit power within its range",
    "horizontal distance to the nearest user / D",
    "served users / M",
    "margin to x = 0",
    "margin to x = D",
    "margin to y = 0",
    "margin to y = D",
    "margin to the lowest altitude",
    "margin to the highest altitude",
    "share of past slots with a collision",
    "share of past slots with a boundary violation",
    "share of past slots with a weak backhaul",
    "backhaul SNR above its threshold / 40 dB",
)
"""What the numbers of an observation are, in their order. Margins are divided by the extent of the
flight box along their axis."""
