"""Contains the numbers that the papers print, unchanged, for comparison only; control does not
use them.
"""

from __future__ import annotations

# Decision paper (A), table 1: plots in their order, and for each frequency CV, %, and C_uc, %, of
# each plot.
PLOT_NAMES = (
    "CK-0",
    "CK-1",
    "CK-2",
    "FA-0",
    "FA-1",
    "FA-2",
    "FB-0",
    "FB-1",
    "FB-2",
    "FC-0",
    "FC-1",
    "FC-2",
)
SAMPLING_PERCENT: dict[float, tuple[tuple[float, float], ...]] = {
    2.0: (
        (8.6, 93.84),
        (9.26, 93.32),
        (8.22, 94.17),
        (10.76, 92.1),
        (11.15, 92.0),
        (10.01, 92.89),
        (9.2, 93.17),
        (10.11, 92.57),
        (9.06, 93.35),
        (9.68, 92.56),
        (11.46, 91.67),
        (9.88, 92.64),
    ),
    1.0: (
        (7.93, 93.97),
        (8.48, 93.41),
        (7.93, 94.3),
        (11.16, 91.65),
        (11.39, 91.86),
        (10.24, 92.74),
        (10.74, 92.23),
        (11.73, 91.59),
        (10.71, 92.23),
        (9.97, 92.6),
        (10.1, 92.48),
        (9.46, 93.17),
    ),
    0.5: (
        (8.37, 94.05),
        (10.06, 91.93),
        (8.6, 93.41),
        (13.13, 90.58),
        (12.17, 92.46),
        (11.69, 92.52),
        (11.17, 92.13),
        (10.76, 92.86),
        (10.35, 92.82),
        (9.45, 92.86),
        (9.66, 92.68),
        (9.11, 93.08),
    ),
    0.25: (
        (9.75, 92.94),
        (11.88, 90.48),
        (10.21, 92.2),
        (11.32, 90.89),
        (7.62, 94.43),
        (7.97, 93.43),
        (13.85, 90.49),
        (13.56, 91.41),
        (13.16, 91.11),
        (10.54, 91.97),
        (9.99, 92.32),
        (9.92, 92.14),
    ),
    0.125: (
        (6.11, 95.34),
        (5.91, 95.31),
        (5.84, 95.32),
        (11.43, 91.28),
        (8.05, 94.24),
        (7.98, 94.01),
        (5.95, 95.3),
        (5.91, 95.87),
        (4.81, 96.05),
        (7.63, 94.12),
        (9.14, 92.98),
        (8.01, 93.55),
    ),
}

# Paper A, table 2: area, m2, target, kg, applied, kg, and error, %, of each plot.
APPLIED_AMOUNTS: dict[str, tuple[float, float, float, float]] = {
    "FA": (600.0, 22.0, 23.6, 7.27),
    "FB": (600.0, 20.2, 21.9, 8.42),
    "FC": (600.0, 18.9, 20.0, 5.82),
}

# Paper A, table 3: sample, kg, CV, %, and yield, kg/ha, of each treatment.
TREATMENT_YIELDS: dict[str, tuple[float, float, float]] = {
    "CK": (3.01, 15.2, 6000.6),
    "FA": (3.06, 9.1, 6125.3),
    "FB": (3.16, 8.69, 6312.5),
    "FC": (3.51, 7.31, 7000.2),
    "CP": (3.56, 11.3, 7125.1),
}

# Paper A, 7 March, figure 2: smallest and largest mean NDVI.
PLOT_NDVI = {"CK": 0.467, "FC": 0.546}

# Paper A, section 3.2: "about" this amount.
EXTRA_N_KG_HA = 28.0
UNIFORM_KG_HA = 300.0
MAIN_SPEED_KMH = 4.5

# Lag paper (B): ground speed of every field test, km/h.
LAG_SPEED_KMH = 4.25

# Paper B, table 1: lag distances, m, of three replicates by shaft speed, r/min.
LAG_M: dict[int, tuple[float, ...]] = {
    10: (3.13, 3.05, 3.18),
    20: (2.95, 3.05, 2.87),
    30: (2.88, 2.83, 2.92),
    40: (2.81, 2.74, 2.77),
    50: (2.62, 2.65, 2.67),
    60: (2.57, 2.6, 2.59),
    70: (2.34, 2.37, 2.29),
    80: (2.47, 2.51, 2.5),
    90: (2.57, 2.63, 2.55),
    100: (2.68, 2.73, 2.71),
}

# Paper B, table 2: response, s, with the tractor standing and moving, by shaft speed, r/min.
RESPONSE_S: dict[int, tuple[float, float]] = {
    10: (0.377, 0.382),
    20: (0.39, 0.374),
    30: (0.383, 0.383),
    40: (0.381, 0.386),
    50: (0.379, 0.383),
    60: (0.381, 0.39),
    70: (0.38, 0.382),
    80: (0.381, 0.391),
    90: (0.383, 0.386),
    100: (0.376, 0.387),
}

# Paper B, table 3: drop times, s, of ten replicates by shaft speed, r/min.
DROP_S: dict[int, tuple[float, ...]] = {
    10: (1.861, 1.751, 1.831, 1.641, 1.865, 1.862, 1.752, 1.861, 1.864, 1.643),
    20: (1.583, 1.639, 1.576, 1.628, 1.75, 1.634, 1.642, 1.532, 1.625, 1.635),
    30: (1.571, 1.531, 1.534, 1.641, 1.312, 1.643, 1.524, 1.612, 1.533, 1.745),
    40: (1.535, 1.645, 1.528, 1.532, 1.531, 1.096, 1.312, 1.421, 1.595, 1.64),
    50: (1.094, 1.529, 1.202, 1.643, 1.635, 1.42, 1.203, 1.422, 1.533, 1.42),
    60: (1.544, 1.469, 1.532, 1.415, 1.21, 1.426, 1.092, 1.464, 1.316, 1.318),
    70: (0.659, 1.641, 1.094, 1.196, 0.669, 1.424, 1.641, 1.424, 1.426, 1.202),
    80: (1.094, 1.53, 1.536, 1.095, 1.528, 0.983, 1.533, 1.424, 1.641, 1.314),
    90: (1.532, 1.639, 1.53, 1.314, 1.532, 1.313, 1.313, 1.42, 1.424, 1.422),
    100: (1.313, 1.417, 1.425, 1.638, 1.529, 1.534, 1.425, 1.315, 1.535, 1.426),
}

# Paper B, table 4: total lags, s, from the field and by the detector, by shaft speed, r/min.
TOTAL_LAG_S: dict[int, tuple[float, float]] = {
    10: (2.496, 2.176),
    20: (2.365, 2.006),
    30: (2.301, 1.947),
    40: (2.219, 1.866),
    50: (2.117, 1.792),
    60: (2.069, 1.761),
    70: (1.867, 1.62),
    80: (1.995, 1.75),
    90: (2.067, 1.826),
    100: (2.165, 1.838),
}

# Paper B, eq 6: s at 0 r/min, and s per r/min; valid for 10-70 r/min.
LAG_LINE = (2.2118, -8.3e-3)
# Paper B, figure 10: correlation of the line.
LAG_CORRELATION = 0.97

# Paper B, table 5: misses, m, after the correction, late positive, of three replicates by shaft
# speed, r/min.
CORRECTED_M: dict[int, tuple[float, ...]] = {
    10: (-0.163, 0.685, 0.457),
    20: (0.955, 1.05, 1.133),
    30: (0.502, 0.358, 0.742),
    40: (0.214, -0.15, 0.635),
    50: (0.404, 0.583, 0.147),
    60: (0.955, 0.872, 1.135),
    70: (0.893, 0.75, 0.983),
}

# Paper B, table 6: misses, m, before and after the correction by shaft speed, r/min.
CORRECTION_GAIN_M: dict[int, tuple[float, float]] = {
    10: (3.12, 0.326),
    20: (2.96, 1.046),
    30: (2.88, 0.534),
    40: (2.77, 0.233),
    50: (2.65, 0.378),
    60: (2.59, 0.987),
    70: (2.33, 0.875),
}

# Point paper (C), table 1: shaft speed, r/min, by microstep mode.
MICROSTEP_RPM: dict[int, float] = {
    1: 201.0,
    2: 99.8,
    4: 50.0,
}

# Paper C, section 2.3: delays, s.
POINT_DELAYS_S: dict[str, float] = {
    "vision": 1.5,
    "link": 0.8,
    "turn": 0.2,
    "fall": 0.45,
    "total": 2.95,
}
